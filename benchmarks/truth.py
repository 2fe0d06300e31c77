"""A frame's truth by object: the Embree engine against the same job written with Open3D."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from statistics import median

import numpy as np
import open3d
from numpy.typing import NDArray

from visref.camera import Camera, look_at
from visref.engines.embree import EmbreeEngine
from visref.scene import Scene
from visref.visibility import objects_seen

TITLE = "Truth per frame, 768,000 triangles, 4,000 objects, 1280x960, near 0.1 m"

ROUNDS = 9
OBJECTS, SIDE_CELLS = 4000, 4


def town(seed: int = 7, count: int = OBJECTS) -> Scene:
    """Boxes on a grid, each face 4 x 4 quads: 192 triangles an object."""
    rng = np.random.default_rng(seed)
    points, faces = _tessellated_box(SIDE_CELLS)
    columns = math.isqrt(count) + 1
    objects = []
    for i in range(count):
        size = rng.uniform((8.0, 3.0, 8.0), (18.0, 30.0, 18.0))
        at = 20.0 * np.array([i % columns - columns / 2, 0.0, i // columns - columns / 2])
        objects.append((f"box {i}", points * size + at, faces))
    return Scene.from_objects(objects)


def _tessellated_box(cells: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A unit box that stands on y = 0, its vertices not shared between faces."""
    line = np.linspace(-0.5, 0.5, cells + 1)
    u, v = (grid.ravel() for grid in np.meshgrid(line, line, indexing="ij"))
    corner = np.add.outer(np.arange(cells) * (cells + 1), np.arange(cells)).ravel()
    step = np.array([[0, cells + 1, cells + 2], [0, cells + 2, 1]])
    quads = (corner[:, None, None] + step).reshape(-1, 3)
    points, faces = [], []
    for axis in range(3):
        for side in (-0.5, 0.5):
            face = np.empty((len(u), 3))
            face[:, axis] = side
            face[:, (axis + 1) % 3] = u * 2.0 * side
            face[:, (axis + 2) % 3] = v
            faces.append(quads + len(points) * len(u))
            points.append(face + np.array([0.0, 0.5, 0.0]))
    return np.concatenate(points), np.concatenate(faces)


def cameras() -> dict[str, Camera]:
    def camera(eye: tuple[float, float, float], target: tuple[float, float, float]) -> Camera:
        return Camera(look_at(eye, target), 1280, 960, near=0.1, far=math.inf, yfov=1.0472)

    return {
        "street": camera((10.0, 1.7, 0.0), (10.0, 6.0, -100.0)),
        "roofs": camera((100.0, 40.0, 500.0), (100.0, 0.0, 0.0)),
        "overview": camera((0.0, 200.0, 700.0), (0.0, 0.0, 0.0)),
    }


class PlainOpen3D:
    """The job as a script would do it: pinhole rays, one cast, counts by object.

    `numpy_rays` makes the rays with NumPy from the samples' definition; else with Open3D's
    own `create_rays_pinhole`, which knows neither near nor a lens shift.
    """

    def __init__(self, scene: Scene, *, numpy_rays: bool) -> None:
        tensor = open3d.core.Tensor.from_numpy
        self.scene, self.numpy_rays = scene, numpy_rays
        self.caster = open3d.t.geometry.RaycastingScene()
        self.caster.add_triangles(
            tensor(scene.vertices.copy()), tensor(scene.triangles.astype(np.uint32))
        )

    def counts(self, camera: Camera) -> NDArray[np.int64]:
        answer = self.caster.cast_rays(self._numpy(camera) if self.numpy_rays else _pinhole(camera))
        primitive = answer["primitive_ids"].numpy().ravel()
        hit = primitive != self.caster.INVALID_ID
        owners = self.scene.object_of_triangle[primitive[hit]]
        return np.bincount(owners, minlength=self.scene.object_count)

    @staticmethod
    def _numpy(camera: Camera) -> open3d.core.Tensor:
        step_x = (camera.column_a[:, None] * camera.right_step).astype(np.float32)
        step_y = (camera.row_b[:, None] * camera.up_step + camera.forward).astype(np.float32)
        rays = np.empty((camera.height, camera.width, 6), np.float32)
        rays[..., :3] = camera.eye
        np.add(step_x[None], step_y[:, None], out=rays[..., 3:])
        return open3d.core.Tensor.from_numpy(rays)


def _pinhole(camera: Camera) -> open3d.core.Tensor:
    focal = 0.5 / float(np.linalg.norm(camera.right_step))
    intrinsic = np.array(
        [[focal, 0.0, camera.width / 2], [0.0, focal, camera.height / 2], [0.0, 0.0, 1.0]]
    )
    # Open3D's camera looks along +Z with y down.
    extrinsic = np.diag([1.0, -1.0, -1.0, 1.0]) @ camera.camera_from_world
    return open3d.t.geometry.RaycastingScene.create_rays_pinhole(
        open3d.core.Tensor(intrinsic),
        open3d.core.Tensor(np.ascontiguousarray(extrinsic)),
        camera.width,
        camera.height,
    )


def alternate(jobs: list[Callable[[], object]], rounds: int) -> list[float]:
    """Median seconds of each job; the jobs take turns, so that all meet the same machine."""
    seconds: list[list[float]] = [[] for _ in jobs]
    for turn in range(rounds + 1):
        for job, spent in zip(jobs, seconds, strict=True):
            start = time.perf_counter()
            job()
            if turn:  # The first turn warms caches and compiled code.
                spent.append(time.perf_counter() - start)
    return [median(spent) for spent in seconds]


def run() -> list[dict[str, str]]:
    scene = town()
    engine = EmbreeEngine(scene)
    plain = [PlainOpen3D(scene, numpy_rays=choice) for choice in (True, False)]
    rows = []
    for name, camera in cameras().items():
        seen = objects_seen(engine.frame(camera), scene)
        by_plain = [job.counts(camera) for job in plain]
        ours, with_numpy, with_pinhole = alternate(
            [
                lambda camera=camera: objects_seen(engine.frame(camera), scene),
                lambda camera=camera: plain[0].counts(camera),
                lambda camera=camera: plain[1].counts(camera),
            ],
            ROUNDS,
        )
        rows.append(
            {
                "view": name,
                "objects seen": str(int(seen.visible.sum())),
                "pixels that differ": ", ".join(
                    str(int(np.abs(counts - seen.samples).sum())) for counts in by_plain
                ),
                "visref embree": f"{ours * 1e3:.1f} ms",
                "Open3D, NumPy rays": f"{with_numpy * 1e3:.1f} ms",
                "Open3D, its own rays": f"{with_pinhole * 1e3:.1f} ms",
                "ratio (NumPy rays)": f"{ours / with_numpy:.2f}",
                "ratio (its own rays)": f"{ours / with_pinhole:.2f}",
            }
        )
    engine.close()
    return rows
