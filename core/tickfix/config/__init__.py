"""TOML → typed, validated settings and pipelines, built for a site.

An error names the file, the key, the value found and what is allowed.
"""

from tickfix.config.build import build_pipelines
from tickfix.config.choices import (
    AlgorithmChoice,
    BuiltAlgorithm,
    Config,
    ParameterInfo,
    PipelineConfig,
    RenamedKeyError,
    describe_parameters,
)
from tickfix.config.parse import STAGES, load_config, parse_config, parse_table
from tickfix.kernel import Pipeline, Stage
from tickfix.registry import Registry

__all__ = [
    "STAGES",
    "AlgorithmChoice",
    "BuiltAlgorithm",
    "Config",
    "ParameterInfo",
    "Pipeline",
    "PipelineConfig",
    "Registry",
    "RenamedKeyError",
    "Stage",
    "build_pipelines",
    "describe_parameters",
    "load_config",
    "parse_config",
    "parse_table",
]
