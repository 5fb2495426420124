"""Devices shared out among worker processes: for the loop the same as one replica, only that several cores fold.

``crew`` is what the loop talks to and ``worker`` what answers; ``roll`` knows without asking what concerns all devices.
"""
