"""The sample rule by the book: one sample, one triangle at a time, in integers.

Deliberately simple, and written apart from visref.exact: it finds the point where the ray meets
the plane, and asks on which side of each edge that point lies, within the plane.
"""

from __future__ import annotations

from fractions import Fraction

from visref.camera import Camera
from visref.scene import Alpha, Scene


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


def truth(scene: Scene, camera: Camera):
    """Per sample (t or None, tied opaque triangles, undecided, {blend object: triangles}).

    A blended object counts where its sample is decided and it does not own that sample anyway.
    """
    result = []
    for found in hits(scene, camera):
        opaque = [(t, i) for t, i in found if scene.alpha[i] == Alpha.OPAQUE]
        nearest = min((t for t, _ in opaque), default=None)
        tied = sorted(i for t, i in opaque if t == nearest)
        undecided = any(
            scene.alpha[i] == Alpha.MASK and (nearest is None or t <= nearest) for t, i in found
        )
        owners = {int(scene.object_of_triangle[i]) for i in tied}
        blend: dict[int, list[int]] = {}
        for t, i in found:
            owner = int(scene.object_of_triangle[i])
            before = scene.alpha[i] == Alpha.BLEND and (nearest is None or t < nearest)
            if before and not undecided and owner not in owners:
                blend.setdefault(owner, []).append(i)
        result.append((nearest, tied, undecided, blend))
    return result
