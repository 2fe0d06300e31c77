"""Why a unit was drawn for nothing: which better test, order or question would have spared it.

The causes are tried in this order, and the first that holds is the unit's:

outside_view            its box shows nowhere in the image: a frustum test would have spared it
box_larger_than_object  its box, unlike itself, shows in the finished image: asking about boxes
                        never spares it, however late and fine
occluder_drawn_later    its box is hidden in the finished image, and was not yet when the depth
                        buffer was asked about it (or, where it was not asked, when it was drawn)
query_skipped           its box was hidden when it was drawn, and it was drawn without asking
test_too_coarse         its box was hidden when it was asked about, and the answer was "visible":
                        a tile, a texel, a looser or inflated box
box_hidden              its box is hidden in the finished image; in which order units were drawn,
                        or whether it was asked about, the culler does not tell

The referee measures this itself: the finished image is the truth's, what had been drawn at a
moment is drawn again, in float64, from the order of the draw list. Only whether and when it asked
is the culler's own word (`DrawnSet.asked_at`). Boxes are the units' own axis-aligned ones, and
"shows" means: before the depth of some sample by more than `DEPTH_ROUNDING`. At an undecided
sample everything shows.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.compiled import njit
from visref.culler import DrawnSet
from visref.exact.outside import certainly_outside
from visref.picking import evenly_picked
from visref.run_folder.silhouettes import UnitImage, from_behind
from visref.scene import Alpha, Float32, Float64, Int32, Int64, Scene, Units
from visref.visibility import FrameTruth

# Relative. The coarsest depth compared here is a float32's, off by 2^-24 once it is rounded and by
# a few times that after a float32 engine's arithmetic. Errs towards hidden: a box closer than this
# to what hides it is told from it by no depth buffer either, and counts as a coarse test.
DEPTH_ROUNDING = 2.0**-20

# At most so many units of a frame are explained, evenly picked; a box costs some microseconds,
# and a culler of small units draws millions for nothing.
MAX_UNITS = 20_000

_CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


class Cause(StrEnum):
    """Why a superfluous unit was drawn; see the module."""

    OUTSIDE = "outside_view"
    BOX = "box_larger_than_object"
    ORDER = "occluder_drawn_later"
    SKIPPED = "query_skipped"
    COARSE = "test_too_coarse"
    HIDDEN = "box_hidden"


def superfluous_causes(
    scene: Scene,
    truth: FrameTruth,
    units: Units,
    drawn: DrawnSet,
    superfluous_units: Int32,
) -> dict[int, Cause]:
    """The cause by unit, for at most `MAX_UNITS` of a frame's superfluous units, (k,) int32."""
    ids = np.unique(superfluous_units).astype(np.int64)
    ids = ids[evenly_picked(len(ids), MAX_UNITS)]
    boxes = scene.bounds_of(units)[ids]
    camera = truth.camera
    causes = np.full(len(ids), Cause.HIDDEN, object)
    # An empty unit's box has no corner to speak of, and shows nowhere.
    empty = units.sizes[ids] == 0
    outside = empty.copy()
    filled = np.flatnonzero(~empty)
    outside[filled] = certainly_outside(camera, _corners(boxes[filled]))
    causes[outside] = Cause.OUTSIDE
    inside = np.flatnonzero(~outside)
    shows = boxes_show(camera, boxes[inside], _finished(truth))
    causes[inside[shows]] = Cause.BOX
    left = inside[~shows]
    if drawn.ordered and len(left):
        order = np.asarray(drawn.unit_ids)
        place = np.empty(units.count, np.int64)
        place[order] = np.arange(len(order))
        at = place[ids[left]]
        asked = np.full(len(left), -1) if drawn.asked_at is None else drawn.asked_at[at]
        moment = np.where(asked >= 0, asked, at)
        early = _show_at(scene, camera, units, order, boxes[left], moment)
        untold = Cause.HIDDEN if drawn.asked_at is None else Cause.SKIPPED
        late = np.where(asked >= 0, Cause.COARSE, untold)
        causes[left] = np.where(early, Cause.ORDER, late)
    return {unit: Cause(name) for unit, name in zip(ids.tolist(), causes, strict=True)}


def _corners(boxes: Float64) -> Float64:
    """(k, 8, 3) float64 of (k, 2, 3) boxes."""
    return np.stack([boxes[:, _CORNERS[:, axis], axis] for axis in range(3)], axis=2)


def _finished(truth: FrameTruth) -> Float64:
    """(height, width) float64 view depth of the finished image; inf, so that everything shows,
    where it is undecided."""
    depth = truth.buffer.depth.copy()
    depth.reshape(-1)[truth.undecided] = np.inf
    return depth


