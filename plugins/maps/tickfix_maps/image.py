"""Map ``image``: map matching on an image matrix, [sun2013] section 3.2.

The floor is a matrix I_match: 1 where people walk, 0 building structure, -1 the walkways to which infeasible positions
are corrected. It is computed from two drawings, the plan without and with walkways, eqs. (7)-(8); without drawings the
plan is rasterised from the floor's geometry and the walkways are its medial axis, by [hesselink2008] Hesselink and
Roerdink, "Euclidean skeletons of digital image and volume data in linear time by the integer medial axis transform",
IEEE Trans. PAMI 30 (2008). Only T_threshold is printed; the pixel size is not. The paper returns the centre of a pixel
always; here a position that needs no correction is returned unchanged. The walkway next to the midpoint may lie in
another room than the last position: as printed, that is where one goes; by default it is the next one reachable from
the last position in a straight line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Final, TypeAlias

import numpy as np
from matplotlib.image import imread
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from tickfix.api import BaseMap, Bools, Context, Floats, Floor, Preset, TrainedModel, frozen, parameter
from tickfix_maps.raster import clip_moves, rasterise_rings, rasterise_segments, traverse_pixels

MatchingMatrix: TypeAlias = NDArray[np.int8]


def to_greyscale(image: NDArray[Any]) -> Floats:
    """Return an image (h, w) or (h, w, 3 or 4), top row first, integers or 0 … 1, as grey 0 … 1, south row first."""
    scale = float(np.iinfo(image.dtype).max) if image.dtype.kind in "iu" else 1.0
    values = image.astype(np.float64) / scale
    if values.ndim == 3:
        values = values[..., 0] if values.shape[2] < 3 else values[..., :3] @ np.array([0.299, 0.587, 0.114])
    return np.ascontiguousarray(values[::-1])


def threshold_image(G: Floats, t_threshold: float) -> Bools:
    """Return which pixels of a grey image (h, w) are light, [sun2013] eq. (7)."""
    I: Bools = t_threshold <= G  # noqa: E741 - the paper's symbol
    return I


def matching_matrix(I_model: Bools, I_no_model: Bools) -> MatchingMatrix:
    """Return I_match (h, w) of the plans with and without walkways, both 1 where it is light, [sun2013] eq. (8)."""
    if I_model.shape != I_no_model.shape:
        raise ValueError(f"plan with walkways: found {I_model.shape} pixels, expected {I_no_model.shape} as the plan")
    I_match: MatchingMatrix = I_no_model.astype(np.int8) - np.int8(2) * (I_model ^ I_no_model).astype(np.int8)
    # A walkway drawn lighter than structure it covers would give −2: there the building wins.
    return np.where(I_no_model, I_match, np.int8(0))


def rasterise_floor(floor: Floor, origin: Floats, shape: tuple[int, int], pixel_m: float) -> tuple[Bools, Bools]:
    """Return I_no_model (h, w) of a floor's vector geometry, south row first, from ``origin`` (2,) on, and its lines.

    The lines (h, w) are walls and edges: a move crosses these, while one within an obstacle or off the floor does not.
    """
    outline, obstacles = ([(ring - origin) / pixel_m for ring in rings] for rings in (floor.outline, floor.obstacles))
    free = rasterise_rings(outline, shape, union=False) if outline else np.ones(shape, dtype=np.bool_)
    free &= ~rasterise_rings(obstacles, shape, union=True)
    edges = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in (*outline, *obstacles)]
    lines = rasterise_segments(np.concatenate([(floor.walls - origin) / pixel_m, *edges]), shape)
    return free & ~lines, lines


def medial_axis(free: Bools, apart: float) -> Bools:
    """Return the medial axis (h, w) of the free pixels, [hesselink2008] eq. (2), pruned to what lies between walls.

    Args:
        free: where people walk; what lies beyond the edge is structure.
        apart: least distance in pixels between the two nearest walls of a pixel on the axis, at least 1.
    """
    padded = np.pad(free, 1)
    feature = ndimage.distance_transform_edt(padded, return_distances=False, return_indices=True).astype(np.int32)
    axis = np.zeros(padded.shape, dtype=np.bool_)
    here = np.indices(padded.shape, dtype=np.int32)
    for along in (0, 1):
        p = (slice(None),) * (along + 1) + (slice(None, -1),)
        q = (slice(None),) * (along + 1) + (slice(1, None),)
        between = feature[q] - feature[p]
        far = (between**2).sum(axis=0) > apart**2
        # Of two neighbours, the one nearer to the bisector of their walls is on the axis.
        side = (between * (feature[p] + feature[q] - here[p] - here[q])).sum(axis=0)
        axis[p[1:]] |= far & (side <= 0)
        axis[q[1:]] |= far & (side >= 0)
    found: Bools = (axis & padded)[1:-1, 1:-1]
    return found


_WALKWAY_CANDIDATES: Final = 128  # walkway pixels looked at, to find one that can be reached


@dataclass(frozen=True)
class ImageParams:
    """Parameters of ``image``."""

    resolution_m: Annotated[
        float, parameter("side of a pixel where the plan is made from vector geometry", unit="m", gt=0)
    ] = 0.2
    t_threshold: Annotated[
        float, parameter("T_threshold: grey from which on a drawing is light", source="[sun2013] eq. (7)", ge=0, le=1)
    ] = 0.55
    min_passage_width_m: Annotated[
        float,
        parameter(
            "walkways that are not drawn lie between walls at least this far apart",
            unit="m",
            gt=0,
            formerly="passage_m",
        ),
    ] = 0.6
    snap_across_walls: Annotated[
        bool,
        parameter(
            "a correction may lie behind a wall, as printed",
            source="[sun2013] figure 1, step 5",
            formerly="beyond_walls",
        ),
    ] = False
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
    presets: ClassVar[Mapping[str, Preset]] = {
        "sun2013": Preset(source="[sun2013] section 4.3.1", values={"t_threshold": 0.55, "snap_across_walls": True})
    }

    def __init__(self, params: ImageParams, context: Context, trained: TrainedModel | None = None) -> None:
        """Step 1 of the matching: create I_match of ``context.floor``."""
        super().__init__(params, context, trained)
        assert context.floor is not None  # noqa: S101 - maps are built per floor
        floor = context.floor
        self._bounded = bool(params.plan or floor.outline)
        if params.plan:
            I_no_model = _read_drawing(params.plan, floor, params.t_threshold)
            self._origin, extent = np.zeros(2), np.array([floor.width_m, floor.height_m])
            if (extent <= 0).any():
                raise ValueError(f"map 'image': floor '{floor.name}' is {extent} m large, a drawing needs its size")
            # Whatever leaves a drawing passes its edge.
            self._lines = frozen(np.pad(~I_no_model, 1, constant_values=True), np.bool_)
        else:
            self._origin, extent = _drawing_extent(floor, params.resolution_m)
            columns, rows = np.ceil(extent / params.resolution_m).astype(int)
            I_no_model, lines = rasterise_floor(floor, self._origin, (rows, columns), params.resolution_m)
            extent = np.array([columns, rows]) * params.resolution_m
            self._lines = frozen(np.pad(lines, 1), np.bool_)
        self._pixel_m = extent / np.maximum(I_no_model.shape[::-1], 1)
        if params.plan_with_walkways:
            I_model = _read_drawing(params.plan_with_walkways, floor, params.t_threshold)
        else:
            apart = params.min_passage_width_m / float(self._pixel_m.min(initial=np.inf)) if I_no_model.size else 1.0
            I_model = I_no_model & ~medial_axis(I_no_model, max(1.0, apart)) if I_no_model.size else I_no_model
        self.I_match: MatchingMatrix = frozen(matching_matrix(I_model, I_no_model), np.int8)

    def contains(self, xy: Floats) -> Bools:
        """Return for each point (n, 2) whether its pixel is no structure; a floor without geometry is all free."""
        if self.I_match.size == 0:
            return np.ones(len(xy), dtype=np.bool_)
        pixels, (rows, columns) = self._pixels(xy), self.I_match.shape
        known = (pixels >= 0.0).all(axis=1) & (pixels[:, 0] < columns) & (pixels[:, 1] < rows)
        column, row = np.where(known[:, None], pixels, 0.0).astype(np.int64).T
        free: Bools = self.I_match[row, column] != 0
        return np.where(known, free, not self._bounded)

    def crosses(self, a: Floats, b: Floats) -> Bools:
        """Return for each move (n, 2) → (n, 2) whether it passes a pixel of a wall or an edge."""
        crossed = np.zeros(len(a), dtype=np.bool_)
        if self.I_match.size == 0:
            return crossed
        p, q, over = clip_moves(self._pixels(a) + 1.0, self._pixels(b) + 1.0, self._lines.shape)
        move, row, column = traverse_pixels(p, q)
        rows, columns = self._lines.shape
        # Ends on the far edges are outside by a hair.
        crossed[over[move[self._lines[np.minimum(row, rows - 1), np.minimum(column, columns - 1)]]]] = True
        return crossed

    def nearest_free(self, xy: Floats) -> Floats:
        """Return for each point (n, 2) the middle of the nearest pixel that is free, itself where it is free."""
        blocked = ~self.contains(xy)
        if not blocked.any() or self._border_tree is None:
            return xy
        free = xy.copy()
        free[blocked] = self._border_tree.data[self._border_tree.query(xy[blocked])[1]]
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
        if self._walkway_tree is None:
            free: Floats = self.nearest_free(S_mid[None])[0]
            return free
        nearest = self._walkway_tree.query(S_mid, k=min(_WALKWAY_CANDIDATES, self._walkway_tree.n))[1]
        corrected: Floats = np.asarray(self._walkway_tree.data[np.atleast_1d(nearest)])
        if previous is not None and not self.params.snap_across_walls and self.contains(previous[None])[0]:
            reachable = ~self.crosses(np.broadcast_to(previous, corrected.shape), corrected)
            corrected = corrected[reachable] if reachable.any() else previous[None]
        U_corrected: Floats = corrected[0].copy()
        return U_corrected  # step 6

    @cached_property
    def _walkway_tree(self) -> cKDTree | None:
        """The walkways' pixels, None where there are none."""
        return self._kd_tree(self.I_match == -1)

    @cached_property
    def _border_tree(self) -> cKDTree | None:
        """The free pixels beside structure or the edge: the nearest to any place that is not free is one of them."""
        free = np.pad(self.I_match != 0, 1, constant_values=not self._bounded)
        inner = free[2:, 1:-1] & free[:-2, 1:-1] & free[1:-1, 2:] & free[1:-1, :-2]
        return self._kd_tree(free[1:-1, 1:-1] & ~inner)

    def _kd_tree(self, chosen: Bools) -> cKDTree | None:
        row, column = np.nonzero(chosen)
        if len(row) == 0:
            return None
        return cKDTree(self._origin + (np.stack([column, row], axis=1) + 0.5) * self._pixel_m)

    def _pixels(self, xy: Floats) -> Floats:
        """Return points (n, 2) in pixels."""
        pixels: Floats = (xy - self._origin) / self._pixel_m
        return pixels


def _drawing_extent(floor: Floor, margin_m: float) -> tuple[Floats, Floats]:
    """Return the south-west corner and the size, (2,) each, of a floor's drawing and all that is on it, and around."""
    points = [np.array([[0.0, 0.0], [floor.width_m, floor.height_m]]) if floor.width_m > 0 else np.zeros((0, 2))]
    points += [floor.walls.reshape(-1, 2), *floor.outline, *floor.obstacles]
    corners = np.concatenate(points)
    if len(corners) == 0:
        return np.zeros(2), np.zeros(2)
    low, high = corners.min(axis=0) - margin_m, corners.max(axis=0) + margin_m
    return low, high - low


def _read_drawing(path: str, floor: Floor, t_threshold: float) -> Bools:
    return threshold_image(to_greyscale(np.asarray(imread(path.replace("{floor}", floor.name)))), t_threshold)
