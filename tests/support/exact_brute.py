"""The sample rule by the book: one sample, one triangle at a time, in integers.

Deliberately simple, and written apart from visref.exact: it finds the point where the ray meets
the plane, and asks on which side of each edge that point lies, within the plane.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from visref.camera import Camera
from visref.masks.lookup import HOLE, SOLID
from visref.scene import Alpha, Scene

# What a mask says at a (sample, triangle).
States = Mapping[tuple[int, int], int]


def _cross(p, q):
    return [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]


def _dot(p, q):
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


def _minus(p, q):
    return [p[0] - q[0], p[1] - q[1], p[2] - q[2]]


def _bits(values) -> int:
    """The least k such that every value times 2^k is whole."""
    return max(Fraction(float(v)).denominator.bit_length() - 1 for v in values)


def _whole(value, bits: int) -> int:
    result = Fraction(float(value)) * 2**bits
    assert result.denominator == 1
    return result.numerator


def hits(scene: Scene, camera: Camera) -> list[list[tuple[Fraction, int]]]:
    """For every sample the (t, triangle) of all triangles that cover it, unsorted."""
    across, down = camera.column_a, camera.row_b
    vectors = [camera.eye, camera.forward, camera.right_step, camera.up_step]
    k_ab = _bits([*across, *down])
    k = _bits([x for v in vectors for x in v] + list(scene.vertices.reshape(-1)))
    unit = k + k_ab
    e, f = ([_whole(x, unit) for x in v] for v in vectors[:2])
    r, u = ([_whole(x, k) for x in v] for v in vectors[2:])
    near = Fraction(float(camera.near))
    far = None if camera.far == float("inf") else Fraction(float(camera.far))
    vertices = [[_whole(x, unit) for x in v] for v in scene.vertices]
    planes = []
    for index, corner in enumerate(scene.triangles):
        v = [vertices[i] for i in corner]
        planes.append((v, _cross(_minus(v[1], v[0]), _minus(v[2], v[0])), index))
    result = []
    columns, rows = ([_whole(v, k_ab) for v in line] for line in (across, down))
    for ib in rows:
        for ia in columns:
            offset = [ia * r[i] + ib * u[i] for i in range(3)]
            if camera.is_perspective:
                o, d = e, [f[i] + offset[i] for i in range(3)]
            else:
                o, d = [e[i] + offset[i] for i in range(3)], f
            found = []
            for v, n, index in planes:
                slope = _dot(n, d)
                if slope == 0 or (scene.one_sided[index] and slope > 0):
                    continue
                height = _dot(n, _minus(v[0], o))
                if slope < 0:
                    slope, height = -slope, -height
                # t = height / slope.
                if height * near.denominator < near.numerator * slope:
                    continue
                if far is not None and height * far.denominator > far.numerator * slope:
                    continue
                # The point met, times `slope`.
                point = [o[i] * slope + d[i] * height for i in range(3)]
                turns = [
                    _dot(
                        n,
                        _cross(
                            _minus(v[(i + 1) % 3], v[i]),
                            [point[j] - v[i][j] * slope for j in (0, 1, 2)],
                        ),
                    )
                    for i in range(3)
                ]
                if min(turns) >= 0:
                    found.append((Fraction(height, slope), index))
            result.append(found)
    return result


@dataclass
class Sample:
    """What the rules say of one sample. `nearest`: t of `tied`, the triangles that own it for
    certain, None for the background. `doubt`: (t, triangle) of masked ones that may be seen
    before it or level with it. `blend`: by object, the blended triangles that are seen there."""

    nearest: Fraction | None
    tied: list[int]
    doubt: list[tuple[Fraction, int]]
    blend: dict[int, list[int]]


def truth(scene: Scene, camera: Camera, states: States | None = None) -> list[Sample]:
    """Every sample, by the rules. `states`: (sample, triangle) to SOLID, HOLE or BETWEEN, for
    each masked triangle that covers a sample; None: all are in between."""
    result = []
    for sample, found in enumerate(hits(scene, camera)):
        kinds = {i: Alpha(int(scene.alpha[i])) for _, i in found}
        for _, i in found:
            if kinds[i] == Alpha.MASK and states is not None:
                if states[sample, i] == SOLID:
                    kinds[i] = Alpha.OPAQUE
                elif states[sample, i] == HOLE:
                    del kinds[i]
        there = [(t, i) for t, i in sorted(found) if i in kinds]
        opaque = [(t, i) for t, i in there if kinds[i] == Alpha.OPAQUE]
        nearest = min((t for t, _ in opaque), default=None)
        doubt = [
            (t, i) for t, i in there if kinds[i] == Alpha.MASK and (nearest is None or t <= nearest)
        ]
        # Glass is seen for certain before the first thing that may be opaque.
        first = min([t for t, _ in doubt] + ([] if nearest is None else [nearest]), default=None)
        blend: dict[int, list[int]] = {}
        for t, i in there:
            if kinds[i] == Alpha.BLEND and (first is None or t < first):
                blend.setdefault(int(scene.object_of_triangle[i]), []).append(i)
        tied = sorted(i for t, i in opaque if t == nearest)
        result.append(Sample(nearest, tied, doubt, blend))
    return result