def _show_at(
    scene: Scene, camera: Camera, units: Units, order: Int32, boxes: Float64, moments: Int64
) -> NDArray[np.bool_]:
    """(k,) bool: whether each box shows once the first `moments[i]` units of `order` are drawn."""
    image = UnitImage(scene, camera, units, (camera.height, camera.width))
    only = _occluders(scene, camera)
    shows = np.zeros(len(boxes), np.bool_)
    done = 0
    for moment in np.unique(moments):
        image.draw(order[done:moment], only=only)
        done = int(moment)
        now = np.flatnonzero(moments == moment)
        shows[now] = boxes_show(camera, boxes[now], image.nearness, nearness=True)
    return shows


def _occluders(scene: Scene, camera: Camera) -> NDArray[np.bool_] | None:
    """(t,) bool, the triangles that hide what is behind them in this view; None for all."""
    hides: NDArray[np.bool_] = scene.alpha == Alpha.OPAQUE
    one_sided = np.flatnonzero(scene.one_sided)
    hides[one_sided] &= ~from_behind(scene, camera, one_sided)
    return None if hides.all() else hides


class _Rays(NamedTuple):
    """A camera's samples, as `visref.camera` defines them: (3,) float64 vectors, `column_a`
    (width,) and `row_b` (height,) float64, and the range of view depths."""

    perspective: bool
    eye: Float64
    forward: Float64
    right: Float64
    up: Float64
    column_a: Float64
    row_b: Float64
    near: float
    far: float


def boxes_show(
    camera: Camera, boxes: Float64, depth: Float64 | Float32, *, nearness: bool = False
) -> NDArray[np.bool_]:
    """(k,) bool: whether each of (k, 2, 3) float64 world boxes lies before `depth` at any sample:
    (height, width) view depth, inf for nothing, or with `nearness` a `UnitImage`'s. Only what of
    a box lies between the near and the far plane counts."""
    result = np.zeros(len(boxes), np.bool_)
    rays = _Rays(
        camera.is_perspective,
        camera.eye,
        camera.forward,
        camera.right_step,
        camera.up_step,
        camera.column_a,
        camera.row_b,
        camera.near,
        camera.far,
    )
    _boxes_show(boxes, rays, depth, nearness, DEPTH_ROUNDING, result)
    return result


@njit(error_model="numpy")
def _boxes_show(
    boxes: NDArray[Any],
    rays: _Rays,
    depth: NDArray[Any],
    nearness: bool,
    rounding: float,
    result: NDArray[Any],
) -> None:
    perspective, eye, forward, right, up, column_a, row_b, near, far = rays
    height, width = depth.shape
    per_step = 1.0 / (right[0] * right[0] + right[1] * right[1] + right[2] * right[2])
    low, high, origin, step = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(boxes.shape[0]):
        # The box's rectangle, a pixel larger on each side; all of the image where a corner has
        # no place in it.
        first_x, last_x, first_y, last_y = np.inf, -np.inf, np.inf, -np.inf
        for corner in range(8):
            z = a = b = 0.0
            for j in range(3):
                q = boxes[k, (corner >> j) & 1, j] - eye[j]
                z += q * forward[j]
                a += q * right[j]
                b += q * up[j]
            if perspective and z < near:
                first_x, last_x, first_y, last_y = -np.inf, np.inf, -np.inf, np.inf
                break
            scale = per_step / z if perspective else per_step
            x = (a * scale - column_a[0]) / 2.0
            y = (row_b[0] - b * scale) / 2.0
            first_x, last_x = min(first_x, x), max(last_x, x)
            first_y, last_y = min(first_y, y), max(last_y, y)
        start_x, end_x = int(max(first_x - 1.0, 0.0)), int(min(last_x + 2.0, float(width)))
        start_y, end_y = int(max(first_y - 1.0, 0.0)), int(min(last_y + 2.0, float(height)))
        for y_px in range(start_y, end_y):
            for x_px in range(start_x, end_x):
                enter, leave = near, far
                for j in range(3):
                    offset = column_a[x_px] * right[j] + row_b[y_px] * up[j]
                    origin[j] = eye[j] if perspective else eye[j] + offset
                    step[j] = forward[j] + offset if perspective else forward[j]
                    low[j], high[j] = boxes[k, 0, j] - origin[j], boxes[k, 1, j] - origin[j]
                    if step[j] == 0.0:
                        if low[j] > 0.0 or high[j] < 0.0:
                            enter, leave = np.inf, -np.inf
                        continue
                    one, other = low[j] / step[j], high[j] / step[j]
                    enter = max(enter, min(one, other))
                    leave = min(leave, max(one, other))
                z = float(depth[y_px, x_px])
                if nearness:
                    z = -z if z == -np.inf or not perspective else 1.0 / z
                # An infinite depth minus its share would be no number.
                behind = z if z == np.inf else z - rounding * abs(z)
                if enter <= leave and enter < behind:
                    result[k] = True
                    break
            if result[k]:
                break
