"""Truth by Embree rays, through embreex."""

from __future__ import annotations

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from visref.engines.embree_packets import PacketScene, load_library
from visref.engines.rays import RayEngine
from visref.scene import Float32, Int32


class EmbreeEngine(RayEngine):
    """Embree in its robust mode, a thread a core: packets of eight rays where embreex
    brings the library for it, else single rays."""

    name = "embree"
    summary = "Embree rays (float32, robust mode), decided in float64"

    def _build(self, vertices: Float32, triangles: Int32) -> None:
        library = load_library()
        self._casts = (
            SingleRays(vertices, triangles)
            if library is None
            else PacketScene(library, vertices, triangles)
        )

    def _nearest(self, rays: Float32) -> Int32:
        return self._casts.nearest(rays)


class SingleRays:
    """Triangles in Embree, robust mode, cast a ray at a time by embreex."""

    def __init__(self, vertices: Float32, triangles: Int32) -> None:
        # Robust is stated, never left to a default: without it rays slip through edges.
        self._scene = EmbreeScene(robust=True)
        self._geometry = TriangleMesh(self._scene, vertices, triangles)
        # The first cast builds the hierarchy, which two threads must not do at once.
        self.nearest(np.array([[0, 0, 0, 0, 0, 1]], np.float32))

    def nearest(self, rays: Float32) -> Int32:
        """(n,) int32, the nearest triangle along each ray (n, 6), -1 for none."""
        primitives: Int32 = self._scene.run(rays[:, :3], rays[:, 3:])
        return primitives
