"""Programs that send to an engine, and could run anywhere: they know its ports, and nothing of how it works."""
