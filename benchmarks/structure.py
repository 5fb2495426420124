"""Print the shape of a checkout: files, lines, importers, cycles, comments, and Python calls per device and tick.

    python benchmarks/structure.py                 # this checkout
    python benchmarks/structure.py ../old .        # two of them side by side, for instance before and after a change

Nothing of the checkout is imported for the first five: they are read from the source. Calls are counted by
``sys.setprofile`` while the checkout's own command replays one walk of its simulated office through one pipeline, in a
process of its own whose ``PYTHONPATH`` is that checkout, so an environment in which any tickfix is installed will do.
Counts do not depend on the machine. ``--no-calls`` leaves them out.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import statistics
import subprocess
import sys
import tempfile
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import numpy as np

ROOTS = ("core", "plugins/fingerprint", "plugins/pdr", "plugins/filters", "plugins/maps", "papers")


def modules(checkout: Path) -> dict[str, Path]:
    """Return the checkout's own modules by name, without tests."""
    found = {}
    for root in ROOTS:
        for path in sorted((checkout / root).rglob("*.py")):
            name = ".".join(path.relative_to(checkout / root).with_suffix("").parts)
            if name.startswith("tickfix") and ".tests." not in name:
                found[name.removesuffix(".__init__")] = path
    return found


def imported(tree: ast.AST, known: dict[str, Path]) -> Iterator[str]:
    """Yield the checkout's modules that a module imports, wherever the import stands."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module in known:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in known else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)


def cycles(imports: dict[str, set[str]]) -> list[list[str]]:
    """Return the sets of modules that import each other in a circle (Tarjan's strongly connected components)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(module: str) -> None:
        index[module] = low[module] = len(index)
        stack.append(module)
        for other in sorted(imports[module]):
            if other not in index:
                visit(other)
                low[module] = min(low[module], low[other])
            elif other in stack:
                low[module] = min(low[module], index[other])
        if low[module] == index[module]:
            component = stack[stack.index(module) :]
            del stack[stack.index(module) :]
            if len(component) > 1:
                found.append(sorted(component))

    for module in sorted(imports):
        if module not in index:
            visit(module)
    return found


def shape(checkout: Path) -> dict[str, str]:
    """Return the figures that can be read from the source."""
    known = modules(checkout)
    source = {name: path.read_text() for name, path in known.items()}
    trees = {name: ast.parse(text) for name, text in source.items()}
    imports = {name: {m for m in imported(tree, known) if m != name} for name, tree in trees.items()}
    importers: dict[str, set[str]] = defaultdict(set)
    for name, others in imports.items():
        for other in others:
            importers[other].add(name)
    inner = [name for name, path in known.items() if path.name != "__init__.py"]
    lines = {name: len(text.splitlines()) for name, text in source.items()}
    sizes = [lines[name] for name in inner]
    names: dict[str, int] = defaultdict(int)
    stems: dict[str, int] = defaultdict(int)
    for name, tree in trees.items():
        stems[known[name].name] += name in inner
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                names[node.name] += 1
    comments = sum(line.lstrip().startswith("#") for text in source.values() for line in text.splitlines())
    import_lines = sum(isinstance(n, ast.Import | ast.ImportFrom) for tree in trees.values() for n in ast.walk(tree))
    total = sum(lines.values())
    once = sum(len(importers[name]) == 1 for name in inner)
    return {
        "files": str(len(known)),
        "files without package faces": str(len(inner)),
        "lines": str(total),
        "lines of a file, median": str(round(statistics.median(sizes))),
        "lines of a file, greatest": str(max(sizes)),
        "files over 400 lines": str(sum(size > 400 for size in sizes)),
        "files under 40 lines": str(sum(size < 40 for size in sizes)),
        "files with one importer": f"{once} ({100 * once / len(inner):.0f} %)",
        "imports, share of lines": f"{100 * import_lines / total:.1f} %",
        "comment lines": str(comments),
        "import cycles": str(len(cycles(imports))),
        "class names used twice": str(sum(n > 1 for n in names.values())),
        "file names used twice": str(sum(n > 1 for n in stems.values())),
    }


def write_metadata(checkout: Path, folder: Path) -> None:
    """Write the metadata of a distribution that has the checkout's entry points."""
    project = tomllib.loads((checkout / "pyproject.toml").read_text())["project"]
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: tickfix\nVersion: 0\n")
    groups = [
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in points.items())
        for group, points in project["entry-points"].items()
    ]
    (folder / "entry_points.txt").write_text("\n".join(groups))


