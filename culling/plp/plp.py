"""Prioritized-Layered Projection: draw the likeliest cells until a budget is spent.

Klosowski, Silva 2001, section 2.1 (and the papers that it cites): space is an octree whose leaves
are the cells; a front of candidate cells grows from the eye's; the one that most likely shows, by
the solidity of what lies before it, is projected next, its triangles are drawn, and its neighbours
join the front. No depth is asked. What the budget leaves out may be visible, and what it draws
may be hidden, so the method promises nothing (the papers call it aggressive): it is measured.

Departures from the paper:

- Cells outside the view frustum are not entered. A cell that a visible point's ray passes on its
  way from the near plane meets the frustum, so none is cut off by that.
- The front starts with every cell that the near plane may cut in view, not the eye's alone, and
  where a part of the near plane's rectangle lies beyond one of the root's faces, with every cell
  in view along that face: a ray enters the octree in one of these. Where a clip plane cuts off
  what is nearer, the front also starts with every cell that the plane may cut.
- The traversal ends with the cell whose triangles reach the budget, so it may pass it by less
  than a leaf's triangles.
- A triangle in several cells is drawn, and counted, once.
- It is for scenes that stand still: the paper builds its octree before the first frame and does not
  speak of motion. The cells are the units here, fixed once, and a triangle that moves would leave
  the cells that it is in; so a scene that moves is refused (`moves`).
- Solidity is the area of a cell's triangles (`plp.solidity`), not their number; the front
  is ordered by the pixels that a cell may show at (`plp.traversal`), not by solidity alone.
  `solidity=count` is the paper's: the number of a cell's primitives, and the front ordered by
  what has accumulated of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from visref.camera import Camera
from visref.culler import Option, Promise
from visref.errors import InputError
from visref.scene import Float64, Int64, Scene, Units
from visref_culling.boxes.conservative import cut_by_plane
from visref_culling.gl.item_buffer import GLRaster
from visref_culling.gl.shared_geometry import Marks, SharedGeometry
from visref_culling.method import GL_OPTIONS, Frame, GLCuller, phase
from visref_culling.plp.octree import Links, Octree, octree_of
from visref_culling.plp.solidity import by_area, by_count
from visref_culling.plp.traversal import FrontTraversal, near_corners

# The paper's fastest budget for a million triangles (section 4), and its leaves.
PLP_OPTIONS: dict[str, Option] = {
    "budget": Option(25000, "triangles drawn before anything is asked, or at all for plp"),
    "leaf": Option(5000, "an octree cell has fewer triangles than this"),
    "solidity": Option(
        "area",
        "cells come by the pixels that the area of what is before them leaves; or, as in the "
        "paper, by the number of primitives before them",
        ("area", "count"),
    ),
}


class PLPCulling(GLCuller):
    """PLP alone; see the module."""

    name = "plp"
    memory = 0
    summary = (
        "Klosowski 2001: octree cells, the likeliest to show first, up to a budget of triangles"
    )
    notes_asked = True
    promise = Promise.APPROXIMATE
    options: ClassVar[Mapping[str, Option]] = {**PLP_OPTIONS, **GL_OPTIONS}
    geometry: SharedGeometry | None

    def __init__(
        self,
        *,
        budget: int = 25000,
        leaf: int = 5000,
        solidity: str = "area",
        depth: int = 24,
        fragments: bool = False,
    ) -> None:
        super().__init__(depth=depth, fragments=fragments)
        if budget < 0:
            raise InputError(f"budget is {budget}", place="budget", fix="give 0 or more triangles")
        if leaf < 2:
            raise InputError(f"leaf is {leaf}", place="leaf", fix="give 2 or more triangles")
        self.budget, self.leaf = budget, leaf
        self.counts_primitives = solidity == "count"

    def prepare(self, scene: Scene) -> Units:
        units = super().prepare(scene)
        self.links = self.links_of(self.octree)
        self.transmittance = np.exp(-self.solidity_of(self.octree))
        self.marks = Marks(scene.triangle_count)
        return units

    @property
    def moves(self) -> bool:
        """No: the octree's cells are the units, and where a triangle moves it is in other cells."""
        return False

    def bounds(self) -> None:
        """None: a cell's box holds what its triangles have inside it and no more; the rest of them
        is in other cells. It is no box that contains what the unit draws."""

    def open(self, camera: Camera) -> Frame:
        assert self.geometry is not None
        self.geometry.begin()
        return super().open(camera)

    def decide(self, frame: Frame) -> None:
        self.begin_walk(frame)
        self.estimate(frame)

    # The steps.

    def octree_of(self, scene: Scene) -> Octree:
        return octree_of(scene, self.leaf)

    def units_of(self, scene: Scene) -> Units:
        self.octree = self.octree_of(scene)
        return self.octree.units

    def unit_bounds(self, scene: Scene, units: Units) -> Float64:
        """(n, 2, 3) float64 world boxes, the cells themselves: what a triangle has outside one
        is in others."""
        return self.octree.bounds

    def geometry_of(self, scene: Scene) -> SharedGeometry:
        return SharedGeometry(self.device, scene, self.units, self.occluders(scene))

    def raster_of(self, scene: Scene) -> GLRaster | None:
        return None

    def links_of(self, octree: Octree) -> Links:
        return octree.links()

    def solidity_of(self, octree: Octree) -> Float64:
        """How much of the light through it each cell stops: (n, 3) float64, by axis, or (n,)."""
        return by_count(octree) if self.counts_primitives else by_area(self.scene, octree)

    def seeds(self, frame: Frame) -> Int64:
        """(n,) int64 ids of the cells that the front starts with."""
        octree, corners = self.octree, near_corners(frame.view)
        beyond = np.stack([corners < octree.low, corners > octree.low + octree.side])
        # A corner that rounding puts on the wrong side of a face is inside the face's cells
        # inflated, so they hold a part of the near plane: one of the two finds them.
        faces = (octree.hull() & beyond.any(axis=1)).any(axis=(1, 2))
        starts = np.union1d(frame.ids[frame.sure], np.flatnonzero(faces))
        return np.union1d(starts, frame.ids[cut_by_plane(frame.view, frame.boxes)])

    def begin_walk(self, frame: Frame) -> None:
        with phase(frame.stats, "traverse"):
            self.walk = FrontTraversal(
                self.octree, self.links, self.transmittance, self.marks, frame.view, frame.ids
            )
            self.walk.seed(self.seeds(frame))
            self.place_of_cell = np.full(self.octree.leaf_count, -1)
            self.place_of_cell[frame.ids] = np.arange(len(frame.ids))
        self.observe("seeds", cells=self.walk.front())

    def estimate(self, frame: Frame) -> None:
        """Run PLP on the budget."""
        with phase(frame.stats, "traverse"):
            cells = self.walk.project(self.budget)
        self.observe("estimate", cells=cells)
        self.draw_cells(frame, cells)
        frame.stats.triangles_estimated = frame.stats.triangles_drawn

    def draw_cells(self, frame: Frame, cells: Int64) -> None:
        """Draw what the cells, (n,) int64 ids, hold; an empty one has nothing to draw."""
        self.draw(frame, self.place_of_cell[cells[self.units.sizes[cells] > 0]])
