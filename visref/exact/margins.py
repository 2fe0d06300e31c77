"""How firmly an object holds a sample: margins, and what a rasteriser could lose by itself.

At a sample that an object owns, its *patch* is the surface that grows from the triangle there
across every edge that two of its triangles share and lie on either side of. The object is
certainly visible at every point of the screen up to the patch's rim, or up to where another
object comes before it, whichever is nearer: both are distances to segments and polygons in
closed form, so that no sliver can pass between probes.

A rasteriser that moves each vertex by at most `snap_px` maps the patch onto one that still
covers the sample, if the patch reached further than that around it; and it sees there, of
every triangle, only depths which that triangle has within `snap_px` of the sample, give or take
one depth step and the float32 transform's error. A witness *survives* if no such map could lose
it.

Which way this errs: the set of maps considered includes all that the rasteriser declares, and
where the float64 geometry is in doubt (its error is counted) the witness does not survive. So
an object with a surviving witness was not lost by the rasteriser. Not surviving alone clears
nothing: the object must be absent from the rasteriser's own unculled picture besides.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.compiled import njit
from visref.culler import RasterTolerance
from visref.exact.adjacent import continues
from visref.exact.depth_buffer import (
    NO_DEPTH_BUFFER,
    DepthBuffer,
    counted,
    depth_buffer,
    key_error,
    resolved,
    with_doubtful_range,
)
from visref.exact.filters import NOTHING, PROJECT, SET_UP_SIZE, View, set_up, view_of
from visref.exact.nearby import Nearby, near_samples
from visref.exact.polygons import (
    CLIPPED,
    MOST_CORNERS,
    distance_out_of_range,
    distance_to_hiding,
    distance_to_polygon,
    distance_to_segment,
    key_plane,
    key_range,
    screen_polygon,
)
from visref.exact.scene import ExactScene
from visref.exact.screen import CLIP_SLACK, X0, X1, Y0, Y1
from visref.scene import Alpha, Float64, Int64

# Margins are looked for at most this far. No rasteriser's snap, no jitter of a temporal filter and
# no halved resolution moves a sample so far: what holds there is an area that anybody sees.
REACH_PX = 16.0
# A margin beyond a pixel compares the triangles around the sample with each other. With more of
# them than this (some 20 ms), nothing is told at that reach.
MOST_AROUND = 256


class _Triangles(NamedTuple):
    """All triangles in cluster order: `corners` (t, 9) float32, `one_sided` (t,) bool,
    `object_of` (t,) int32, `masked` (t,) bool."""

    corners: NDArray[np.float32]
    one_sided: NDArray[np.bool_]
    object_of: NDArray[np.int32]
    masked: NDArray[np.bool_]


class _Around(NamedTuple):
    """How many pixels around a sample are looked at, and the most triangles there that are compared
    with each other."""

    radius: float
    most: int


# More triangles than a scene can have.
_ANY_NUMBER = 1 << 62


class _Findings(NamedTuple):
    """What `_examine` finds at each witness, (k,) arrays: float64 pixels to the rim of its patch
    (`cover`) and to where another object comes before the patch (`hide`), the relative depth to
    the next object (`gap`); bool whether another depth may win within the radius (`lost`)."""

    cover: Float64
    hide: Float64
    gap: Float64
    lost: NDArray[np.bool_]

    def part(self, some: slice) -> _Findings:
        return _Findings(self.cover[some], self.hide[some], self.gap[some], self.lost[some])


def witness_margins(
    exact_scene: ExactScene,
    camera: Camera,
    samples: Int64,
    objects: Int64,
    *,
    reach_px: float = REACH_PX,
    most_around: int = MOST_AROUND,
) -> tuple[Float64, Float64]:
    """How far each claim "this object is visible at this sample" is from failing.

    `samples`: (k,) flat indices, `objects`: (k,) ids. Returns `margin_px`: (k,) float64, how
    far in pixels the sample may move in any direction with the object still visible there, at
    most `reach_px`, rounded down; and `margin_depth`: (k,) float64, the least relative distance
    along the ray to another object behind, |t_next - t| / |t|, inf where there is none.

    A margin holds beyond the image's edge too, where nothing but the surface goes on. It is 0
    where nothing can be told: the object's opaque triangles do not cover the sample, the sample
    lies behind a masked triangle (even in a hole of it), or more than `most_around` triangles lie
    within the reach; ask again with a smaller one. A masked triangle before the surface bounds the
    margin as if it were solid.
    """
    around = _Around(reach_px, most_around)
    found = _find(exact_scene, camera, samples, objects, around, None)
    return np.minimum(np.minimum(found.cover, found.hide), reach_px), found.gap


def surviving(
    exact_scene: ExactScene,
    camera: Camera,
    samples: Int64,
    objects: Int64,
    tolerance: RasterTolerance,
    *,
    nearest: float | None = None,
) -> NDArray[np.bool_]:
    """Whether a rasteriser of this tolerance must show each object at its sample: (k,) bool.

    True only where no displacement and no depth error that it declares could lose the object
    there; see the module's text for which way doubt falls. With `nearest`, the least view depth
    at which anything is seen, only depths that the buffer resolves are in doubt
    (`depth_buffer.resolved`): so where nobody has seen the rasteriser's own picture.
    """
    radius = tolerance.snap_px
    around = _Around(radius, _ANY_NUMBER)
    found = _find(exact_scene, camera, samples, objects, around, tolerance, nearest)
    return (found.cover > radius) & ~found.lost


def _find(
    exact_scene: ExactScene,
    camera: Camera,
    samples: Int64,
    objects: Int64,
    around: _Around,
    tolerance: RasterTolerance | None,
    nearest: float | None = None,
) -> _Findings:
    """`_examine` for samples (k,) and objects (k,), in parallel."""
    scene = exact_scene.scene
    view = view_of(camera)
    depth = NO_DEPTH_BUFFER
    if tolerance is not None:
        depth = depth_buffer(camera, exact_scene, tolerance)
        view = with_doubtful_range(view, exact_scene, depth)
        if nearest is not None:
            depth = resolved(depth, exact_scene)
            view = _with_projectable_near(view, exact_scene, nearest)
    samples = np.asarray(samples, np.int64)
    objects = np.asarray(objects, np.int64)
    alpha = scene.alpha[exact_scene.order]
    masked = alpha == Alpha.MASK
    # A rasteriser's tolerance is asked of opaque triangles alone.
    usable = alpha == Alpha.OPAQUE if tolerance is not None else alpha != Alpha.BLEND
    near = near_samples(exact_scene, camera, view, usable, samples, around.radius)
    objects_of = scene.object_of_triangle[exact_scene.order]
    triangles = _Triangles(exact_scene.corners, exact_scene.one_sided, objects_of, masked)
    found = _Findings(
        np.zeros(len(samples)),
        np.full(len(samples), np.inf),
        np.full(len(samples), np.inf),
        np.ones(len(samples), np.bool_),
    )

    def part_of(part: Int64) -> None:
        some = slice(int(part[0]), int(part[-1]) + 1)
        _examine(
            near.part(some), objects[some], triangles, view, around, tolerance is not None, depth,
            found.part(some),
        )  # fmt: skip

    exact_scene.in_parallel(part_of, np.arange(len(samples)))
    return found


def _with_projectable_near(view: View, exact_scene: ExactScene, nearest: float) -> View:
    """The view with near moved out to where float64 projects what crosses it to a sixteenth of a
    pixel, but no further than half way to what is seen nearest.

    Nearer to the eye a corner's place on the screen has no bound, and a floor under the eye would
    be in doubt all over the screen.
    """
    if not view.perspective:
        return view
    size = float(np.abs(exact_scene.scene.bounds - view.e).max())
    z_error = PROJECT * view.z_norm * size
    # A corner at depth t stands a = x_norm * size / t aside, which is off by a * z_error / t; and
    # `screen_polygon` wants z_error < t * CLIP_SLACK / 2.
    aside = max(view.x_norm, view.y_norm) * size
    least = max(math.sqrt(16.0 * aside * z_error), 4.0 * z_error / CLIP_SLACK)
    return view._replace(near=max(view.near, min(least, 0.5 * nearest)))


@njit(error_model="numpy")
def _examine(
    nearby: Nearby,
    objects: NDArray[Any],
    triangles: _Triangles,
    view: View,
    around: _Around,
    with_depth: bool,
    depth: DepthBuffer,
    findings: _Findings,
) -> None:
    """Examine each witness: an object of `objects` at a sample of `nearby`. With `with_depth`,
    whether another depth may win is asked of the depth buffer; else of nothing."""
    xs, ys, tiles, binned = nearby
    found, boxes, _, bin_offsets, bin_entries, _ = binned
    corners, one_sided, object_of, masked = triangles
    radius, most_around = around
    cover, hide, gap, lost = findings
    most = 1
    for index in range(len(xs)):
        most = max(most, bin_offsets[tiles[index] + 1] - bin_offsets[tiles[index]])
    polygons = np.empty((most, 4, 3))
    tags = np.empty((most, 4), np.int8)
    counts = np.empty(most, np.int64)
    slops = np.empty(most)
    away = np.empty(most)
    places = np.empty(most, np.int64)
    reached = np.empty(most, np.bool_)
    queue = np.empty(most, np.int64)
    scratch = np.empty((2, MOST_CORNERS, 3))
    terms = np.empty(SET_UP_SIZE)
    for index in range(len(xs)):
        x, y = np.float64(xs[index]), np.float64(ys[index])
        mine = objects[index]
        # Everything within the radius, and the witness's own triangle: nearest of the
        # object's that hold the sample.
        near = 0
        root, root_key = -1, -np.inf
        for entry in range(bin_offsets[tiles[index]], bin_offsets[tiles[index] + 1]):
            k = bin_entries[entry]
            if x < boxes[k, X0] or x > boxes[k, X1] or y < boxes[k, Y0] or y > boxes[k, Y1]:
                continue
            t = found[k]
            count, slop = screen_polygon(corners[t], view, polygons[near], tags[near])
            if count == 0:
                continue
            distance = distance_to_polygon(x, y, polygons[near], count)
            if distance > radius + slop:
                continue
            lens = view.lens
            if one_sided[t] and (
                set_up(corners[t], one_sided[t], view.perspective, lens, terms) == NOTHING
            ):
                # Certainly seen from behind, wherever the sample moves. If it is the corners that
                # move, a triangle thinner than that may turn over, and stays as one that can hide.
                thick = True
                for i in range(3):
                    j, m = (i + 1) % 3, (i + 2) % 3
                    if with_depth and count == 3:
                        thick = thick and 2.0 * (radius + slop) < distance_to_segment(
                            polygons[near, i, 0], polygons[near, i, 1],
                            polygons[near, j, 0], polygons[near, j, 1],
                            polygons[near, m, 0], polygons[near, m, 1],
                        )  # fmt: skip
                if thick:
                    continue
            if with_depth:
                low, high = key_range(x, y, radius + slop, polygons[near], count)
                doubt = depth.step * depth.scale + key_error(corners[t], view, depth)
                doubt = counted(doubt, high, depth)
                if low - doubt > depth.first or high + doubt < depth.last:
                    continue
            places[near], counts[near], slops[near] = t, count, slop
            reached[near], away[near] = False, distance
            if object_of[t] == mine and not masked[t] and distance <= slop:
                has_area, c, gx, gy = key_plane(polygons[near], count)
                if has_area and c + gx * x + gy * y > root_key:
                    root, root_key = near, c + gx * x + gy * y
            near += 1
            if near > most_around:
                break
        cover[index], hide[index], gap[index], lost[index] = 0.0, np.inf, np.inf, False
        if root < 0 or near > most_around:
            lost[index] = True
            continue
        # Grow the patch across shared edges within the radius; the others are its rim.
        rim = np.inf
        reached[root] = True
        queue[0] = root
        head, tail = 0, 1
        least, greatest = np.inf, -np.inf
        error = 0.0
        while head < tail:
            k = queue[head]
            head += 1
            low, high = key_range(x, y, radius + slops[k], polygons[k], counts[k])
            least, greatest = min(least, low), max(greatest, high)
            if with_depth:
                error = max(error, key_error(corners[places[k]], view, depth))
            for i in range(counts[k]):
                j = i + 1 if i + 1 < counts[k] else 0
                distance = distance_to_segment(
                    x, y, polygons[k, i, 0], polygons[k, i, 1], polygons[k, j, 0], polygons[k, j, 1]
                )
                distance = max(0.0, distance - slops[k])
                if not distance <= min(radius, rim):
                    continue
                closed = False
                if tags[k, i] != CLIPPED:
                    for other in range(near):
                        if object_of[places[other]] == mine and (
                            other != k and not masked[places[other]]
                        ):
                            edge = np.int64(tags[k, i])
                            p, q = corners[places[k]], corners[places[other]]
                            if continues(p, edge, q, view):
                                closed = True
                                if not reached[other]:
                                    reached[other] = True
                                    queue[tail] = other
                                    tail += 1
                                break
                if not closed:
                    rim = min(rim, distance)
        # Out of range the surface is there and not seen.
        for k in range(near):
            if reached[k] and not with_depth:
                distance = distance_out_of_range(x, y, polygons[k], counts[k], view, scratch)
                rim = min(rim, max(0.0, distance - slops[k]))
        cover[index] = rim
        # What else is here, and where it comes before the patch.
        step = 0.0
        if with_depth:
            step = depth.step * depth.scale
            doubt = counted(error + step, least, depth)
            lost[index] = greatest + doubt >= depth.first or least - doubt <= depth.last
        next_key = -np.inf
        for other in range(near):
            leaf = masked[places[other]]
            if object_of[places[other]] == mine and not leaf:
                continue
            count = counts[other]
            low, high = key_range(x, y, radius + slops[other], polygons[other], count)
            if with_depth:
                doubt = step + error + key_error(corners[places[other]], view, depth)
                doubt = counted(doubt, least, depth)
                if high + doubt >= least:
                    lost[index] = True
                continue
            has_area, c, gx, gy = key_plane(polygons[other], count)
            distance = away[other]
            if has_area and distance <= slops[other] and object_of[places[other]] != mine:
                key = c + gx * x + gy * y
                if key <= root_key:
                    next_key = max(next_key, key)
                elif distance == 0.0 and not leaf:
                    next_key = root_key
            if not has_area or high < least:
                continue
            for k in range(near):
                if reached[k]:
                    slop = slops[other] + slops[k]
                    # Where the one lies over the other is no nearer than either.
                    if max(distance, away[k]) - slop >= min(hide[index], cover[index]):
                        continue
                    covers = distance_to_hiding(
                        x, y, polygons[other], count, polygons[k], counts[k], scratch
                    )
                    hide[index] = min(hide[index], max(0.0, covers - slop))
        if view.perspective:
            gap[index] = root_key / next_key - 1.0 if next_key > 0.0 else np.inf
        elif next_key > -np.inf:
            gap[index] = (root_key - next_key) / abs(root_key) if root_key != 0.0 else np.inf
