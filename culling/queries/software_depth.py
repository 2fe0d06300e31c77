"""A software depth buffer kept beside GL's: what is drawn is rasterised here once more.

The buffer claims a sample only where a triangle certainly covers it, and never says nearer than
the triangle certainly is. So it owes nothing to GL's snapping or depth steps: what it hides is
hidden from the samples' own rays. With the occlusion-buffer variant of the lazy grid it holds
a single mark per pixel instead of a depth.

A triangle is tested in homogeneous coordinates: with corners h_i = (p.R', p.U', p.F') of
p = vertex - eye, in which the ray of a sample is (a, b, 1), a sample is inside where all three
(h_j x h_k) . (a, b, 1) have one sign, wherever the corners lie; nothing is clipped.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.culler import QueryStats
from visref.scene import Float32, Float64, Int32, Int64, Scene, Units
from visref_culling.gl.device import Target
from visref_culling.gl.view import View
from visref_culling.queries.areas import Area, PixelQueries

# Each corner's coordinates err by fewer than 12 units of 2**-53 of their magnitude (the eye's
# subtraction, the inverse of an almost orthonormal matrix, a product and two sums a row), a
# cross product's entries by 2 * 12 + 3, the sum of three of those by 3 more: under 2**5.
EDGE_UNITS = 2.0**-48

# The determinant is such an edge times a third corner: 30 + 12 + 3 units, under 2**6.
VOLUME_UNITS = 2.0**-47

# A distance to the clip plane: the eye's subtraction (1), the normal's rounding (4), a product and
# three sums: under 2**4 units of the coordinates' and the fourth number's sum.
PLANE_UNITS = 2.0**-49

# A quotient or a weighted mean of depths rounds a few times more; all of it is below 2**-49.
DEPTH_UNITS = 2.0**-49


class Mesh(NamedTuple):
    """All triangles of a scene: `occludes` (t,) bool, those that hide what lies behind them."""

    vertices: Float32
    triangles: Int32
    occludes: NDArray[np.bool_]
    one_sided: NDArray[np.bool_]


class Rays(NamedTuple):
    """The samples: h of a vector from the `eye` is `rows` (3, 3) times it; see the module. `plane`:
    (4,), what a vector from the eye must not lie behind."""

    eye: Float64
    rows: Float64
    perspective: bool
    near: float
    far: float
    column_a: Float64
    row_b: Float64
    plane: Float64


class SoftwareBuffer(PixelQueries):
    """`occludes`: (t,) bool, the triangles that hide what lies behind them. With `marks_only`
    a pixel is 0 where something was drawn, else its view depth, rounded up to float32."""

    z_max = np.inf

    def __init__(
        self, scene: Scene, units: Units, occludes: NDArray[np.bool_], *, marks_only: bool
    ) -> None:
        self.scene, self.units, self.occludes = scene, units, occludes
        self.marks_only = marks_only
        self.depth: Float32 = np.zeros((0, 0), np.float32)

    def update(self, scene: Scene) -> None:
        self.scene = scene

    def begin(self, view: View, target: Target, stats: QueryStats) -> None:
        super().begin(view, target, stats)
        camera = view.camera
        if self.depth.shape != (camera.height, camera.width):
            self.depth = np.empty((camera.height, camera.width), np.float32)
        self.depth.fill(np.inf)

    def depth_of(self, nearest: Float64) -> Float64:
        """(k,) float64: view depth itself. The boxes are larger than their geometry by far
        more than float64 errs."""
        return nearest

    def drawn(self, units: Int64) -> None:
        """Rasterise units, (k,) ids, that were drawn."""
        triangles = self.units.gather(units.astype(np.int32))
        _rasterise(
            mesh_of(self.scene, self.occludes),
            rays_of(self.view),
            triangles,
            self.marks_only,
            self.depth,
        )

    def pixels(self, area: Area) -> Float32:
        """(rows, columns) float32: the area's depths."""
        x0, y0, x1, y1 = area
        return self.depth[y0:y1, x0:x1]


def mesh_of(scene: Scene, occludes: NDArray[np.bool_]) -> Mesh:
    return Mesh(scene.vertices, scene.triangles, occludes, scene.one_sided)


