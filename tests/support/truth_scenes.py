"""Scenes and a slow float64 reference for the tests of the truth engines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.scene import Alpha, Scene
from visref.visibility import BACKGROUND

# A sample this near to an edge, in pixels, or with two depths this near to each other,
# relatively, may go either way in float32: rays and vertices round by some 2^-22 of the
# scene's size, and these scenes' pixels are 2^-10 of it or larger.
DOUBT_PX = 2.0**-11
DOUBT_DEPTH = 2.0**-18


@dataclass
class Part:
    """One object of a scene made by `build`."""

    points: NDArray[np.float64]
    faces: NDArray[np.int64]
    alpha: Alpha = Alpha.OPAQUE
    one_sided: bool = False


def build(*parts: Part) -> Scene:
    plain = Scene.from_objects([("part", part.points, part.faces) for part in parts])
    sizes = [len(part.faces) for part in parts]
    return Scene(
        plain.vertices,
        plain.triangles,
        plain.object_offsets,
        plain.names,
        one_sided=np.repeat(np.array([part.one_sided for part in parts], np.bool_), sizes),
        alpha=np.repeat(np.array([part.alpha for part in parts], np.uint8), sizes),
    )


def quad(
    camera: Camera,
    pixels: tuple[float, float, float, float],
    depth: float,
    *,
    turned: bool = False,
    alpha: Alpha = Alpha.OPAQUE,
    one_sided: bool = False,
) -> Part:
    """Two triangles, square to the view at `depth`, that fill the pixels x0 … x1 - 1, y0 …
    y1 - 1: their edges lie on pixel borders. They face the camera unless `turned`."""
    x0, y0, x1, y1 = pixels
    a = np.array([x0, x1, x1, x0]) * 2.0 - camera.width + 2.0 * camera.shift_x_px
    b = camera.height - np.array([y1, y1, y0, y0]) * 2.0 - 2.0 * camera.shift_y_px
    reach = depth if camera.is_perspective else 1.0
    side = a[:, None] * camera.right_step + b[:, None] * camera.up_step
    points = camera.eye + depth * camera.forward + reach * side
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Part(points, faces[:, ::-1] if turned else faces, alpha, one_sided)


def filled(camera: Camera, *pixels: tuple[int, int, int, int]) -> NDArray[np.bool_]:
    """(height, width) bool, True in the given rectangles."""
    result = np.zeros((camera.height, camera.width), np.bool_)
    for x0, y0, x1, y1 in pixels:
        result[y0:y1, x0:x1] = True
    return result


def box(centre: tuple[float, float, float], half: tuple[float, float, float]) -> Part:
    """A closed box, its faces counter-clockwise seen from outside."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [[f[0], f[i], f[i + 1]] for f in faces for i in (1, 2)]
    return Part(corners * half + centre, np.array(triangles))


def random_soup(seed: int, triangles: int = 60, at: float = 0.0) -> Scene:
    """Triangles of all sizes before a camera at the origin, three an object."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform((-2, -2, -9), (2, 2, 0), (triangles, 1, 3))
    points = centre + rng.normal(size=(triangles, 3, 3)) * rng.uniform(0.05, 2.0, (triangles, 1, 1))
    return build(
        *(
            Part(points[i : i + 3].reshape(-1, 3) + at, np.arange(9).reshape(3, 3))
            for i in range(0, triangles, 3)
        )
    )


@dataclass
class Reference:
    """`owner`: (height, width) triangle ids by float64 brute force; `doubtful`: samples so near
    to an edge, a crossing, near or far that float32 may decide otherwise."""

    owner: NDArray[np.int64]
    doubtful: NDArray[np.bool_]


def brute_force(scene: Scene, camera: Camera) -> Reference:
    """Every triangle against every sample, by edge functions and planes in float64."""
    a, b = np.meshgrid(camera.column_a, camera.row_b)
    side = a[..., None] * camera.right_step + b[..., None] * camera.up_step
    if camera.is_perspective:
        origin, direction = np.zeros(3), camera.forward + side
    else:
        origin, direction = side, np.broadcast_to(camera.forward, side.shape)
    nearest = np.full(a.shape, np.inf)
    owner = np.full(a.shape, BACKGROUND)
    doubtful = np.zeros(a.shape, np.bool_)
    for t, ids in enumerate(scene.triangles):
        if not scene.present[t]:
            continue
        p = scene.vertices[ids].astype(np.float64) - camera.eye
        normal = np.cross(p[1] - p[0], p[2] - p[0])
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = ((p[0] - origin) @ normal) / (direction @ normal)
        signs, distance = [], np.full(a.shape, np.inf)
        for i in range(3):
            edge = np.cross(p[i] - origin, p[(i + 1) % 3] - origin)
            value = np.einsum("...i,...i", edge, direction)
            # The edge function is linear in (a, b); a pixel is two of either.
            slope = np.hypot(*(2.0 * step for step in np.gradient(value, 2.0)))
            signs.append(value)
            distance = np.minimum(distance, np.abs(value) / slope)
        inside = (np.min(signs, axis=0) >= 0) | (np.max(signs, axis=0) <= 0)
        tolerance = DOUBT_DEPTH * np.abs(depth)
        contends = (
            (depth >= camera.near - tolerance)
            & (depth <= camera.far + tolerance)
            & (depth <= nearest + tolerance)
        )
        at_limit = np.minimum(np.abs(depth - camera.near), np.abs(depth - camera.far)) < tolerance
        close = inside & (np.abs(depth - nearest) <= tolerance)
        doubtful |= contends & ((distance < DOUBT_PX) | (inside & at_limit) | close)
        counts = inside & (depth >= camera.near) & (depth <= camera.far) & (depth < nearest)
        nearest[counts], owner[counts] = depth[counts], t
    return Reference(owner, doubtful)
