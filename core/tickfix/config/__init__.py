"""TOML → typed, validated settings and pipelines, built for a site.

An error says in which file, under which key, what was found and what is allowed.
"""

from tickfix.config.building import build
from tickfix.config.choices import Choice, Config, PipelineConfig
from tickfix.config.parameters import Field, describe
from tickfix.config.parsing import STAGES, load, parse

__all__ = ["STAGES", "Choice", "Config", "Field", "PipelineConfig", "build", "describe", "load", "parse"]
