"""Cross-validation: learn from most walks of a floor, run on the rest, in turn; held-out walks are never touched.

The rule, word by word: per floor, chains of walks (:mod:`tickfix.site.holdout`) that a survey with the hold-out
``spare`` would keep back are left out; the other chains, in the order of the SHA-256 of their names, are dealt in turn
to K folds. Each fold's walks are run on a site surveyed from the walks of the other folds. Each floor is a site of its
own.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from hashlib import sha256
from typing import Final

from tickfix.api import Floor, Recording, SiteError
from tickfix.api.packing import pack
from tickfix.config import PipelineConfig
from tickfix.drivers.recordings import Progress
from tickfix.drivers.surveying import ReadWalks, survey_walks, trainable
from tickfix.evaluation.comparison.grounds import Ground, Walk
from tickfix.site.holdout import chains, is_held_out
from tickfix.site.site import Site

SPARE: Final = 0.3
"""Share of walks that development never looks at: what ``tickfix survey --holdout 0.3`` holds out."""


def folds(
    recordings: Sequence[Recording], count: int, spare: float = SPARE
) -> Mapping[str, tuple[tuple[str, ...], ...]]:
    """Return the names of the walks of each fold, by floor; walks without waypoints or of several floors are in none.

    Args:
        recordings: in any order.
        count: K, at least 2.
        spare: share of walks to leave alone.

    Raises:
        SiteError: for fewer than 2 folds, or a floor with fewer chains than folds.
    """
    if count < 2:
        raise SiteError(f"cross-validation: found {count} folds, expected at least 2")
    chain_of = chains(recordings)
    chains_on: defaultdict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for recording in recordings:
        chain = chain_of.get(recording.name)
        if chain is not None and recording.floor and not is_held_out(chain, spare):
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


def fold_grounds(
    read: ReadWalks,
    pipelines: Sequence[PipelineConfig],
    *,
    count: int,
    seed: int,
    spare: float = SPARE,
    progress: Progress,
    tell: Callable[[str], None],
) -> tuple[Ground, ...]:
    """Return a ground for each floor and fold, those of a floor with its name; sites are surveyed when asked for.

    Args:
        read: all walks of a building.
        pipelines: what is trained on each site.
        count, spare: see :func:`folds`.
        seed: of training.
        progress: shown while a site is surveyed.
        tell: told of what went wrong in a survey.

    Raises:
        SiteError: see :func:`folds`.
    """
    by_name = {recording.name: (Walk.of(source), source, recording) for source, recording in read.walks}
    plans = {floor.name: floor for floor in read.floors}
    learns = sorted(f"{choice.model} {choice.offer.version}" for choice in trainable(pipelines))
    grounds = []
    for floor, parts in folds([recording for _, recording in read.walks], count, spare).items():
        plan = plans.get(floor, Floor(name=floor))
        for i, part in enumerate(parts):
            learn = [name for j, other in enumerate(parts) if j != i for name in other]
            known = [by_name[name][0].sha256 for name in sorted(learn)]
            digest = sha256(json.dumps([known, learns, seed]).encode() + pack(plan)).hexdigest()
            lessons = [by_name[name][2] for name in learn]
            site = partial(_surveyed, lessons, plan, pipelines, f"{floor} without fold {i + 1}", seed, progress, tell)
            grounds.append(Ground(floor, digest, site, tuple(by_name[name][0] for name in part), (plan,)))
    return tuple(grounds)


def _surveyed(
    lessons: Sequence[Recording],
    plan: Floor,
    pipelines: Sequence[PipelineConfig],
    name: str,
    seed: int,
    progress: Progress,
    tell: Callable[[str], None],
) -> Site:
    def show(what: str, done: int, total: int) -> None:
        progress(f"{name}: {what}", done, total)

    surveyed = survey_walks(lessons, [plan], pipelines, name=name, seed=seed, progress=show)
    for problem in surveyed.problems:
        tell(f"{name}: {problem}")
    return surveyed.site
