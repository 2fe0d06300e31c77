"""One ray replayed: every triangle along it in exact order, from plain numbers alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.exact.filters import (
    BOUND_0,
    CERTAIN,
    EDGE_0,
    EDGE_1,
    EDGE_2,
    KEY_BOUND,
    KEY_PLANE,
    NOTHING,
    SET_UP_SIZE,
    U,
    View,
    clip_state,
    set_up,
    view_of,
)
from visref.exact.rational import ExactFrame
from visref.scene import Float64

AFFINE = (EDGE_0, EDGE_1, EDGE_2, KEY_PLANE)


@dataclass(frozen=True, eq=False)
class Ray:
    """One sample as it is defined, a grid of one: see `visref.camera` for the letters.

    Vectors are (3,) float64; `column_a` and `row_b` (1,) float64. All are taken as exact.
    """

    is_perspective: bool
    eye: Float64
    forward: Float64
    right_step: Float64
    up_step: Float64
    column_a: Float64
    row_b: Float64
    near: float
    far: float
    width: int = 1
    height: int = 1
    shift_x_px: float = 0.0
    shift_y_px: float = 0.0
    clip_plane: tuple[float, float, float, float] | None = None

    @classmethod
    def from_definition(cls, definition: Mapping[str, Any], x: int, y: int) -> Ray:
        """Pixel (x, y) of the samples that `Camera.definition` wrote down.

        Raises InputError naming the entry that is missing or malformed.
        """

        def number(value: Any, place: str) -> float:
            if not isinstance(value, str):
                raise InputError("it is no hexadecimal float", place=place, fix="record it anew")
            try:
                return float.fromhex(value)
            except (ValueError, OverflowError) as error:
                raise InputError(
                    f"'{value}' is no hexadecimal float", place=place, fix="record it anew"
                ) from error

        def entry(name: str) -> Any:
            if name not in definition:
                raise InputError(f"'{name}' is missing", place="samples", fix="record it anew")
            return definition[name]

        def vector(name: str) -> Float64:
            values = entry(name)
            if not isinstance(values, list) or len(values) != 3:
                raise InputError(
                    "it is no list of three", place=f"samples.{name}", fix="record it anew"
                )
            return np.array([number(value, f"samples.{name}") for value in values])

        def scalar(name: str) -> float:
            return number(entry(name), f"samples.{name}")

        def whole(name: str) -> int:
            if not isinstance(entry(name), int):
                raise InputError("it is no integer", place=f"samples.{name}", fix="record it anew")
            return int(entry(name))

        def plane() -> tuple[float, float, float, float]:
            values = entry("clip_plane")
            if not isinstance(values, list) or len(values) != 4:
                raise InputError(
                    "it is no list of four", place="samples.clip_plane", fix="record it anew"
                )
            a, b, c, d = (number(value, "samples.clip_plane") for value in values)
            return a, b, c, d

        # In the order of operations of Camera.column_a and row_b.
        a = 2.0 * (float(x) + scalar("shift_x_px")) + 1.0 - whole("width")
        b = whole("height") - 2.0 * (float(y) + scalar("shift_y_px")) - 1.0
        return cls(
            is_perspective=entry("projection") == "perspective",
            eye=vector("e"),
            forward=vector("F"),
            right_step=vector("R"),
            up_step=vector("U"),
            column_a=np.array([a]),
            row_b=np.array([b]),
            near=scalar("near"),
            far=scalar("far"),
            clip_plane=plane() if "clip_plane" in definition else None,
        )


@dataclass(frozen=True)
class RayHit:
    """A triangle that covers the sample within the range.

    `triangle`: its place in what was asked about. `order`: 0 for the nearest, equal where depths
    are exactly equal. `depth`: the exact view depth rounded to nearest, which is
    `numerator / denominator` (decimal integers, reduced). `by_floats`: whether float64 alone
    decided that it covers, and its place in the order; `depth_float64` is then within `bound`
    of the exact depth (`bound` is inf where float64 says nothing).
    """

    triangle: int
    order: int
    depth: float
    numerator: str
    denominator: str
    depth_float64: float
    bound: float
    by_floats: bool


def along_ray(
    ray: Ray, corners: NDArray[np.float32], one_sided: NDArray[np.bool_] | None = None
) -> list[RayHit]:
    """Every triangle along a ray, nearest first, in exact order of depth, ties by place.

    `corners`: (n, 3, 3) float32. `one_sided`: (n,) bool, triangles that show their front alone;
    None for none. Degenerate and edge-on triangles, and hits out of range, are no hits.
    """
    corners = np.ascontiguousarray(corners, np.float32).reshape(-1, 3, 3)
    count = len(corners)
    sides = np.zeros(count, np.bool_) if one_sided is None else np.asarray(one_sided, np.bool_)
    exact = ExactFrame(ray, corners, sides)
    hit = np.flatnonzero(exact.covers(np.arange(count), np.zeros(count, np.int64)))
    depth = exact.depth(hit, np.zeros(len(hit), np.int64))
    quotients = [Fraction(n, d) for n, d in exact.quotients(hit, np.zeros(len(hit), np.int64))]
    view = view_of(ray)
    filtered = [_by_floats(view, ray, corners[t].reshape(9), bool(sides[t])) for t in hit]
    ranks = {value: rank for rank, value in enumerate(sorted(set(quotients)))}
    result = []
    for i, t in enumerate(hit):
        value, bound, covers = filtered[i]
        apart = all(
            abs(value - other) > bound + other_bound
            for j, (other, other_bound, _) in enumerate(filtered)
            if j != i
        )
        result.append(
            RayHit(
                triangle=int(t),
                order=ranks[quotients[i]],
                depth=float(depth[i]),
                numerator=str(quotients[i].numerator),
                denominator=str(quotients[i].denominator),
                depth_float64=value,
                bound=bound,
                by_floats=covers and apart,
            )
        )
    return sorted(result, key=lambda h: (h.order, h.triangle))


def _by_floats(
    view: View, ray: Ray, corners: NDArray[np.float32], one_sided: bool
) -> tuple[float, float, bool]:
    """What float64 says of a triangle that is hit: (depth, its bound, whether the hit is
    certain)."""
    terms = np.empty(SET_UP_SIZE)
    state = set_up(corners, one_sided, view.perspective, view.lens, terms)
    assert state != NOTHING, "the filter contradicts exact arithmetic"
    if state != CERTAIN:
        return 0.0, np.inf, False
    a, b = float(ray.column_a[0]), float(ray.row_b[0])
    values = [(terms[k] + b * terms[k + 2]) + a * terms[k + 1] for k in AFFINE]
    key, error = float(values[3]), float(terms[KEY_BOUND])
    inside = all(
        value >= bound
        for value, bound in zip(values[:3], terms[BOUND_0 : BOUND_0 + 3], strict=True)
    )
    inside = inside and key + error <= view.near_enough and key - error >= view.far_enough
    if view.clips:
        inside = inside and clip_state(view.clip, key - error, key + error, a, b) > 0
    if not ray.is_perspective:
        return -key, error, inside
    if not key - error > 0.0:
        return 0.0, np.inf, False
    # |1/q - t| <= error / (q (q - error)), and one rounding of 1/q; 8 u for those of the bound.
    depth = 1.0 / key
    return depth, (error / (key * (key - error)) + U * depth) * (1.0 + 8.0 * U), inside
