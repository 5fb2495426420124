"""ZeroMQ: sensors in, positions out, control; who may come in, and how much of it."""
