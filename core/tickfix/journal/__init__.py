"""The append-only record of a run, in MCAP: events, decisions, estimates, snapshots, and what made them."""
