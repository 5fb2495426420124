"""The checks of filters, by what they are about: the contract itself, purity, survival, and the whole in the kernel."""

from tickfix.testing.filters.contract import FilterContract

__all__ = ["FilterContract"]
