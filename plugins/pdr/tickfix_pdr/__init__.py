"""First-party algorithms of tickfix; they arrive through the same entry points as anyone's."""
