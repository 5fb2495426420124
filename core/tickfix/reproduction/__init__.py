"""The experiments of the papers, run again on simulated twins of their sites.

Each paper has a folder: the twin (what the text prints as printed, what it does not print chosen and listed), the
experiment over many seeds, and its claims. ``report`` holds what all of them give back.
"""
