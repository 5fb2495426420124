"""Checked choices → algorithms built for a site."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from tickfix.api.algorithms import TrainedModel
from tickfix.api.errors import PluginError
from tickfix.api.site import Context
from tickfix.config.choices import AlgorithmChoice, PipelineConfig
from tickfix.kernel import Pipeline, Stage


def build_pipelines(
    pipelines: Iterable[PipelineConfig], context: Context, models: Mapping[str, TrainedModel]
) -> tuple[Pipeline, ...]:
    """Build the algorithms of the pipelines for a site; stages chosen alike are built, and computed, once.

    Args:
        context: the site, without maps and fingerprint.
        models: what was trained when the site was surveyed, by :attr:`Choice.model`.

    Raises:
        PluginError: when an algorithm cannot be built; it names pipeline and stage.
    """
    built: dict[str, Any] = {}

    def make(choice: AlgorithmChoice, within: Context, pipeline: str, suffix: str = "") -> Any:
        if choice.built is not None:
            return choice.built.algorithm
        key = choice.key + suffix
        if key not in built:
            try:
                built[key] = choice.offer.cls(choice.params, within, models.get(choice.model))
            except Exception as error:
                label = f"{choice.offer.kind} '{choice.offer.name}' in pipeline '{pipeline}'"
                problem = f"cannot be built: {type(error).__name__}: {error}"
                raise PluginError(label, problem, "Check its parameters and the site it is built for") from error
        return built[key]

    def stage(choice: AlgorithmChoice, within: Context, pipeline: str, suffix: str = "") -> Stage:
        return Stage(choice.offer.kind, choice.offer.name, choice.key + suffix, make(choice, within, pipeline, suffix))

    result = []
    for config in pipelines:
        maps: dict[str, Any] = {}
        if config.map is not None:
            for name, floor in context.floors.items():
                maps[name] = make(config.map, replace(context, floor=floor), config.name, f" on {name}")
        fingerprint = None if config.fingerprint is None else stage(config.fingerprint, context, config.name)
        within = replace(
            context,
            maps=MappingProxyType(maps),
            fingerprint=None if fingerprint is None else fingerprint.algorithm,
        )
        pdr = None if config.pdr is None else stage(config.pdr, context, config.name)
        suffix = " with " + " and ".join(c.key for c in config.choices if c is not config.filter)
        result.append(Pipeline(config.name, stage(config.filter, within, config.name, suffix), pdr, fingerprint))
    return tuple(result)
