"""The SDK: all that a plugin may import of tickfix.

A plugin is a class of one of four kinds and one hook that offers it. Start from the base that fits (a filter in two
halves, a stateless fingerprint …), run :mod:`tickfix.testing` on it, and choose it by name in a pipeline.
"""

from tickfix.api.algorithms import Filter, FilterOfMany, Fingerprint, Pdr, Rng, Trained
from tickfix.api.arrays import Bools, Floats, Ints, frozen
from tickfix.api.bases import (
    BaseFilter,
    BaseFingerprint,
    BaseMap,
    BasePdr,
    PredictUpdateFilter,
    Stateless,
    StatelessFingerprint,
)
from tickfix.api.errors import ConfigError, EventError, PluginError, ReaderError, SiteError, TickfixError
from tickfix.api.events import (
    LATEST_NS,
    SENSORS,
    TICK_NS,
    Event,
    Fix,
    MotionSamples,
    Pressure,
    Samples,
    Scan,
    Truth,
    motion_samples,
)
from tickfix.api.geometry import displacement, heading_of, wrap_rad
from tickfix.api.hooks import API_VERSION, hookimpl
from tickfix.api.packing import pack, unpack
from tickfix.api.parameters import NoParams, Preset, parameter
from tickfix.api.recordings import Reader, Recording, Sink
from tickfix.api.site import Context, Floor, FloorMap, RadioMap, Survey, SurveyWalk
from tickfix.api.values import (
    Belief,
    Component,
    Estimate,
    Motion,
    Observation,
    Prior,
    Readings,
    Report,
    Status,
    Window,
)

__all__ = [
    "API_VERSION",
    "LATEST_NS",
    "SENSORS",
    "TICK_NS",
    "BaseFilter",
    "BaseFingerprint",
    "BaseMap",
    "BasePdr",
    "Belief",
    "Bools",
    "Component",
    "ConfigError",
    "Context",
    "Estimate",
    "Event",
    "EventError",
    "Filter",
    "FilterOfMany",
    "Fingerprint",
    "Fix",
    "Floats",
    "Floor",
    "FloorMap",
    "Ints",
    "Motion",
    "MotionSamples",
    "NoParams",
    "Observation",
    "Pdr",
    "PluginError",
    "PredictUpdateFilter",
    "Preset",
    "Pressure",
    "Prior",
    "RadioMap",
    "Reader",
    "ReaderError",
    "Readings",
    "Recording",
    "Report",
    "Rng",
    "Samples",
    "Scan",
    "Sink",
    "SiteError",
    "Stateless",
    "StatelessFingerprint",
    "Status",
    "Survey",
    "SurveyWalk",
    "TickfixError",
    "Trained",
    "Truth",
    "Window",
    "displacement",
    "frozen",
    "heading_of",
    "hookimpl",
    "motion_samples",
    "pack",
    "parameter",
    "unpack",
    "wrap_rad",
]
