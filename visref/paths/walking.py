"""A walk: a camera that goes from point to point, looks where it goes, and turns on the spot.

A leg between two points is straight and both its ends are frames, so that the eye of a frame gets
to the next one's in a straight line along a leg: how near the legs come to the triangles is how
near the walk does. The other frames go to legs by length and to turns by angle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from visref.camera import look_at
from visref.camera_path import CameraPath, Frame
from visref.errors import InputError
from visref.paths.lens import Lens, check_frames
from visref.scene import Float64

# How much of a walk's length takes as many frames as a turn right round.
TURN_SHARE = 0.5
# Looking ahead on a steeper leg is looking at the ground or the sky; straight up, there is no roll.
STEEPEST = math.radians(60.0)


def walk(
    points: Float64, lens: Lens, frames: int, times: Sequence[float | None], *, near: float
) -> CameraPath:
    """A walk along straight legs between points, (k, 3) float64 in world space, which looks along
    each leg and turns to the next. `times`: each frame's `time_s`; `near` as in `Lens.camera`.

    Raises InputError where there are fewer than two points, two in a row are the same, or there
    are fewer frames than points.
    """
    legs = _legs(np.asarray(points, np.float64))
    check_frames(frames, len(legs) + 1)
    return CameraPath(
        Frame((lens.camera(_pose(eye, *look), near),), time_s)
        for (eye, look), time_s in zip(_moments(legs, frames), times, strict=True)
    )


@dataclass(frozen=True, eq=False)
class _Leg:
    """From where to where, (3,) float64 each; `look`: yaw about +Y, 0 towards +Z, and pitch, in
    radians, the yaw counted on from leg to leg; `turn`: the angle from the leg before."""

    start: Float64
    end: Float64
    look: tuple[float, float]
    turn: float

    @property
    def length(self) -> float:
        with np.errstate(over="ignore"):  # then it is infinite, and refused
            return float(np.linalg.norm(self.end - self.start))


def _legs(points: Float64) -> list[_Leg]:
    if len(points) < 2:
        raise InputError("a walk goes through two points at least", fix="give more points")
    legs: list[_Leg] = []
    for start, end in pairwise(points):
        along = end - start
        if not along.any() or not np.isfinite(along).all():
            raise InputError("a walk has the same point twice in a row", fix="leave one out")
        before = legs[-1].look if legs else (0.0, 0.0)
        flat = math.hypot(along[0], along[2])
        yaw, pitch = before[0], math.atan2(along[1], flat)
        if abs(pitch) < math.radians(89.9):  # straight up or down has no direction of its own
            # The shorter way round.
            yaw += math.remainder(math.atan2(along[0], along[2]) - yaw, 2 * math.pi)
        pitch = max(-STEEPEST, min(STEEPEST, pitch))
        turn = max(abs(yaw - before[0]), abs(pitch - before[1])) if legs else 0.0
        legs.append(_Leg(start, end, (yaw, pitch), turn))
    # Beyond float64 there are no shares of it.
    if not math.isfinite(sum(leg.length for leg in legs)):
        raise InputError("the points are too far apart", fix="give nearer ones")
    return legs


def _moments(legs: Sequence[_Leg], frames: int) -> Iterator[tuple[Float64, tuple[float, float]]]:
    """Each frame's eye and look."""
    total = sum(leg.length for leg in legs)
    turning = [leg.turn / (2 * math.pi) * TURN_SHARE * total for leg in legs]
    lengths = [leg.length for leg in legs]
    shares = _shared_out(frames - 1 - len(legs), [*turning, *lengths])
    before = legs[0].look
    yield legs[0].start, before
    for leg, turns, steps in zip(legs, shares, shares[len(legs) :], strict=False):
        for k in range(1, turns + 1):
            part = k / turns
            yield (
                leg.start,
                tuple(a + (b - a) * part for a, b in zip(before, leg.look, strict=True)),
            )  # type: ignore[misc]
        for k in range(1, steps + 2):
            # The end itself, which rounding might miss.
            end = k == steps + 1
            yield (
                leg.end if end else leg.start + (leg.end - leg.start) * (k / (steps + 1)),
                leg.look,
            )
        before = leg.look


def _shared_out(count: int, weights: Sequence[float]) -> list[int]:
    """`count` in whole parts in proportion to weights, by the largest remainders."""
    total = sum(weights)
    exact = [count * weight / total for weight in weights]
    parts = [math.floor(part) for part in exact]
    order = sorted(range(len(weights)), key=lambda i: (parts[i] - exact[i], i))
    for index in order[: count - sum(parts)]:
        parts[index] += 1
    return parts


def _pose(eye: Float64, yaw: float, pitch: float) -> Float64:
    level = math.cos(pitch)
    ahead = (math.sin(yaw) * level, math.sin(pitch), math.cos(yaw) * level)
    pose = look_at((0.0, 0.0, 0.0), ahead)
    pose[:3, 3] = eye
    return pose
