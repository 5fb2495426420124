"""From a simulated twin to pipelines that run on it. Algorithms are named in TOML only, as everywhere in the core."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from tickfix.api import Floor, Recording, SiteError
from tickfix.config import parse
from tickfix.drivers.surveying import survey_walks
from tickfix.evaluation.run import Bench, prepare
from tickfix.plugins import Registry


def survey_twin(
    recordings: Iterable[Recording],
    floors: Sequence[Floor],
    pipelines: str,
    registry: Registry,
    *,
    name: str,
    seed: int,
    spacing_m: float = 2.0,
    reach_m: float = 3.0,
    trained: bool = True,
) -> Bench:
    """Survey a twin and build pipelines for it.

    Args:
        recordings: of the survey, with truth.
        floors: of the twin.
        pipelines: a TOML configuration, see :mod:`tickfix.config`.
        registry: what the plugins offer.
        name: of the site; errors in the configuration name it, too.
        seed: of training and of the filters' random streams.
        spacing_m, reach_m: see :func:`tickfix.site.survey.survey`; points that a surveyor stood at stay as they are
            with a spacing below 0.7 of their distance and a reach of 0.
        trained: whether algorithms learn from the survey what they can; without, they run untrained.

    Raises:
        SiteError: when something cannot be trained.
        TickfixError: when a pipeline cannot be parsed or built.
    """
    parsed = parse(pipelines, name, registry)
    config = replace(parsed, kernel=replace(parsed.kernel, seed=seed))
    surveyed = survey_walks(
        recordings,
        floors,
        config.pipelines if trained else (),
        name=name,
        seed=seed,
        spacing_m=spacing_m,
        reach_m=reach_m,
    )
    if surveyed.problems:
        raise SiteError(f"{name}: {'; '.join(surveyed.problems)}")
    return prepare(surveyed.site, config)
