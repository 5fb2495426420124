"""Programs that send to an engine over its ports and may run on another machine."""
