"""Ultra-wideband ranges to known anchors: a source, a reader and a fingerprint."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from tickfix.api import (
    BaseFingerprint,
    Context,
    Event,
    Fix,
    Floats,
    Floor,
    Observation,
    ReaderError,
    Readings,
    Recording,
    Scan,
    Source,
    TrainedModel,
    Truth,
    Window,
    hookimpl,
    parameter,
)

UWB = Source(
    name="uwb",
    shape="readings",
    columns={"range_m": "m", "range_sigma_m": "m"},
    doc="Ultra-wideband ranges to anchors.",
)
_HEADER = re.compile(r"# uwb-range 1 device=(\S+) floor=(\S+)")
_MS = 1_000_000


class UwbRangeReader:
    """Reads walks with ranges to anchors (``.uwb``)."""

    kind: ClassVar[str] = "reader"
    name: ClassVar[str] = "uwb-range"

    def recordings(self, path: Path) -> Sequence[Path]:
        """Return the ``.uwb`` files at ``path``, sorted."""
        return sorted(path.rglob("*.uwb")) if path.is_dir() else [path] if path.suffix == ".uwb" else []

    def read(self, path: Path) -> Recording:
        """Read one file; lines that cannot be read are counted."""
        header, *lines = path.read_text("utf-8").splitlines() or [""]
        found = _HEADER.fullmatch(header)
        if found is None:
            raise ReaderError(f"{path}: found {header!r:.40}, expected '# uwb-range 1 device=NAME floor=NAME'")
        device, floor = found.groups()
        ranges: dict[int, list[tuple[str, float, float]]] = {}
        events: list[Event] = []
        rejected: Counter[str] = Counter()
        for line in lines:
            try:
                kind, t_ms, *rest = line.split()
                if kind == "range":
                    anchor, range_m, sigma_m = rest
                    ranges.setdefault(int(t_ms) * _MS, []).append((anchor, float(range_m), float(sigma_m)))
                else:
                    x, y = rest
                    events.append(Truth(t_ns=int(t_ms) * _MS, floor=floor, xy=[float(x), float(y)], device=device))
            except ValueError:
                rejected["broken line"] += 1
        for t_ns, readings in ranges.items():
            anchors, range_m, sigma_m = zip(*readings, strict=True)
            values = {"range_m": range_m, "range_sigma_m": sigma_m}
            heard_ns = np.full(len(anchors), t_ns)
            events.append(Scan(transmitters=anchors, heard_ns=heard_ns, source="uwb", values=values, device=device))
        events.sort(key=lambda event: event.arrival_ns)
        return Recording(name=path.stem, floor=floor, events=tuple(events), rejected=dict(rejected), path=path)

    def floor(self, path: Path) -> Floor | None:
        """Return None: the format knows no plan."""
        return None


@dataclass(frozen=True)
class UwbRangeParams:
    """Parameters of ``uwb-range``."""

    anchors: Annotated[str, parameter("CSV file: anchor,floor,x_m,y_m")] = ""
    max_age_s: Annotated[float, parameter("greatest age of a range", unit="s", gt=0)] = 1.0


@dataclass(frozen=True)
class UwbRangeState:
    """The last place found, (2,) metres, from which the next search starts."""

    xy: Floats | None = None


class UwbRange(BaseFingerprint[UwbRangeParams]):
    """Multilateration: the place whose distances to the anchors agree best with the ranges."""

    name = "uwb-range"
    Params = UwbRangeParams
    State = UwbRangeState

    def __init__(self, params: UwbRangeParams, context: Context, trained: TrainedModel | None = None) -> None:
        """Read the anchors."""
        super().__init__(params, context, trained)
        self._anchors: Mapping[str, tuple[str, Floats]] = {}
        if params.anchors:
            with Path(params.anchors).open(newline="", encoding="utf-8") as file:
                self._anchors = {
                    row["anchor"]: (row["floor"], np.array([float(row["x_m"]), float(row["y_m"])]))
                    for row in csv.DictReader(file)
                }

    @property
    def window(self) -> Window:
        """The last ranges to each anchor."""
        return Window(seconds=self.params.max_age_s, sources=("uwb",))

    def start(self) -> UwbRangeState:
        """Return the state before the first scan."""
        return UwbRangeState()

    def step(self, state: UwbRangeState, window: Readings) -> tuple[UwbRangeState, Observation]:
        """Turn the ranges into a likelihood, and into a fix where three anchors of a floor were heard."""
        newest = {
            anchor: (range_m, sigma_m)
            for anchor, range_m, sigma_m in zip(
                window.transmitters, window.values["range_m"], window.values["range_sigma_m"], strict=True
            )
            if anchor in self._anchors and np.isfinite(range_m) and sigma_m > 0
        }
        floors = Counter(self._anchors[anchor][0] for anchor in newest)
        if not floors:
            return state, Observation(t_ns=window.t_ns, source=self.name)
        floor = min(floors, key=lambda name: (-floors[name], name))
        used = [anchor for anchor in newest if self._anchors[anchor][0] == floor]
        places = np.array([self._anchors[anchor][1] for anchor in used])
        ranges, sigmas = np.array([newest[anchor] for anchor in used]).T

        def log_likelihood(at: str, xy: Floats) -> Floats:
            residuals = (np.hypot(*(xy[:, None] - places).transpose(2, 0, 1)) - ranges) / sigmas
            found: Floats = -0.5 * (residuals**2).sum(axis=1)
            return found if at == floor else np.full(len(xy), -np.inf)

        fix = None
        if len(used) >= 3:
            start = places.mean(axis=0) if state.xy is None else state.xy
            xy, covariance = _multilaterate(start, places, ranges, sigmas)
            state = UwbRangeState(xy)
            fix = Fix(t_ns=window.t_ns, floor=floor, xy=xy, covariance=covariance, source=self.name)
        return state, Observation(t_ns=window.t_ns, source=self.name, fix=fix, log_likelihood=log_likelihood)


def _multilaterate(xy: Floats, places: Floats, ranges: Floats, sigmas: Floats) -> tuple[Floats, Floats]:
    """Return the least-squares place (2,) and its covariance (2, 2), by ten steps of Gauss and Newton."""
    for _ in range(10):
        way = xy - places
        distance = np.maximum(np.hypot(*way.T), 1e-6)
        jacobian = way / distance[:, None] / sigmas[:, None]
        information = jacobian.T @ jacobian + 1e-9 * np.eye(2)
        xy = xy - np.linalg.solve(information, jacobian.T @ ((distance - ranges) / sigmas))
    covariance = np.linalg.inv(information)
    return xy, 0.5 * (covariance + covariance.T)


@hookimpl
def tickfix_register() -> list[type[Any]]:
    """Offer the reader and the fingerprint."""
    return [UwbRangeReader, UwbRange]


@hookimpl
def tickfix_sources() -> list[Source]:
    """Declare the ranges."""
    return [UWB]
