"""Truth by Embree rays, through embreex."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from visref.engines.embree_packets import PacketScene, load_library
from visref.engines.in_motion import Places, nearer
from visref.engines.packet_loops import BACK, FRONT, Aim
from visref.engines.ray_kernels import SampleGrid
from visref.engines.rays import RayEngine, Start
from visref.options import Option
from visref.scene import Float32, Int32, Int64, Scene


class EmbreeEngine(RayEngine):
    """Embree, one thread per core: packets of rays where embreex brings the library for it, else
    single rays.

    `robust` is Embree's scene flag of that name. Without it the tests of triangles and boxes
    are rounded as comes, so that rays slip through shared edges and past thin boxes.
    """

    name = "embree"
    summary = "Embree rays (float32, robust mode), decided in float64"
    options: ClassVar[Mapping[str, Option]] = {
        "robust": Option(True, "Embree's robust mode; without it rays slip through shared edges")
    }

    def __init__(self, scene: Scene, *, threads: int | None = None, robust: bool = True) -> None:
        self._robust = robust
        super().__init__(scene, threads=threads)

    def _build(self, vertices: Float32, triangles: Int32) -> None:
        library = load_library()
        self._sides: NDArray[np.uint8] | None = None
        self._casts = (
            SingleRays(vertices, triangles, robust=self._robust)
            if library is None
            else PacketScene(library, vertices, triangles, robust=self._robust)
        )

    def _build_moving(self, vertices: Float32, triangles: Int32, places: Places) -> None:
        self._sides = None
        self._casts.pose(vertices, triangles, places)

    def _nearest(self, rays: Float32) -> Int32:
        return self._casts.nearest(rays)

    def _plain_sides(self, casts: PacketScene) -> NDArray[np.uint8]:
        """`Aim.plain`, of the pose at hand."""
        sides = self._sides
        if sides is None:
            one_sided = self._mesh.one_sided[self._solid]
            sides = np.where(one_sided, FRONT, FRONT | BACK).astype(np.uint8)
            sides[~casts.well_shaped(len(self._solid))] = 0
            # Not before it is whole: others may be casting.
            self._sides = sides
        return sides

    def _cast_all(
        self, grids: Sequence[SampleGrid], starts: Sequence[Start], triangle: Int32
    ) -> Int64:
        casts = self._casts
        if not isinstance(casts, PacketScene) or any(one.scattered or one.clips for one in grids):
            return super()._cast_all(grids, starts, triangle)
        place = self.rebase, self.scale
        reached = self._crew.by_turns(
            lambda view: casts.reached(grids[view], *place, starts[view][1]), range(len(grids))
        )
        aim = Aim.of(
            casts.lanes, grids, starts, reached, *place, self._mesh, self._solid,
            self._plain_sides(casts),
        )  # fmt: skip
        turns = np.zeros(1, np.int64)
        parts = self._crew.on_all(lambda _: casts.cast(aim, turns, triangle), self._casting_workers)
        pending: Int64 = np.sum(parts, axis=0)
        return pending


class SingleRays:
    """Triangles in Embree, cast a ray at a time by embreex."""

    def __init__(self, vertices: Float32, triangles: Int32, *, robust: bool) -> None:
        self._robust = robust
        self._still = self._built(vertices, triangles)
        self._moving: tuple[EmbreeScene, TriangleMesh | None] | None = None

    def pose(self, vertices: Float32, triangles: Int32, places: Places) -> None:
        """As `PacketScene.pose`."""
        self._moving = self._built(vertices, triangles)
        self._places = places

    def _built(
        self, vertices: Float32, triangles: Int32
    ) -> tuple[EmbreeScene, TriangleMesh | None]:
        # Stated, never left to the library's default.
        scene = EmbreeScene(robust=self._robust)
        mesh = TriangleMesh(scene, vertices, triangles) if len(triangles) else None
        # The first cast builds the hierarchy, which two threads must not do at once.
        scene.run(np.zeros((1, 3), np.float32), np.array([[0, 0, 1]], np.float32))
        return scene, mesh

    def nearest(self, rays: Float32) -> Int32:
        """(n,) int32, the nearest triangle along each ray (n, 6), -1 for none."""
        origins, directions = rays[:, :3], rays[:, 3:]
        if self._moving is None:
            primitives: Int32 = self._still[0].run(origins, directions)
            return primitives
        found = []
        for scene, _ in (self._still, self._moving):
            answer = scene.run(origins, directions, output=1)
            found.append((answer["primID"], answer["tfar"]))
        return nearer(found[0], found[1], self._places)
