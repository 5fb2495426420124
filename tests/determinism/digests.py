"""Prints the digests of every registered filter on the small lab: run by a test in processes of its own."""

from __future__ import annotations

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "property"))

from lab import fold, small_lab


def main() -> None:
    """Fold the walk with all pipelines, in the order asked for."""
    lab = small_lab()
    backwards = "backwards" in sys.argv
    pipelines = sorted(lab.pipelines.values(), key=lambda p: p.name, reverse=backwards)
    folded = fold(pipelines, lab.events)
    device = lab.events[0].device
    digests = {p.name: [folded.said(device, p.name), folded.settled_as(device, p.name)] for p in pipelines}
    sys.stdout.write(json.dumps(digests, sort_keys=True))


if __name__ == "__main__":
    main()
