"""Triangles in camera space, cut off at the near plane: what small rasterisers begin with."""

from __future__ import annotations

from visref.compiled import njit


@njit(inline="always")
def _in_camera_space(pose, vertices, v):  # type: ignore[no-untyped-def]
    """Vertex `v` of (v, 3) `vertices`: how far to the right, up and ahead of a camera whose
    `world_from_camera` is `pose`, (4, 4) float64."""
    dx = vertices[v, 0] - pose[0, 3]
    dy = vertices[v, 1] - pose[1, 3]
    dz = vertices[v, 2] - pose[2, 3]
    x = pose[0, 0] * dx + pose[1, 0] * dy + pose[2, 0] * dz
    y = pose[0, 1] * dx + pose[1, 1] * dy + pose[2, 1] * dz
    z = pose[0, 2] * dx + pose[1, 2] * dy + pose[2, 2] * dz
    return x, y, -z


@njit(inline="always")
def in_camera_space(pose, near, vertices, triangle):  # type: ignore[no-untyped-def]
    """The corners of a `triangle`, (3,) of (v, 3) `vertices`: how far to the right, up and ahead of
    a camera each is; and how many are at the near plane or beyond."""
    p = _in_camera_space(pose, vertices, triangle[0])
    q = _in_camera_space(pose, vertices, triangle[1])
    r = _in_camera_space(pose, vertices, triangle[2])
    return p, q, r, (p[2] >= near) + (q[2] >= near) + (r[2] >= near)


@njit(inline="always")
def cut_off(near, p, q, r, polygon):  # type: ignore[no-untyped-def]
    """What of a triangle of camera space lies at the near plane or beyond: its corners, in order,
    into `polygon`, (4, 3) float64; returns how many."""
    count = 0
    for i in range(3):
        if i > 0:
            p, q, r = q, r, p
        if p[2] >= near:
            for axis in range(3):
                polygon[count, axis] = p[axis]
            count += 1
        if (p[2] >= near) != (q[2] >= near):
            t = (near - p[2]) / (q[2] - p[2])
            for axis in range(2):
                polygon[count, axis] = p[axis] + t * (q[axis] - p[axis])
            polygon[count, 2] = near
            count += 1
    return count
