"""The live driver: events as they arrive, ticks when they are due, a journal from which all of it repeats.

``engine`` is the loop; ``replica`` is a kernel that does what events and decisions say, live or again; ``deadlines``
says when ticks close; ``locating`` keeps scans from delaying them; ``resuming`` goes on after a crash.
"""