def rays_of(view: View) -> Rays:
    camera = view.camera
    return Rays(
        camera.eye,
        homogeneous_from_relative(view),
        camera.is_perspective,
        camera.near,
        view.far,
        camera.column_a,
        camera.row_b,
        np.zeros(4) if view.clip_plane is None else view.clip_plane,
    )


def homogeneous_from_relative(view: View) -> Float64:
    """(3, 3) float64: h of a vector from the eye. Rows give a and b at unit depth (or, for an
    orthographic view, at any), and view depth."""
    rows = view.camera_from_relative.copy()
    step = float(np.linalg.norm(view.camera.right_step) / np.linalg.norm(_column(view, 0)))
    rows[:2] /= step
    rows[2] *= -1.0
    return rows


def _column(view: View, axis: int) -> Float64:
    return view.camera.world_from_camera[:3, axis]


class Work(NamedTuple):
    """Room for one triangle: h, p, (3, 3) float64; view depths t, sizes of p, (3,); edges (3, 3)
    and how far they may err, by a + b and by 1, (3,)."""

    h: Float64
    p: Float64
    t: Float64
    size: Float64
    edge: Float64
    doubt_a: Float64
    doubt_1: Float64


@njit()
def work() -> Work:
    return Work(
        np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3), np.empty((3, 3)),
        np.empty(3), np.empty(3),
    )  # fmt: skip


@njit(inline="always")
def set_up(mesh, rays, triangle, shape, room):  # type: ignore[no-untyped-def]
    """Whether a triangle may hide anything; the pixels x0, x1, y0, y1 that it may cover (x1, y1
    excluded); and its volume and how far that may err. The rest is in `room`."""
    vertices, triangles, occludes, one_sided = mesh
    eye, rows, perspective, near, far, column_a, row_b, plane = rays
    h, p, t, size, edge, doubt_a, doubt_1 = room
    cuts = plane[0] != 0.0 or plane[1] != 0.0 or plane[2] != 0.0
    height, width = shape
    x0 = x1 = y0 = y1 = 0
    volume = doubt_volume = 0.0
    hides = False
    scale = np.abs(rows[:2]).max()
    if occludes[triangle]:
        behind = False
        for i in range(3):
            v = triangles[triangle, i]
            reach = 0.0
            for axis in range(3):
                p[i, axis] = vertices[v, axis] - eye[axis]
                reach += abs(p[i, axis])
            size[i] = reach
            if cuts:
                ahead = plane[0] * p[i, 0] + plane[1] * p[i, 1] + plane[2] * p[i, 2] + plane[3]
                behind |= ahead <= PLANE_UNITS * (reach + abs(plane[3]))
            for row in range(3):
                h[i, row] = rows[row, 0] * p[i, 0] + rows[row, 1] * p[i, 1] + rows[row, 2] * p[i, 2]
            t[i] = h[i, 2]
            if not perspective:
                h[i, 2] = 1.0
                size[i] = max(reach, 1.0)
        nearest, farthest = min(t[0], t[1], t[2]), max(t[0], t[1], t[2])
        # One that the plane cuts hides nothing: that only draws more.
        if not behind and farthest > near and nearest < far:
            # Bounds on the image, of the part before the near plane.
            low_a = low_b = np.inf
            high_a = high_b = -np.inf
            for i in range(3):
                j = (i + 1) % 3
                for end in range(2):
                    if end == 0:
                        if perspective and t[i] < near:
                            continue
                        x, y, w = h[i, 0], h[i, 1], h[i, 2]
                    else:
                        if not perspective or (t[i] < near) == (t[j] < near):
                            continue
                        s = (near - t[i]) / (t[j] - t[i])
                        x = h[i, 0] + s * (h[j, 0] - h[i, 0])
                        y = h[i, 1] + s * (h[j, 1] - h[i, 1])
                        w = near
                    low_a, high_a = min(low_a, x / w), max(high_a, x / w)
                    low_b, high_b = min(low_b, y / w), max(high_b, y / w)
            # a and b step by 2 a pixel. Bounds that err only leave a sample out.
            x0 = max(0, int(np.ceil(max((low_a - column_a[0]) / 2.0, 0.0))))
            x1 = int(np.floor(min((high_a - column_a[0]) / 2.0, width - 1.0))) + 1
            y0 = max(0, int(np.ceil(max((row_b[0] - high_b) / 2.0, 0.0))))
            y1 = int(np.floor(min((row_b[0] - low_b) / 2.0, height - 1.0))) + 1
            hides = x0 < x1 and y0 < y1
    if hides:
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            edge[i, 0] = h[j, 1] * h[k, 2] - h[j, 2] * h[k, 1]
            edge[i, 1] = h[j, 2] * h[k, 0] - h[j, 0] * h[k, 2]
            edge[i, 2] = h[j, 0] * h[k, 1] - h[j, 1] * h[k, 0]
            # Magnitudes: scale * size for the first two coordinates, size for the third.
            doubt_a[i] = EDGE_UNITS * 2.0 * scale * size[j] * size[k]
            doubt_1[i] = EDGE_UNITS * 2.0 * scale * scale * size[j] * size[k]
        volume = h[0, 0] * edge[0, 0] + h[0, 1] * edge[0, 1] + h[0, 2] * edge[0, 2]
        doubt_volume = VOLUME_UNITS * 6.0 * scale * scale * size[0] * size[1] * size[2]
        # In right, up, forward (left-handed) a front face has a positive volume.
        hides = abs(volume) > doubt_volume and not (one_sided[triangle] and volume < 0.0)
    return hides, (x0, x1, y0, y1), volume, doubt_volume


