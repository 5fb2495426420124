"""The tables of [jiang2015] with the paper's figures beside ours, and its claims, each decided by a difference over
seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, TypeVar

import numpy as np

from tickfix.api import Floats
from tickfix_papers.jiang2015.seed_run import GIVEN_SIGMA_M, SeedRun
from tickfix_papers.reproduction_report import Claim, PaperTable, TableCell
from tickfix_papers.seed_statistics import decide_claim, mean, paired_difference, table_row

WINDOWS: Final = {
    200: (0.3001, 25.0529),
    400: (0.4020, 27.8570),
    600: (0.4158, 26.8727),
    800: (0.4642, 26.5759),
    1000: (0.4435, 26.4503),
}
"""[jiang2015] Table 3: velocity and orientation."""
METHODS: Final = {
    "gait + PF": ("gait-pf", "", 1.542),
    "ELM": ("elm", "own-elm", 0.609),
    "ELM, heading as sine and cosine": ("vector-elm", "", None),
    "ELM + KF": ("elm-kf", "own-elm-kf", 0.829),
    "ELM + PF": ("elm-pf", "own-elm-pf", 0.633),
    "ELM + Wi-Fi + PF": ("elm-wifi-pf", "own-elm-wifi-pf", 0.150),
    "ELM + Wi-Fi + own PF": ("", "own-fusion", None),
}
"""[jiang2015] Table 4: pipeline as printed, with tickfix's own settings, and the paper's mean error in metres."""
WIFI: Final = {"KNN": "wifi-knn", "ELM": "wifi-elm", "ELM + KF": "wifi-elm-kf", "ELM + PF": "wifi-elm-pf"}
RATES: Final = {"Wi-Fi alone": ("wifi-elm", 4.5), "ELM + Wi-Fi + PF": ("elm-wifi-pf", 0.2)}


def result_tables(runs: Sequence[SeedRun]) -> tuple[PaperTable, ...]:
    """Return all tables."""
    return _window_table(runs), _method_table(runs), _wifi_table(runs), _rate_table(runs), _given_fix_table(runs)


def velocity_rms(run: SeedRun, window_ms: int) -> float:
    """Return the root of the velocity's mean square error, m/s."""
    return float(np.sqrt(run.window_mse[window_ms][0]))


def heading_rms(run: SeedRun, window_ms: int) -> float:
    """Return the root of the orientation's mean square error, degrees."""
    return float(np.degrees(np.sqrt(run.window_mse[window_ms][1])))


def _window_table(runs: Sequence[SeedRun]) -> PaperTable:
    return PaperTable(
        name="Table 3",
        caption="errors of velocity and orientation by window length, ten-fold cross-validation",
        columns=("velocity, m/s", "orientation, °"),
        rows={
            f"{window_ms} ms": table_row(
                [[rms(run, window_ms) for run in runs] for rms in (velocity_rms, heading_rms)], paper
            )
            for window_ms, paper in WINDOWS.items()
        },
        decimals=(3, 1),
        note="The paper calls its figures mean square errors in degrees; ours are the roots, to which its units fit.",
    )


def _method_table(runs: Sequence[SeedRun]) -> PaperTable:
    def ours(pipeline: str, paper: float | None = None) -> TableCell:
        return TableCell(paper=paper, ours=mean([run.mean_error_m(pipeline) for run in runs]) if pipeline else None)

    return PaperTable(
        name="Table 4",
        caption="mean error of methods that use motion, m",
        columns=("as printed", "own settings"),
        rows={label: (ours(printed, paper), ours(own)) for label, (printed, own, paper) in METHODS.items()},
        note="Own settings: tickfix's defaults of the regression. They take the heading as sine and cosine, choose the "
        "hidden nodes by folds that keep walks together, regularise more, and let a phone at rest stay. Rows without a "
        "figure of the paper were added after a first look.",
    )


def _wifi_table(runs: Sequence[SeedRun]) -> PaperTable:
    rows = {}
    for label, pipeline in WIFI.items():
        median = [float(np.median(np.concatenate([t.fix_error_m for t in run.tracks[pipeline]]))) for run in runs]
        rows[label] = table_row([[run.mean_fix_error_m(pipeline) for run in runs], median])
    return PaperTable(
        name="Fig. 14",
        caption="error of location results of Wi-Fi alone, m",
        columns=("mean", "median"),
        rows=rows,
        note="The figure is drawn in the paper, without numbers.",
    )


def _rate_table(runs: Sequence[SeedRun]) -> PaperTable:
    return PaperTable(
        name="Fig. 17",
        caption="time from one position to the next, s",
        columns=("mean",),
        rows={
            label: table_row([[update_interval_s(run, pipeline) for run in runs]], [paper])
            for label, (pipeline, paper) in RATES.items()
        },
        note="The twin scans about every 2 s, as sections 2 and 7 print; Fig. 17 shows 4.5 s.",
    )


def update_interval_s(run: SeedRun, pipeline: str) -> float:
    """Return the mean time from one published position to the next, seconds."""
    return float(np.mean([track.update_interval_s for track in run.tracks[pipeline]]))


