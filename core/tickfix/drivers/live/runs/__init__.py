"""A run and its journal: how one begins, goes on after a crash, is repeated, and is taken for a recording."""
