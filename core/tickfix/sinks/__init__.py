"""Writes estimates to files; what a third-party sink builds on."""