def _given_fix_table(runs: Sequence[SeedRun]) -> PaperTable:
    return PaperTable(
        name="How good Wi-Fi must be",
        caption="mean error of ELM + Wi-Fi + PF, m, with location results of a given error instead of Wi-Fi's",
        columns=("as printed", "own settings"),
        rows={
            f"σ {sigma_m:g} m, off by {sigma_m * np.sqrt(np.pi / 2.0):.2f} m": table_row(
                [[run.given[sigma_m][pipeline] for run in runs] for pipeline in ("elm-wifi-pf", "own-elm-wifi-pf")]
            )
            for sigma_m in GIVEN_SIGMA_M
        },
        note="Not in the paper, and added after a first look: fixes are drawn around the true place of their scan.",
    )


Name = TypeVar("Name")
_MIN_REDUCTION_M: Final = 0.05
"""A mean error that falls by less counts as unchanged."""
_FILTER_PHRASES: Final = {"ELM + KF": "KF after ELM", "ELM + PF": "PF after ELM"}


def decided_claims(runs: Sequence[SeedRun]) -> tuple[Claim, ...]:
    """Return all claims."""
    return (
        *_window_claims(runs),
        *_motion_claims(runs),
        *_wifi_claims(runs),
        *_fusion_claims(runs),
        *_rate_claims(runs),
    )


def _window_claims(runs: Sequence[SeedRun]) -> tuple[Claim, ...]:
    found = []
    kinds: tuple[tuple[str, str, int, Callable[[SeedRun, int], float]], ...] = (
        ("velocity", "m/s", 0, velocity_rms),
        ("orientation", "°", 1, heading_rms),
    )
    for what, unit, i, rms in kinds:
        by_window = {ms: np.array([rms(run, ms) for run in runs]) for ms in WINDOWS}
        other = _smallest_mean({ms: values for ms, values in by_window.items() if ms != 200})
        paper = min(values[i] for ms, values in WINDOWS.items() if ms != 200)
        found.append(
            decide_claim(
                f"200 ms is the best window for the {what}",
                paired_difference(by_window[other], by_window[200]),
                paper=f"{WINDOWS[200][i]:#.4g} against {paper:#.4g} {unit} for the next best",
                ours=f"{by_window[200].mean():#.3g} against {by_window[other].mean():#.3g} {unit} for {other} ms",
                above=0.0,
                why="The plain angle jumps at due south; what it errs there outweighs all that windows change",
            )
        )
    return tuple(found)


def _motion_claims(runs: Sequence[SeedRun]) -> tuple[Claim, ...]:
    gait, elm, kf, pf = (_mean_errors_m(runs, name) for name in ("gait-pf", "elm", "elm-kf", "elm-pf"))
    own, own_kf, own_pf = (_mean_errors_m(runs, name) for name in ("own-elm", "own-elm-kf", "own-elm-pf"))
    bends, kf_bends = (
        np.array([1e3 * np.mean([track.second_difference_m for track in run.tracks[name]]) for run in runs])
        for name in ("elm", "elm-kf")
    )
    return (
        _smaller_error_claim(
            "ELM is better than gait, as printed",
            elm,
            gait,
            paper="0.609 against 1.542 m",
            why="A plain angle is regressed, which jumps at due south: where features indicate nearly south, the "
            "result is a mean of +180° and −180°, anything but south. Table 4 has a row for sine and cosine "
            "alone; 1000 nodes with next to no ridge account for the rest",
        ),
        _smaller_error_claim(
            "ELM is better than gait, with tickfix's settings of the regression",
            own,
            gait,
            paper="0.609 against 1.542 m",
        ),
        decide_claim(
            "KF after ELM makes the track smoother",
            paired_difference(bends, kf_bends),
            paper="in words",
            ours=f"{kf_bends.mean():.0f} against {bends.mean():.0f} mm of departure per tick from a straight, steady "
            "track",
            above=0.0,
        ),
        decide_claim(
            f"KF after ELM does not lower the mean error (by {_MIN_REDUCTION_M:g} m or more)",
            paired_difference(kf, elm),
            paper="0.829 against 0.609 m",
            ours=f"{_error_pair(kf, elm)}, with own settings {_error_pair(own_kf, own)}",
            above=-_MIN_REDUCTION_M,
        ),
        _smaller_error_claim(
            "PF after ELM lowers the mean error (so the text; not so its table)",
            pf,
            elm,
            paper="0.633 against 0.609 m",
            more=f", with own settings {_error_pair(own_pf, own)}",
            why="The table is right: weighted by the position predicted from motion, particles hold no information "
            "beyond motion, and sampling them adds noise that accumulates",
        ),
    )


