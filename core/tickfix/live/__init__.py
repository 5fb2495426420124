"""The live driver: events as they arrive, ticks when they are due, and a journal from which the run replays.

``engine`` is the round and the place to begin; ``startup`` builds an engine, ``supervisor`` restarts it from outside.
"""