@njit(inline="always")
def covers(rays, room, volume, doubt_volume, a, b):  # type: ignore[no-untyped-def]
    """Whether the triangle that was set up certainly covers a sample, between near and far, and
    the greatest view depth that it may have there."""
    t, size, edge, doubt_a, doubt_1 = room.t, room.size, room.edge, room.doubt_a, room.doubt_1
    sign = 1.0 if volume > 0.0 else -1.0
    e0 = sign * (edge[0, 0] * a + edge[0, 1] * b + edge[0, 2])
    e1 = sign * (edge[1, 0] * a + edge[1, 1] * b + edge[1, 2])
    e2 = sign * (edge[2, 0] * a + edge[2, 1] * b + edge[2, 2])
    d = abs(a) + abs(b)
    d0, d1 = d * doubt_a[0] + doubt_1[0], d * doubt_a[1] + doubt_1[1]
    d2 = d * doubt_a[2] + doubt_1[2]
    at_least = at_most = np.inf
    # Inward: a sample in doubt is left to whatever lies behind.
    if e0 > d0 and e1 > d1 and e2 > d2:
        total, doubt = e0 + e1 + e2, d0 + d1 + d2
        if rays.perspective:
            at_least = (abs(volume) - doubt_volume) / (total + doubt)
            at_most = (abs(volume) + doubt_volume) / (total - doubt)
            at_least -= DEPTH_UNITS * at_most
            at_most += DEPTH_UNITS * at_most
        else:
            spread = max(t[0], t[1], t[2]) - min(t[0], t[1], t[2])
            mean = (e0 * t[0] + e1 * t[1] + e2 * t[2]) / total
            error = 2.0 * spread * doubt / (total - doubt)
            error += DEPTH_UNITS * (size[0] + size[1] + size[2])
            at_least, at_most = mean - error, mean + error
    return at_least >= rays.near and at_most <= rays.far and at_most < np.inf, at_most


@njit(inline="always")
def rounded_up(depth):  # type: ignore[no-untyped-def]
    """The least float32 that is no less."""
    stored = np.float32(depth)
    return np.nextafter(stored, np.float32(np.inf)) if stored < depth else stored


@njit()
def _rasterise(
    mesh: Mesh, rays: Rays, chosen: NDArray[Any], marks_only: bool, depth: NDArray[Any]
) -> None:
    room = work()
    for triangle in chosen:
        hides, (x0, x1, y0, y1), volume, doubt_volume = set_up(
            mesh, rays, triangle, depth.shape, room
        )
        if not hides:
            continue
        for y in range(y0, y1):
            for x in range(x0, x1):
                covered, at_most = covers(
                    rays, room, volume, doubt_volume, rays.column_a[x], rays.row_b[y]
                )
                if covered and marks_only:
                    depth[y, x] = 0.0
                elif covered:
                    depth[y, x] = min(depth[y, x], rounded_up(at_most))