def calls(checkout: Path) -> dict[str, str]:
    """Count Python calls per device and tick, in a process that has this checkout's code."""
    paths = [str((checkout / root).resolve()) for root in ROOTS if (checkout / root).is_dir()]
    with tempfile.TemporaryDirectory() as folder:
        # First on the path, this stands in for the installed distribution: its entry points are this checkout's.
        write_metadata(checkout, Path(folder) / "tickfix-0.dist-info")
        search = os.pathsep.join([folder, *paths])
        environment = {**os.environ, "PYTHONPATH": search, "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, str(Path(__file__).resolve()), "--count", *paths]
        subprocess.run(command, cwd=folder, env=environment, check=True, stdout=sys.stderr)  # noqa: S603 - this file
        counted = json.loads((Path(folder) / "calls.json").read_text())
    return {
        f"calls per device and tick, {pipeline}": f"{found['calls']:.0f} in {found['files']} files"
        for pipeline, found in counted.items()
    }


PIPELINES = {
    "kalman": 'pdr = "steps"\nfingerprint = "wknn"\nfilter = "kalman"\n',
    "fusion": 'pdr = "steps"\nfingerprint = "wknn"\nfilter = "fusion-pf"\nmap = "walls"\n',
}


def write_floor(folder: Path) -> list[Path]:
    """Write a floor of 40 x 20 m with four survey walks, and return two more walks along the same route.

    The second is twice as long as the first, so that their difference is ticks alone.
    """
    rng = np.random.default_rng(7)
    beacons = np.array([(2, 2), (38, 2), (2, 18), (38, 18), (20, 10), (10, 10), (30, 10)], float)
    rooms = [(4, 4, 18, 9), (22, 4, 36, 9), (4, 11, 18, 16), (22, 11, 36, 16)]
    route = np.array([(2, 2), (20, 2), (20, 10), (38, 10), (38, 18), (2, 18), (2, 2)], float)
    legs = np.hypot(*np.diff(route, axis=0).T)
    ends = np.concatenate([[0.0], np.cumsum(legs)])

    def ring(x0: float, y0: float, x1: float, y1: float) -> dict[str, object]:
        corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]
        lonlat = [[24.0 + x / 55_800.0, 60.0 + y / 111_300.0] for x, y in corners]
        return {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [lonlat]}}

    def walk(path: Path, seconds: float, start_ms: int) -> Path:
        lines: list[tuple[int, str]] = []
        for t in np.arange(0.0, seconds, 0.02):
            leg = int(np.searchsorted(ends, 1.2 * t % ends[-1], side="right")) - 1
            dx, dy = route[leg + 1] - route[leg]
            heading, ms = np.arctan2(dx, dy), start_ms + round(t * 1000)
            a = 9.81 + 2.5 * np.sin(2 * np.pi * 1.8 * t)
            lines.append((ms, f"TYPE_ACCELEROMETER\t0.0\t0.0\t{a:.5f}\t3"))
            lines.append((ms, "TYPE_GYROSCOPE\t0.0\t0.0\t0.0\t3"))
            lines.append((ms, f"TYPE_ROTATION_VECTOR\t0.0\t0.0\t{np.sin(-heading / 2):.6f}\t3"))
        for t in np.arange(0.5, seconds, 2.0):
            along = 1.2 * t % ends[-1]
            leg = int(np.searchsorted(ends, along, side="right")) - 1
            xy = route[leg] + (route[leg + 1] - route[leg]) * (along - ends[leg]) / legs[leg]
            ms = start_ms + round(t * 1000)
            lines.append((ms, f"TYPE_WAYPOINT\t{xy[0]:.3f}\t{xy[1]:.3f}"))
            for n, beacon in enumerate(beacons):
                rssi = -40 - 25 * np.log10(max(1.0, np.hypot(*(xy - beacon)))) + rng.normal(0, 2)
                lines.append((ms, f"TYPE_WIFI\tnet\t02:00:00:00:00:{n:02x}\t{rssi:.0f}\t2412\t{ms - 100}"))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(f"{ms}\t{line}\n" for ms, line in sorted(lines, key=lambda x: x[0])))
        return path

    folder.mkdir(parents=True)
    (folder / "floor_info.json").write_text(json.dumps({"map_info": {"width": 40.0, "height": 20.0}}))
    features = [ring(0, 0, 40, 20), *(ring(*room) for room in rooms)]
    (folder / "geojson_map.json").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    for n in range(4):
        walk(folder / "path_data_files" / f"w{n}.txt", 90.0, 1_700_000_000_000 + n * 3_600_000)
    return [walk(Path("walks") / f"{n}.txt", 60.0 * n, 1_710_000_000_000) for n in (1, 2)]


def count(paths: list[str]) -> None:
    """Replay two walks through each pipeline with the command of these paths; write what a minute cost in calls."""
    from tickfix.cli.main import main  # noqa: PLC0415 - only in the process that counts

    def command(*arguments: str) -> None:
        sys.argv = ["tickfix", *arguments]
        try:
            main()
        except SystemExit as end:
            if end.code not in (0, None):
                raise

    walks = write_floor(Path("site1/F1"))
    command("survey", "site1/F1", "--out", "floor.site")
    result = {}
    for name, stages in PIPELINES.items():
        Path("pipeline.toml").write_text(f"[pipelines.{name}]\n{stages}")
        totals, files = [], []
        for walk in walks:
            counts: dict[str, int] = defaultdict(int)

            def profile(frame: FrameType, event: str, _: object, counts: dict[str, int] = counts) -> None:
                if event == "call":
                    counts[frame.f_code.co_filename] += 1

            out = f"{name}-{walk.stem}.jsonl"
            sys.setprofile(profile)
            try:
                command("replay", "floor.site", str(walk), "--config", "pipeline.toml", "--out", out)
            finally:
                sys.setprofile(None)
            # Of tickfix's own code; a tick's share of reading the recording and writing the track is in it.
            counts = {file: n for file, n in counts.items() if any(file.startswith(path) for path in paths)}
            totals.append((sum(counts.values()), len(Path(out).read_text().splitlines())))
            files.append(len(counts))
        (calls_1, ticks_1), (calls_2, ticks_2) = totals
        result[name] = {"calls": (calls_2 - calls_1) / (ticks_2 - ticks_1), "files": files[1]}
    Path("calls.json").write_text(json.dumps(result))


def main() -> None:
    """Print one column a checkout."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkouts", nargs="*", type=Path, default=[Path(__file__).resolve().parents[1]])
    parser.add_argument("--no-calls", action="store_true", help="read the source only")
    parser.add_argument("--count", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.count:
        count(options.count)
        return
    columns = [shape(path) | ({} if options.no_calls else calls(path)) for path in options.checkouts]
    for row in dict.fromkeys(key for column in columns for key in column):
        print(f"{row:36}" + "".join(f"{column.get(row, '-'):>22}" for column in columns))


if __name__ == "__main__":
    main()
