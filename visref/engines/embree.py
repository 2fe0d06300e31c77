"""Truth by Embree rays, through embreex."""

from __future__ import annotations

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from visref.engines.rays import RayEngine
from visref.scene import Float32, Int32


class EmbreeEngine(RayEngine):
    """Embree, single rays in its robust mode, a thread a core."""

    name = "embree"
    summary = "Embree rays (float32, robust mode), decided in float64"

    def _build(self, vertices: Float32, triangles: Int32) -> None:
        # Robust is stated, never left to a default: without it rays slip through edges.
        self._embree = EmbreeScene(robust=True)
        self._geometry = TriangleMesh(self._embree, vertices, triangles)
        # The first cast builds the hierarchy, which two threads must not do at once.
        self._nearest(np.array([[0, 0, 0, 0, 0, 1]], np.float32))

    def _nearest(self, rays: Float32) -> Int32:
        primitives: Int32 = self._embree.run(rays[:, :3], rays[:, 3:])
        return primitives
