"""Sites for the Python face: surveyed from walks, or from a table of fingerprints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

from tickfix.api import Floor, RadioMap, Recording, Survey
from tickfix.replay.recording_files import Progress, RecordingFile, no_progress
from tickfix.replay.site_survey import read_walks, survey_and_train, train, trainable_choices
from tickfix.site import FingerprintTable, Site
from tickfix.workflow.pipelines import PipelineSpec, resolve_pipelines, warn_each
from tickfix.workflow.walks import WalkSource, find_walks

FingerprintSource: TypeAlias = FingerprintTable | RadioMap | str | PathLike[str] | Any
"""A table, a radio map, a CSV file, or a pandas ``DataFrame``."""


def survey(
    walks: WalkSource | Iterable[WalkSource],
    *,
    holdout: float = 0.0,
    pipelines: PipelineSpec = None,
    floors: Sequence[Floor] = (),
    name: str | None = None,
    seed: int | None = None,
    progress: Progress = no_progress,
) -> Site:
    """Survey walks with waypoints: floor plans, radio map, trained models, and walks held out for testing.

    Args:
        walks: recordings, files, or folders of them.
        holdout: share of walks, 0 to 1, to keep for testing; see :attr:`tickfix.Site.held_out`.
        pipelines: whose algorithms are trained, see :func:`tickfix.workflow.pipelines.resolve_pipelines`.
        floors: plans, besides those that readers find beside the files.
        name: of the site; that of the folder by default.
        seed: of training.
        progress: called as ``progress(what, done, total)``.

    Raises:
        ReaderError: when there are no recordings.
        SiteError: when no walk with waypoints is left to survey.
    """
    config = resolve_pipelines(pipelines, seed=seed)
    sources = find_walks(walks)
    files = [source for source in sources if isinstance(source, RecordingFile)]
    read = read_walks(files, progress)
    loaded: list[Recording] = [source.read() for source in sources if not isinstance(source, RecordingFile)]
    known = {floor.name for floor in floors}
    surveyed = survey_and_train(
        [*(recording for _, recording in read.walks), *loaded],
        [*floors, *(floor for floor in read.floors if floor.name not in known)],
        config.pipelines,
        name=name or _default_name(walks),
        holdout=holdout,
        seed=config.kernel.seed,
        progress=progress,
    )
    warn_each([*read.problems, *surveyed.problems])
    return surveyed.site


def site_from_fingerprints(
    fingerprints: FingerprintSource,
    *,
    floors: Sequence[Floor] = (),
    pipelines: PipelineSpec = None,
    name: str = "fingerprints",
    seed: int | None = None,
    **columns: Any,
) -> Site:
    """Return a site of fingerprints that were collected standing still, without walks.

    Fingerprints that have a model of their own are trained; what needs walks to learn from (headings, step lengths, the
    error of fixes) keeps its defaults.

    Args:
        fingerprints: a :class:`~tickfix.FingerprintTable`, a :class:`~tickfix.api.RadioMap`, a CSV file, or a pandas
            ``DataFrame``.
        floors: plans; a floor without one has no geometry.
        pipelines: whose fingerprints are trained.
        name: of the site.
        seed: of training.
        columns: how the columns of a CSV file or a frame are called, see
            :meth:`tickfix.FingerprintTable.from_frame`.

    Raises:
        SiteError: when the table is not understood or holds no reading.
    """
    config = resolve_pipelines(pipelines, seed=seed)
    radio_map = as_radio_map(fingerprints, **columns)
    known = {floor.name for floor in floors}
    plans = (*floors, *(Floor(name=each) for each in radio_map.floors if each not in known))
    site = Site(name=name, floors=tuple(sorted(plans, key=lambda f: (f.level, f.name))), radio_map=radio_map)
    survey_data = Survey(floors=site.floors, radio_map=radio_map, walks=())
    choices = [choice for choice in trainable_choices(config.pipelines) if choice.offer.kind == "fingerprint"]
    models, problems = train(choices, survey_data, config.kernel.seed)
    warn_each(problems)
    return replace(site, models=models)


def as_radio_map(fingerprints: FingerprintSource, **columns: Any) -> RadioMap:
    """Return the radio map of fingerprints, see :func:`site_from_fingerprints`."""
    if isinstance(fingerprints, RadioMap):
        return fingerprints
    return as_table(fingerprints, **columns).radio_map()


def as_table(fingerprints: FingerprintSource, **columns: Any) -> FingerprintTable:
    """Return a table of fingerprints that may be a file or a frame."""
    if isinstance(fingerprints, FingerprintTable):
        return fingerprints
    if isinstance(fingerprints, (str, PathLike)):
        return FingerprintTable.read_csv(fingerprints, **columns)
    return FingerprintTable.from_frame(fingerprints, **columns)


def _default_name(walks: Any) -> str:
    return Path(walks).absolute().name if isinstance(walks, (str, PathLike)) else "site"
