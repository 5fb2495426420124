"""Sinks of estimates: JSON Lines and GeoJSON files, and the choice of a sink by a file's suffix."""

from tickfix.sinks.file_sinks import GeoJsonSink, GeoJsonWriter, JsonLinesSink, SinkTarget, open_sink, sink_for

__all__ = ["GeoJsonSink", "GeoJsonWriter", "JsonLinesSink", "SinkTarget", "open_sink", "sink_for"]
