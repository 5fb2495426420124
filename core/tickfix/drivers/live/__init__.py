"""The live driver: events as they arrive, ticks when they are due, a journal from which all of it repeats.

``serving`` brings an engine up. ``loop`` takes messages in and decides what runs; ``replica`` is a kernel that does
what events and decisions say, live or again, and ``crew`` is the same in several processes; ``locating`` keeps scans
from delaying ticks. What is said goes by ``speaker``, ``ledger`` and ``outbox`` to journal and ports. ``runs`` goes
on after a crash and repeats a journal, ``following`` does what another engine does, ``watchdog`` looks after it from
outside.
"""
