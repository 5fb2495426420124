"""``tickfix plugins`` tells what there is and what each takes."""

from __future__ import annotations

import json

from stored_floor import Command


def test_all_algorithms_are_listed_with_origin_and_version(tickfix: Command) -> None:
    version = tickfix("--version").stdout.split()[1]
    assert version.startswith("0.")
    rows = [line.split() for line in tickfix("plugins").stdout.splitlines()]
    for kind, name in (("filter", "fusion-pf"), ("pdr", "steps"), ("map", "walls"), ("reader", "indoor-location")):
        assert any(row[:4] == [kind, name, "tickfix", version] for row in rows)


def test_an_algorithm_is_shown_with_parameters_units_defaults_and_paper(tickfix: Command) -> None:
    text = tickfix("plugins", "show", "filter:fusion-pf").stdout
    for part in ("Source: [jiang2015]", "particles", "500", "integer ≥ 2", "m/√s", "number ≥ 0"):
        assert part in text
    shown = json.loads(tickfix("plugins", "show", "fusion-pf", "--json").stdout)
    (particles,) = [p for p in shown["parameters"] if p["name"] == "particles"]
    assert (particles["default"], particles["type"]) == (500, "integer ≥ 2")


def test_an_unknown_name_suggests_the_nearest(tickfix: Command) -> None:
    assert "Did you mean 'fusion-pf'?" in tickfix("plugins", "show", "filter:fusion-fp", code=2).stderr
