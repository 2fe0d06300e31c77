"""Whether the boxes that a culler tests contain what they stand for, frame by frame.

A box that is too small loses its object sooner or later: a skinned mesh leaves its bind pose, an
instance is scaled, a shader moves vertices. The audit finds it in the first frame in which it is
so, whether or not anything is missed there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from visref.culler import CullerError
from visref.picking import distinct
from visref.scene import Float64, Int32, Int64, Scene, Units, same_moving
from visref.visibility import FrameTruth

# A culler's box and the vertices that it is made of are float32 as a rule: placed by a matrix, four
# products and three sums, and rounded again, in its program and in the box. Twelve roundings of the
# greatest coordinate are far above that, and below 2^-20 of it.
ROUNDING = 2.0**-20


@dataclass
class BoundsTooSmall:
    """Of one unit, over all frames: `frames` in which its box left some of it out, the greatest
    distance `outside`, in world units, at `frame`, and how many `samples` were seen of what was
    left out, in all frames that were looked at."""

    unit: int
    frames: int = 0
    outside: float = 0.0
    frame: int = 0
    samples: int = 0


class BoundsAudit:
    """One culler's boxes, audited frame after frame."""

    def __init__(self) -> None:
        self.found: dict[int, BoundsTooSmall] = {}
        self._real: RealBounds | None = None

    def look(
        self,
        frame: int,
        scene: Scene,
        units: Units,
        boxes: object,
        truths: Sequence[FrameTruth],
    ) -> None:
        """Compare the boxes of a frame, (u, 2, 3) in world space, one per unit; a unit whose box is
        not finite has none. `truths`: of the frame's views, where they are known.

        Raises CullerError where `boxes` is no such array.
        """
        given = checked(boxes, units)
        if self._real is None or self._real.units is not units:
            self._real = RealBounds(units)
        real = self._real.of(scene)
        known = np.isfinite(given).all(axis=(1, 2)) & np.isfinite(real).all(axis=(1, 2))
        with np.errstate(invalid="ignore"):
            outside = np.maximum(given[:, 0] - real[:, 0], real[:, 1] - given[:, 1]).max(axis=1)
            greatest = np.maximum(np.abs(given), np.abs(real)).max(axis=(1, 2))
        slack = ROUNDING * greatest
        small = np.flatnonzero(known & (outside > slack)).astype(np.int32)
        if not len(small):
            return
        samples = np.zeros(len(small), np.int64)
        for truth in truths:
            samples += _seen_outside(truth, scene, units.take(small), given[small], slack[small])
        for unit, distance, seen in zip(
            small.tolist(), outside[small].tolist(), samples.tolist(), strict=True
        ):
            one = self.found.setdefault(unit, BoundsTooSmall(unit))
            one.frames += 1
            one.samples += seen
            if distance > one.outside:
                one.outside, one.frame = distance, frame


class RealBounds:
    """The bounds of units, in world space, from moment to moment of a scene."""

    def __init__(self, units: Units) -> None:
        self.units = units
        self._scene: Scene | None = None
        self._bounds: Float64 = np.zeros((0, 2, 3))
        self._moving: tuple[Int32, Units] | None = None

    def of(self, scene: Scene) -> Float64:
        """(u, 2, 3) float64, to be read only. Of one moment after another, those alone are looked
        at in which something moves."""
        if scene is self._scene:
            return self._bounds
        if self._scene is not None and same_moving(scene, self._scene):
            if self._moving is None:
                ids = self._that_move(scene)
                self._moving = ids, self.units.take(ids)
            ids, moving = self._moving
            self._bounds[ids] = scene.bounds_of(moving) + scene.origin
        else:
            self._bounds = scene.bounds_of(self.units) + scene.origin
            self._moving = None
        self._scene = scene
        return self._bounds

    def _that_move(self, scene: Scene) -> Int32:
        """(k,) int32, ascending, the units that have a triangle of what is posed anew."""
        assert scene.moving is not None
        moves = scene.moving[scene.object_of_triangle[self.units.triangles]]
        entries = np.flatnonzero(moves)
        units = np.searchsorted(self.units.offsets, entries, side="right") - 1
        return distinct(units).astype(np.int32)


def checked(boxes: object, units: Units) -> Float64:
    """(u, 2, 3) float64, or CullerError."""
    try:
        given = np.asarray(boxes)
    except Exception as error:  # its elements may be anything
        raise CullerError("bounds() is no array") from error
    if given.shape != (units.count, 2, 3) or given.dtype.kind not in "iuf":
        raise CullerError(f"bounds() is no ({units.count}, 2, 3) array of numbers")
    if np.isnan(given).any():
        raise CullerError("bounds() has a number that is none")
    return given.astype(np.float64)


def _seen_outside(
    truth: FrameTruth, scene: Scene, units: Units, boxes: Float64, slack: Float64
) -> Int64:
    """(u,) int64, how many samples see some of each unit outside its box, one of (u, 2, 3) `boxes`
    widened by its (u,) `slack`. A triangle may be in several units."""
    # The units of triangle t are unit_of[first[t] : first[t + 1]].
    order = np.argsort(units.triangles, kind="stable")
    unit_of = np.repeat(np.arange(units.count), units.sizes)[order]
    each = np.bincount(units.triangles, minlength=scene.triangle_count)
    first = np.append(0, np.cumsum(each))
    owner = truth.buffer.triangle.reshape(-1)
    owned = np.flatnonzero((owner >= 0) & (each[owner] > 0))
    tied = np.flatnonzero(each[truth.ties.triangle] > 0)
    triangle = np.concatenate([owner[owned], truth.ties.triangle[tied]])
    # One row for each unit of each triangle that a sample sees.
    times = each[triangle]
    skipped = np.repeat(first[triangle] - (np.cumsum(times) - times), times)
    unit = unit_of[np.arange(len(skipped)) + skipped]
    sample = np.repeat(np.concatenate([owned, truth.ties.sample[tied]]), times)
    # A sample sees a unit once, by however many of its triangles.
    unit, sample = np.divmod(distinct(unit * owner.size + sample), owner.size)
    camera = truth.camera
    y, x = np.divmod(sample, camera.width)
    side = camera.column_a[x, None] * camera.right_step + camera.row_b[y, None] * camera.up_step
    depth = truth.buffer.depth.reshape(-1)[sample, None]
    if camera.is_perspective:
        points = camera.eye + depth * (camera.forward + side)
    else:
        points = camera.eye + side + depth * camera.forward
    points = points + scene.origin
    low, high = boxes[:, 0] - slack[:, None], boxes[:, 1] + slack[:, None]
    inside = ((points >= low[unit]) & (points <= high[unit])).all(axis=1)
    counts: Int64 = np.bincount(unit[~inside], minlength=units.count)
    return counts
