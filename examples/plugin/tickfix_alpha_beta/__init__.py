"""The α–β filter for tickfix."""
