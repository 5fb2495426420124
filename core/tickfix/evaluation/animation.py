"""A walk as it happened: a dot for each pipeline moves over the floor plan, and truth with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from tickfix.api import Floats, Floor, Truth
from tickfix.evaluation.plan import crop, draw_plan
from tickfix.evaluation.style import INK, SETTINGS, lines, printable
from tickfix.evaluation.track import Track

_WIDTH_IN: Final = 6.0
_DPI: Final = 90
_TAIL_S: Final = 8.0
_COLOURS: Final = 64


def animate_walk(
    floor: Floor,
    truth: Sequence[Truth],
    tracks: Mapping[str, Track],
    path: Path,
    *,
    title: str = "",
    every_s: float = 0.6,
    faster: float = 6.0,
) -> None:
    """Write an animated GIF of the published tracks of one walk on one floor.

    Args:
        floor: the plan.
        truth: waypoints; between them the true dot walks straight.
        tracks: by pipeline.
        path: the file to write.
        title: above the picture.
        every_s: device time between two frames.
        faster: how much faster than it happened it plays.
    """
    waypoints = [w for w in sorted(truth, key=lambda w: w.t_ns) if w.floor == floor.name]
    if not waypoints:
        return
    t_s = np.array([w.t_ns for w in waypoints]) * 1e-9
    way = np.array([w.xy for w in waypoints])
    moments = np.arange(t_s[0], t_s[-1] + every_s, every_s)
    places = {"truth": np.column_stack([np.interp(moments, t_s, way[:, axis]) for axis in (0, 1)])}
    places |= {name: _at(track, floor.name, moments) for name, track in tracks.items()}
    low, high = crop(way, np.concatenate([xy[np.isfinite(xy).all(axis=1)] for xy in places.values()]))
    tail = round(_TAIL_S / every_s)
    with mpl.rc_context(SETTINGS):
        figure = Figure(figsize=(_WIDTH_IN, _WIDTH_IN * float((high - low)[1] / (high - low)[0]) + 0.7), dpi=_DPI)
        canvas: Any = FigureCanvasAgg(figure)  # its methods are untyped
        axes = figure.add_axes((0.09, 0.09, 0.88, 0.84))
        draw_plan(axes, floor)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x, m", ylabel="y, m")
        axes.set_title(printable(title))
        looks = [(INK, 1.0), *((look.color, look.width) for look in lines(len(tracks)))]
        tails = [axes.plot([], [], color=c, linewidth=w, alpha=0.7, animated=True, zorder=6)[0] for c, w in looks]
        dots = [
            axes.plot([], [], "o", color=c, markersize=6, markeredgecolor="white", animated=True, zorder=7)[0]
            for c, _ in looks
        ]
        axes.legend(dots, list(places), loc="upper right", ncols=len(places), handletextpad=0.1, columnspacing=0.8)
        canvas.draw()
        background = canvas.copy_from_bbox(figure.bbox)
        frames = []
        for now in range(len(moments)):
            canvas.restore_region(background)
            for xy, line, dot in zip(places.values(), tails, dots, strict=True):
                line.set_data(*xy[max(0, now - tail) : now + 1].T)
                dot.set_data(*xy[now : now + 1].T)
                axes.draw_artist(line)
                axes.draw_artist(dot)
            picture = Image.frombuffer("RGBA", canvas.get_width_height(), canvas.buffer_rgba().tobytes())
            frames.append(picture.convert("RGB").quantize(_COLOURS))
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=round(1000 * every_s / faster), loop=0, optimize=False
    )


def _at(track: Track, floor: str, moments: Floats) -> Floats:
    """Return where the track said the device was at each moment (n, 2), NaN where it said nothing on this floor."""
    said = [e for e in track.estimates if e.belief is not None and e.belief.floor == floor]
    places = np.full((len(moments), 2), np.nan)
    if said:
        t_s = np.array([e.t_ns for e in said]) * 1e-9
        last = np.searchsorted(t_s, moments, side="right") - 1
        known = last >= 0
        places[known] = np.array([e.belief.xy for e in said if e.belief is not None])[last[known]]
    return places