def _wifi_claims(runs: Sequence[SeedRun]) -> tuple[Claim, ...]:
    errors = {label: np.array([run.mean_fix_error_m(pipeline) for run in runs]) for label, pipeline in WIFI.items()}

    def nearer(label: str, than: str, why: str = "") -> Claim:
        claim = f"Wi-Fi alone: {_FILTER_PHRASES.get(label, label)} is better than {_FILTER_PHRASES.get(than, than)}"
        return _smaller_error_claim(claim, errors[label], errors[than], paper="Fig. 14, no numbers", why=why)

    return (
        nearer(
            "ELM",
            "KNN",
            "The classifier has four samples of a point to learn from and does not know which points are neighbours: "
            "its four best classes lie further apart than the four nearest fingerprints",
        ),
        nearer("ELM + KF", "ELM"),
        nearer(
            "ELM + PF",
            "ELM",
            "Without motion the particles of (16) stand still and only diffuse: they lag behind a walker, since (16) "
            "to (19) have no velocity",
        ),
        nearer("ELM + PF", "ELM + KF", "The Kalman filter estimates a velocity, the particles of (16) do not"),
    )


def _fusion_claims(runs: Sequence[SeedRun]) -> tuple[Claim, ...]:
    growth = {
        name: np.array([np.mean([track.error_growth_m for track in run.tracks[name]]) for run in runs])
        for name in ("elm", "elm-wifi-pf")
    }
    errors = {label: _mean_errors_m(runs, printed) for label, (printed, *_) in METHODS.items() if printed}
    fused = errors.pop("ELM + Wi-Fi + PF")
    other = _smallest_mean(errors)
    wifi = np.mean([run.mean_fix_error_m("wifi-elm") for run in runs])
    why = (
        f"A Wi-Fi result is off by {wifi:.1f} m on the twin, and (18) with σ = 0.5 m weights it as if it were off by "
        "0.6 m; the last table shows how good it would have to be"
    )
    return (
        decide_claim(
            "the fused filter removes the accumulation of errors",
            paired_difference(growth["elm"], growth["elm-wifi-pf"]),
            paper="Fig. 16, no numbers",
            ours="from the second to the last quarter of a walk its error grows by "
            f"{growth['elm-wifi-pf'].mean():.2f} m, that of ELM alone by {growth['elm'].mean():.2f} m",
            above=0.0,
        ),
        _smaller_error_claim(
            "the fused filter is the best of all",
            fused,
            errors[other],
            paper="0.150 against 0.609 m for ELM, the next best",
            more=f" for {other}",
            why=why,
        ),
        _smaller_error_claim(
            "the fused filter is better than ELM alone",
            fused,
            errors["ELM"],
            paper="0.150 against 0.609 m",
            why=why,
        ),
        _given_fix_claim(runs, 0.5),
    )


def _given_fix_claim(runs: Sequence[SeedRun], sigma_m: float) -> Claim:
    """Return the paper's main claim, for location results as good as its filter takes them to be."""
    fused = np.array([run.given[sigma_m]["own-elm-wifi-pf"] for run in runs])
    rivals = {label: own or printed for label, (printed, own, _) in METHODS.items() if "Wi-Fi" not in label}
    others = {label: _mean_errors_m(runs, pipeline) for label, pipeline in rivals.items()}
    other = _smallest_mean(others)
    return _smaller_error_claim(
        f"the fused filter is the best of all where Wi-Fi errs by σ = {sigma_m:g} m, with own settings",
        fused,
        others[other],
        paper="0.150 against 0.609 m for ELM, the next best",
        more=f" for {other}",
    )


def _rate_claims(runs: Sequence[SeedRun]) -> tuple[Claim, ...]:
    wifi, fused = (np.array([update_interval_s(run, name) for run in runs]) for name in ("wifi-elm", "elm-wifi-pf"))
    return (
        decide_claim(
            "Wi-Fi alone gives a position every few seconds",
            mean(wifi),
            paper="4.5 s in Fig. 17, about 2 s in sections 2 and 7",
            ours=f"{wifi.mean():.2f} s",
            above=1.0,
            below=10.0,
        ),
        decide_claim(
            "fused, there is a position every 200 ms",
            mean(fused),
            paper="0.2 s",
            ours=f"{fused.mean():.3f} s",
            above=0.195,
            below=0.205,
        ),
    )


def _smaller_error_claim(
    claim: str, errors_m: Floats, than_m: Floats, *, paper: str, more: str = "", why: str = ""
) -> Claim:
    """Return the claim that errors are smaller than others, (seeds,) metres each; ``more`` follows ours."""
    ours = f"{_error_pair(errors_m, than_m)}{more}"
    return decide_claim(claim, paired_difference(than_m, errors_m), paper=paper, ours=ours, above=0.0, why=why)


def _error_pair(errors_m: Floats, than_m: Floats) -> str:
    return f"{errors_m.mean():.2f} against {than_m.mean():.2f} m"


def _mean_errors_m(runs: Sequence[SeedRun], pipeline: str) -> Floats:
    return np.array([run.mean_error_m(pipeline) for run in runs])


def _smallest_mean(values: Mapping[Name, Floats]) -> Name:
    return min(values, key=lambda name: float(values[name].mean()))
