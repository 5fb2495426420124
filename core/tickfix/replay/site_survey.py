"""From recordings with waypoints to a site with trained models, and from a site to the context that algorithms are
built for.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from tickfix.api import Context, Floor, ReaderError, Recording, Survey, TrainedModel
from tickfix.config import AlgorithmChoice, PipelineConfig
from tickfix.kernel.determinism import RandomStreams
from tickfix.replay.process_pool import parallel_map
from tickfix.replay.recording_files import Progress, RecordingFile, no_progress, read_recordings
from tickfix.site import Site
from tickfix.site.survey_builder import read_floor_plans, survey_recordings

_STREAM_DEVICE = "survey"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrainedSite:
    """A site with its models, and everything that went wrong on the way, for people to read."""

    site: Site
    problems: tuple[str, ...]


def site_context(site: Site) -> Context:
    """Return what algorithms are built for."""
    floors = {floor.name: floor for floor in site.floors}
    return Context(floors=MappingProxyType(floors), radio_map=site.radio_map, transitions=site.transitions)


def survey_files(
    sources: Sequence[RecordingFile],
    pipelines: Iterable[PipelineConfig],
    *,
    name: str,
    holdout: float,
    seed: int,
    progress: Progress = no_progress,
) -> TrainedSite:
    """Read recordings and survey them; one that cannot be read is left out and reported.

    Raises:
        TickfixError: when no walk is left to survey.
    """
    read = read_walks(sources, progress)
    recordings = [recording for _, recording in read.walks]
    surveyed = survey_and_train(
        recordings, read.floors, pipelines, name=name, holdout=holdout, seed=seed, progress=progress
    )
    return replace(surveyed, problems=(*read.problems, *surveyed.problems))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WalksWithFloors:
    """Recordings with the plans of their floors, and what was wrong with some of them.

    Attributes:
        walks: those that could be read, in their order, each with where it came from.
    """

    walks: tuple[tuple[RecordingFile, Recording], ...]
    floors: tuple[Floor, ...]
    problems: tuple[str, ...]


def read_walks(sources: Sequence[RecordingFile], progress: Progress = no_progress) -> WalksWithFloors:
    """Read recordings and the plans of their floors; what cannot be read is left out and reported."""
    problems: list[str] = []
    walks: list[tuple[RecordingFile, Recording]] = []
    by_reader: defaultdict[str, list[Recording]] = defaultdict(list)
    readers = {source.name: source.reader for source in sources}
    for source, recording in zip(sources, read_recordings(sources, progress), strict=True):
        if isinstance(recording, ReaderError):
            problems.append(f"{recording}; it is left out")
            continue
        walks.append((source, recording))
        by_reader[source.name].append(recording)
        problems += [f"{source.path}: {problem}" for problem in recording.problems]
    floors: list[Floor] = []
    for reader, mine in by_reader.items():
        plans, broken = read_floor_plans(readers[reader], mine)
        floors += plans
        problems += broken
    return WalksWithFloors(walks=tuple(walks), floors=tuple(floors), problems=tuple(problems))


def survey_and_train(
    recordings: Iterable[Recording],
    floors: Sequence[Floor],
    pipelines: Iterable[PipelineConfig],
    *,
    name: str,
    holdout: float = 0.0,
    seed: int = 0,
    spacing_m: float = 2.0,
    reach_m: float = 3.0,
    progress: Progress = no_progress,
) -> TrainedSite:
    """Survey walks and train what the pipelines chose; the rest is as in
    :func:`tickfix.site.survey_builder.survey_recordings`.

    Raises:
        SiteError: when no walk is left to survey.
    """
    result = survey_recordings(
        recordings,
        floors,
        name=name,
        holdout=holdout,
        spacing_m=spacing_m,
        reach_m=reach_m,
        progress=lambda done, total: progress("mapping", done, total),
    )
    models, problems = train(trainable_choices(pipelines), result.training_data, seed, progress)
    return TrainedSite(site=replace(result.site, models=models), problems=problems)


def trainable_choices(pipelines: Iterable[PipelineConfig]) -> tuple[AlgorithmChoice, ...]:
    """Return the choices that learn from a survey, each model once, in the order of the pipelines."""
    choices: dict[str, AlgorithmChoice] = {}
    for pipeline in pipelines:
        for choice in pipeline.choices:
            if choice.built is None and hasattr(choice.offer.cls, "train"):
                choices.setdefault(choice.model, choice)
    return tuple(choices.values())


def train(
    choices: Sequence[AlgorithmChoice], training_data: Survey, seed: int, progress: Progress = no_progress
) -> tuple[Mapping[str, TrainedModel], tuple[str, ...]]:
    """Train each choice; return models by :attr:`~tickfix.config.AlgorithmChoice.model`, and what failed.

    The random stream is keyed by the model, so that what else is trained changes no model.
    """

    def learn(choice: AlgorithmChoice) -> TrainedModel | str:
        rng = RandomStreams(seed, _STREAM_DEVICE).at(0, 0, choice.model)
        try:
            return _checked_model(choice.offer.cls.train(choice.params, training_data, rng))
        except Exception as error:  # noqa: BLE001 - an algorithm that cannot learn must not cost the survey
            return f"{choice.offer.label}: training failed: {type(error).__name__}: {error}; it will run untrained"

    models: dict[str, TrainedModel] = {}
    problems: list[str] = []
    progress("training", 0, len(choices))
    for done, (choice, model) in enumerate(zip(choices, parallel_map(learn, choices), strict=True), start=1):
        if isinstance(model, str):
            problems.append(model)
        else:
            models[choice.model] = model
        progress("training", done, len(choices))
    return models, tuple(problems)


def _checked_model(model: Any) -> TrainedModel:
    if not isinstance(model, Mapping):
        raise TypeError(f"train returned {type(model).__name__}, expected named arrays")
    arrays = {str(name): np.asarray(array) for name, array in model.items()}
    for name, array in arrays.items():
        if array.dtype.kind == "O":
            raise TypeError(f"train returned {name!r} as an array of objects, expected numbers or strings")
    return arrays
