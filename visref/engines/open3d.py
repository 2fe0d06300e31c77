"""Truth by Open3D's ray casting: a second opinion on the same samples (extra `open3d`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from visref.engines.in_motion import Places, nearer
from visref.engines.rays import RayEngine
from visref.errors import InputError
from visref.scene import Float32, Int32, Scene


class Open3DEngine(RayEngine):
    """Open3D's RaycastingScene, which runs its own threads on each tile.

    Raises InputError where Open3D is not installed.
    """

    name = "open3d"
    summary = "Open3D's RaycastingScene, decided in float64 (needs the extra 'open3d')"

    # Large, because every cast starts and joins the library's threads.
    tile_samples = 1 << 18

    def __init__(self, scene: Scene, *, threads: int | None = None) -> None:
        try:
            import open3d
        except ImportError as error:
            raise InputError(
                "the engine 'open3d' needs Open3D, which does not import here",
                fix="pip install 'visref[open3d]', or use the engine 'embree'",
            ) from error
        self._open3d = open3d
        super().__init__(scene, threads=threads)

    def _build(self, vertices: Float32, triangles: Int32) -> None:
        self._still = self._built(vertices, triangles)
        self._moving: Any = None
        self._places: Places | None = None

    def _build_moving(self, vertices: Float32, triangles: Int32, places: Places) -> None:
        self._moving = self._built(vertices, triangles)
        self._places = places

    def _built(self, vertices: Float32, triangles: Int32) -> Any:
        tensor = self._open3d.core.Tensor.from_numpy
        scene = self._open3d.t.geometry.RaycastingScene(nthreads=self._workers)
        if len(triangles):
            scene.add_triangles(tensor(vertices), tensor(triangles.astype(np.uint32)))
        return scene

    @property
    def _casting_workers(self) -> int:
        # cast_rays holds the interpreter's lock: more of ours would only wait for it.
        return 1

    def _nearest(self, rays: Float32) -> Int32:
        still = self._met(self._still, rays)
        if self._places is None:
            return still[0]
        return nearer(still, self._met(self._moving, rays), self._places)

    def _met(self, scene: Any, rays: Float32) -> tuple[Int32, Float32]:
        answer = scene.cast_rays(self._open3d.core.Tensor.from_numpy(rays), nthreads=self._workers)
        # "No hit" is the greatest uint32, so -1.
        return answer["primitive_ids"].numpy().view(np.int32), answer["t_hit"].numpy()
