"""Readers of recorded formats: from files to events with measured and logged times."""
