"""The loop of a live engine, round by round: what comes in, what is due, and doing it.

:mod:`~tickfix.drivers.live.loop.engine` is the round, and the place to begin.
"""
