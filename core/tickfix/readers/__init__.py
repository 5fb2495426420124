"""Readers of recorded formats: files in, events with their measured and logged times out."""
