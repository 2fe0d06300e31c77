"""Small scenes and cameras for the tests of `culling`, with answers that can be checked by eye."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.conformance.scenes import camera as camera_at
from visref.conformance.scenes import pixel_panel
from visref.registry import make_culler
from visref.scene import Scene

BOX_FACES = np.array(
    [
        *[(0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 4), (1, 5, 4)],
        *[(2, 6, 3), (3, 6, 7), (0, 4, 2), (2, 4, 6), (1, 3, 5), (3, 7, 5)],
    ]
)
QUAD_FACES = np.array([(0, 1, 2), (0, 2, 3)])


def box(centre: tuple[float, float, float], half: float | tuple[float, float, float]):
    """Vertices and outward faces of a box."""
    corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
    return corners * half + np.array(centre), BOX_FACES


def quad(low: tuple[float, float], high: tuple[float, float], z: float):
    """A rectangle facing +Z."""
    (x0, y0), (x1, y1) = low, high
    return np.array([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]), QUAD_FACES


def ortho(width: int, height: int, near: float = 0.0, far: float = 100.0, **more) -> Camera:
    """At the origin looking down -Z, a pixel a world unit, the origin at the image's middle."""
    return Camera(np.eye(4), width, height, near, far, ymag=height / 2, **more)


def perspective(width: int, height: int, near: float = 0.1, far: float = 100.0, **more) -> Camera:
    """At the origin looking down -Z; at depth 1 the image is two units high."""
    return Camera(np.eye(4), width, height, near, far, yfov=math.pi / 2, **more)


def random_scene(rng: np.random.Generator, objects: int = 30) -> Scene:
    """Objects of a few triangles in and around the unit ball, of many sizes, some flat."""
    made = []
    for _ in range(objects):
        count = rng.integers(1, 8)
        points = rng.normal(size=(3 * count, 3)) * 10.0 ** rng.uniform(-2.5, 0.0)
        if rng.random() < 0.3:
            points[:, rng.integers(3)] *= 1e-3
        made.append(("o", points + rng.uniform(-1, 1, 3), np.arange(3 * count).reshape(-1, 3)))
    return Scene.from_objects(made)


def random_camera(rng: np.random.Generator, width: int, height: int) -> Camera:
    """In or near the unit ball, turned anyhow, of any kind."""
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    pose = np.eye(4)
    pose[:3, :3] = axes
    pose[:3, 3] = axes[:, 2] * rng.choice([0.0, 1.0, 3.0]) + rng.normal(size=3) * 0.1
    near = 10.0 ** rng.uniform(-3.0, -0.5)
    far = math.inf if rng.random() < 0.3 else near + 10.0 ** rng.uniform(0.0, 3.0)
    shift = {"shift_x_px": rng.uniform(-2, 2), "shift_y_px": rng.uniform(-2, 2)}
    if rng.random() < 0.25:
        return Camera(pose, width, height, near, far, ymag=10.0 ** rng.uniform(-1, 0.5), **shift)
    return Camera(pose, width, height, near, far, yfov=rng.uniform(0.05, 2.5), **shift)


def owners_by_brute_force(scene: Scene, camera: Camera) -> tuple[NDArray, NDArray, NDArray]:
    """Per sample: nearest triangle (-1 for none), its depth, and by how much the answer is
    clear: the least barycentric coordinate or relative depth gap that would change it.
    Float64 ray by ray over all triangles, two-sided unless marked."""
    count = camera.samples
    owner, depth = np.full(count, -1), np.full(count, np.inf)
    margin = np.full(count, np.inf)
    corners = scene.vertices.astype(np.float64)[scene.triangles]
    for sample in range(count):
        origin, direction = camera.ray(sample % camera.width, sample // camera.width)
        a, b, c = (corners[:, i] - origin for i in range(3))
        weights = np.stack(
            [np.cross(b, c) @ direction, np.cross(c, a) @ direction, np.cross(a, b) @ direction],
            axis=1,
        )
        total = weights.sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            weights = weights / total[:, None]
            normal = np.cross(b - a, c - a)
            t = np.einsum("ij,ij->i", normal, a) / (normal @ direction)
        inside = weights.min(axis=1)
        # A back face of a one-sided triangle is no face at all.
        front = (normal @ direction < 0.0) | ~scene.one_sided
        valid = front & np.isfinite(t) & (t >= camera.near) & (t <= camera.far)
        edges = np.abs(inside[valid & (t <= np.where(valid & (inside >= 0), t, np.inf).min())])
        margin[sample] = edges.min(initial=np.inf)
        hit = np.flatnonzero(valid & (inside >= 0))
        if len(hit):
            hit = hit[np.argsort(t[hit], kind="stable")]
            owner[sample], depth[sample] = hit[0], t[hit[0]]
            if len(hit) > 1:
                margin[sample] = min(margin[sample], t[hit[1]] / t[hit[0]] - 1.0)
    shape = (camera.height, camera.width)
    return owner.reshape(shape), depth.reshape(shape), margin.reshape(shape)


# A wall over the left half of the picture and a panel behind each half; from aside both panels are
# seen, and no wall.
FROM = camera_at()
ASIDE = camera_at(eye=(6.0, 0.0, 0.0))
WALLED = Scene.from_objects(
    [
        ("wall", *pixel_panel(FROM, (-0.5, 31.5), (-0.5, 47.5), 5.0)),
        ("hidden", *pixel_panel(FROM, (12.0, 18.0), (20.0, 28.0), 30.0)),
        ("open", *pixel_panel(FROM, (44.0, 50.0), (20.0, 28.0), 30.0)),
    ]
)


def drawn_by(spec: str, cameras: list[Camera], scene: Scene = WALLED) -> list[list[int]]:
    """The units that a culler draws of a scene, camera after camera."""
    culler = make_culler(spec)
    culler.prepare(scene)
    try:
        return [sorted(culler.cull(camera).unit_ids.tolist()) for camera in cameras]
    finally:
        culler.close()
