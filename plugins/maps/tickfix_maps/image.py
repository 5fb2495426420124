"""Map ``image``: map matching on an image matrix, [sun2013] section 3.2.

The floor is a matrix I_match: 1 where people walk, 0 building structure, −1 the walkways to which unreasonable places
are corrected. It is made of two drawings, the plan without and the one with walkways, eqs. (7)–(8); without drawings
the plan is rasterised from the floor's geometry, and without a drawing of walkways they are its medial axis. Of the
paper's numbers only T_threshold is printed; how large its pixels are is not.

Where the paper turns every answer into the middle of a pixel, a place that needs no correction is returned as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from matplotlib.image import imread
from scipy.spatial import cKDTree

from tickfix.api import BaseMap, Bools, Context, Floats, Floor, Ints, Preset, Trained, frozen, parameter
from tickfix_maps.plan_image import Matrix, binary, grey, matching_matrix, plan, walkways
from tickfix_maps.raster import passed


@dataclass(frozen=True)
class ImageParams:
    """Parameters of ``image``."""

    resolution_m: Annotated[
        float, parameter("side of a pixel where the plan is made from vector geometry", unit="m", gt=0)
    ] = 0.2
    t_threshold: Annotated[
        float, parameter("T_threshold: grey from which on a drawing is light", source="[sun2013] eq. (7)", ge=0, le=1)
    ] = 0.55
    passage_m: Annotated[
        float, parameter("walkways that nobody drew lie between walls at least this far apart", unit="m", gt=0)
    ] = 0.6
    plan: Annotated[
        str, parameter("drawing of the floor, structure dark; {floor} stands for its name", source="[sun2013] eq. (7)")
    ] = ""
    plan_with_walkways: Annotated[
        str, parameter("the same drawing with dark walkways; {floor} stands for its name", source="[sun2013] eq. (8)")
    ] = ""


class Image(BaseMap[ImageParams]):
    """A floor as pixels; a place inside structure, or beyond it, is corrected to the nearest walkway."""

    name = "image"
    source = "[sun2013] section 3.2, eqs. (7)–(8), figure 1"
    Params = ImageParams
    presets = {"sun2013": Preset(source="[sun2013] section 4.3.1", values={"t_threshold": 0.55})}  # noqa: RUF012

    def __init__(self, params: ImageParams, context: Context, trained: Trained | None = None) -> None:
        """Step 1 of the matching: create I_match of ``context.floor``."""
        super().__init__(params, context, trained)
        assert context.floor is not None  # noqa: S101 - maps are built per floor
        floor = context.floor
        self._origin, extent = _extent(floor)
        if params.plan:
            I_no_model = _drawing(params.plan, floor, params.t_threshold)
            self._origin, extent = np.zeros(2), np.array([floor.width_m, floor.height_m])
            if (extent <= 0).any():
                raise ValueError(f"map 'image': floor '{floor.name}' is {extent} m large, a drawing needs its size")
        else:
            columns, rows = np.ceil(extent / params.resolution_m).astype(int)
            I_no_model = plan(floor, self._origin, (rows, columns), params.resolution_m)
            extent = np.array([columns, rows]) * params.resolution_m
        self._pixel_m = extent / np.maximum(I_no_model.shape[::-1], 1)
        if params.plan_with_walkways:
            I_model = _drawing(params.plan_with_walkways, floor, params.t_threshold)
        else:
            apart = params.passage_m / float(self._pixel_m.min(initial=np.inf)) if I_no_model.size else 1.0
            I_model = I_no_model & ~walkways(I_no_model, max(1.0, apart)) if I_no_model.size else I_no_model
        self.I_match: Matrix = frozen(matching_matrix(I_model, I_no_model), np.int8)

    def contains(self, xy: Floats) -> Bools:
        """Tell for each point (n, 2) whether its pixel is no structure; a floor without geometry is all free."""
        column, row = np.floor(self._pixels(xy)).astype(np.int64).T
        return ~self._structure(row, column)

    def crosses(self, a: Floats, b: Floats) -> Bools:
        """Tell for each move (n, 2) → (n, 2) whether a pixel on its way is structure."""
        move, row, column = passed(self._pixels(a), self._pixels(b))
        crossed = np.zeros(len(a), dtype=np.bool_)
        crossed[move[self._structure(row, column)]] = True
        return crossed

    def nearest_free(self, xy: Floats) -> Floats:
        """Return for each point (n, 2) the middle of the nearest pixel that is no structure, itself where it is free."""
        blocked = ~self.contains(xy)
        if not blocked.any() or self._shore is None:
            return xy
        free = xy.copy()
        free[blocked] = self._shore.data[self._shore.query(xy[blocked])[1]]
        return free

    def snap(self, previous: Floats | None, xy: Floats) -> Floats:
        """Return U'ₙ (2,) for Uₙ = ``xy`` (2,), coming from Uₙ₋₁ = ``previous``: steps 2 to 6 of [sun2013] figure 1."""
        U_n = xy
        # Steps 2 and 3: is the place inside the structure? Step 4: is there structure between it and the last one?
        inside = bool(self.contains(U_n[None])[0])
        if inside and (previous is None or not self.crosses(previous[None], U_n[None])[0]):
            return U_n
        # Step 5: the walkway next to the midpoint; without a last place, next to the place itself.
        S_mid = U_n if previous is None else 0.5 * (previous + U_n)
        if self._walkways is None:
            free: Floats = self.nearest_free(S_mid[None])[0]
            return free
        corrected: Floats = self._walkways.data[self._walkways.query(S_mid)[1]].copy()
        return corrected  # step 6

    @cached_property
    def _walkways(self) -> cKDTree | None:
        """The walkways' pixels, None where there are none."""
        return self._tree(self.I_match == -1)

    @cached_property
    def _shore(self) -> cKDTree | None:
        """The free pixels beside structure or the edge: the nearest to any place that is not free is one of them."""
        free = np.pad(self.I_match != 0, 1)
        inner = free[2:, 1:-1] & free[:-2, 1:-1] & free[1:-1, 2:] & free[1:-1, :-2]
        return self._tree(free[1:-1, 1:-1] & ~inner)

    def _tree(self, chosen: Bools) -> cKDTree | None:
        row, column = np.nonzero(chosen)
        if len(row) == 0:
            return None
        return cKDTree(self._origin + (np.stack([column, row], axis=1) + 0.5) * self._pixel_m)

    def _pixels(self, xy: Floats) -> Floats:
        """Return points (n, 2) in pixels; one beyond the image stands just outside it, however far off it is."""
        if self.I_match.size == 0:
            return np.zeros_like(xy)
        limits = np.array(self.I_match.shape[::-1], dtype=np.float64)
        pixels: Floats = np.clip((xy - self._origin) / self._pixel_m, -limits - 1.0, 2.0 * limits + 1.0)
        return pixels

    def _structure(self, row: Ints, column: Ints) -> Bools:
        """Tell for each pixel whether it is building structure, as everything beyond the image is."""
        if self.I_match.size == 0:
            return np.zeros(len(row), dtype=np.bool_)
        rows, columns = self.I_match.shape
        known = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return ~known | (self.I_match[np.where(known, row, 0), np.where(known, column, 0)] == 0)


def _extent(floor: Floor) -> tuple[Floats, Floats]:
    """Return the south-west corner and the size, (2,) each, of a floor's drawing and all that is on it."""
    points = [np.array([[0.0, 0.0], [floor.width_m, floor.height_m]]) if floor.width_m > 0 else np.zeros((0, 2))]
    points += [floor.walls.reshape(-1, 2), *floor.outline, *floor.obstacles]
    corners = np.concatenate(points)
    if len(corners) == 0:
        return np.zeros(2), np.zeros(2)
    return corners.min(axis=0), corners.max(axis=0) - corners.min(axis=0)


def _drawing(path: str, floor: Floor, t_threshold: float) -> Bools:
    return binary(grey(np.asarray(imread(path.replace("{floor}", floor.name)))), t_threshold)
