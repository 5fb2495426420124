"""The sites of a comparison with the walks to run on each: surveyed sites, or the folds of a cross-validation."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from tickfix.api import Floor, Recording, SiteError
from tickfix.api.packing import pack
from tickfix.config import PipelineConfig
from tickfix.replay.recording_files import LoadedRecording, Progress, RecordingFile
from tickfix.replay.site_survey import WalksWithFloors, survey_and_train, trainable_choices
from tickfix.site import Site
from tickfix.site.waypoints import assign_chains, is_held_out
from tickfix.wire import encode_event


@dataclass(frozen=True, slots=True)
class EvaluationWalk:
    """A recording to run.

    Attributes:
        source: the file and its reader, or a recording in memory.
        sha256: of the file, or of the recording's events as the wire encodes them.
    """

    source: RecordingFile | LoadedRecording
    sha256: str

    @staticmethod
    def of(source: RecordingFile | LoadedRecording) -> EvaluationWalk:
        """Return the walk of a file or a recording."""
        if isinstance(source, RecordingFile):
            return EvaluationWalk(source, sha256(source.path.read_bytes()).hexdigest())
        encoded = sha256()
        for event in source.recording.events:
            encoded.update(encode_event(event))
        return EvaluationWalk(source, encoded.hexdigest())


@dataclass(frozen=True, slots=True, eq=False)
class EvaluationSite:
    """A site and the walks to run on it.

    Attributes:
        name: in reports, which pool sites of one name; walks are unique within it.
        digest: of all that a run takes from the site.
        site: gives it; called only when a walk must be run.
        walks: in their order.
        floors: to draw walks on.
    """

    name: str
    digest: str
    site: Callable[[], Site]
    walks: tuple[EvaluationWalk, ...]
    floors: tuple[Floor, ...]


def surveyed_site(site: Site, name: str, sources: Sequence[RecordingFile | LoadedRecording]) -> EvaluationSite:
    """Return the evaluation site of a surveyed site."""
    return EvaluationSite(
        name, site_digest(site), lambda: site, tuple(EvaluationWalk.of(source) for source in sources), site.floors
    )


def site_digest(site: Site) -> str:
    """Return the SHA-256 of what a run takes from a site: floors, radio map, survey tracks and models.

    Name, held-out walks and notes do not matter.
    """
    sha = sha256()
    for floor in site.floors:
        sha.update(pack(floor))
    sha.update(pack(site.radio_map))
    for track in site.survey_tracks:
        sha.update(pack(track))
    for key, model in site.models.items():
        for name, array in sorted(model.items()):
            sha.update(f"{key}\0{name}\0".encode() + _array_bytes(array))
    return sha.hexdigest()


def _array_bytes(array: Any) -> bytes:
    described: str = f"{array.dtype.str} {array.shape} "
    content: bytes = array.tobytes()
    return described.encode() + content


def evaluation_site_names(sites: Sequence[tuple[Path, Site]]) -> list[str]:
    """Return a name for each site: its own, or the path where several share one."""
    names = [site.name for _, site in sites]
    return [name if names.count(name) == 1 else str(path) for name, (path, _) in zip(names, sites, strict=True)]


HOLDOUT_SHARE: Final = 0.3
"""Share of walks that cross-validation leaves out: those that ``tickfix survey --holdout 0.3`` holds out."""


def assign_folds(
    recordings: Sequence[Recording], count: int, holdout_share: float = HOLDOUT_SHARE
) -> Mapping[str, tuple[tuple[str, ...], ...]]:
    """Return the names of the walks of each fold, by floor; walks without waypoints or of several floors are in none.

    Args:
        recordings: in any order.
        count: K, at least 2.
        holdout_share: share of walks to leave alone.

    Raises:
        SiteError: for fewer than 2 folds, or a floor with fewer chains than folds.
    """
    if count < 2:
        raise SiteError(f"cross-validation: found {count} folds, expected at least 2")
    chain_of = assign_chains(recordings)
    chains_on: defaultdict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for recording in recordings:
        chain = chain_of.get(recording.name)
        if chain is not None and recording.floor and not is_held_out(chain, holdout_share):
            chains_on[recording.floor][chain].append(recording.name)
    dealt: dict[str, tuple[tuple[str, ...], ...]] = {}
    for floor, on_floor in sorted(chains_on.items()):
        if len(on_floor) < count:
            raise SiteError(
                f"cross-validation: floor {floor!r} has {len(on_floor)} chains of walks, expected at least {count}, "
                "one for each fold; ask for fewer folds or record more walks"
            )
        order = sorted(on_floor, key=lambda chain: sha256(chain.encode()).hexdigest())
        dealt[floor] = tuple(
            tuple(sorted(walk for chain in order[fold::count] for walk in on_floor[chain])) for fold in range(count)
        )
    return dealt


def crossvalidation_sites(
    read: WalksWithFloors,
    pipelines: Sequence[PipelineConfig],
    *,
    count: int,
    seed: int,
    holdout_share: float = HOLDOUT_SHARE,
    progress: Progress,
    warn: Callable[[str], None],
) -> tuple[EvaluationSite, ...]:
    """Return an evaluation site for each floor and fold, named by its floor; each is surveyed when it is used.

    Args:
        read: all walks of a building.
        pipelines: what is trained on each site.
        count, holdout_share: see :func:`folds`.
        seed: of training.
        progress: shown while a site is surveyed.
        warn: told of what went wrong in a survey.

    Raises:
        SiteError: see :func:`folds`.
    """
    by_name = {recording.name: (EvaluationWalk.of(source), source, recording) for source, recording in read.walks}
    plans = {floor.name: floor for floor in read.floors}
    trained_models = sorted(f"{choice.model} {choice.offer.version}" for choice in trainable_choices(pipelines))
    evaluation_sites = []
    for floor, parts in assign_folds([recording for _, recording in read.walks], count, holdout_share).items():
        plan = plans.get(floor, Floor(name=floor))
        for i, part in enumerate(parts):
            training_names = [name for j, other in enumerate(parts) if j != i for name in other]
            training_digests = [by_name[name][0].sha256 for name in sorted(training_names)]
            digest = sha256(json.dumps([training_digests, trained_models, seed]).encode() + pack(plan)).hexdigest()
            training_walks = [by_name[name][2] for name in training_names]
            site = partial(
                _survey_fold, training_walks, plan, pipelines, f"{floor} without fold {i + 1}", seed, progress, warn
            )
            evaluation_sites.append(
                EvaluationSite(floor, digest, site, tuple(by_name[name][0] for name in part), (plan,))
            )
    return tuple(evaluation_sites)


def _survey_fold(
    training_walks: Sequence[Recording],
    plan: Floor,
    pipelines: Sequence[PipelineConfig],
    name: str,
    seed: int,
    progress: Progress,
    warn: Callable[[str], None],
) -> Site:
    def show(what: str, done: int, total: int) -> None:
        progress(f"{name}: {what}", done, total)

    surveyed = survey_and_train(training_walks, [plan], pipelines, name=name, seed=seed, progress=show)
    for problem in surveyed.problems:
        warn(f"{name}: {problem}")
    return surveyed.site
