"""PLP and cPLP with one step broken, on the scenes of `tests.mutants.plp.scenes` beside the
conformance suite's.

Klosowski, Silva 2001: PLP draws the cells that seem to show until a budget is spent, and promises
nothing; cPLP then asks the cells of the front until none is left.
"""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np

from tests.mutants.common import COMMON, common
from tests.mutants.harness import mutant, not_here
from tests.mutants.plp.contract import SUITE
from visref.scene import Units
from visref_culling.gl.shared_geometry import SharedGeometry
from visref_culling.plp import ConservativePLPCulling, PLPCulling
from visref_culling.plp.octree import Links
from visref_culling.plp.traversal import UNMET
from visref_culling.queries.histogram import HistogramQueries
from visref_culling.queries.item_buffer_query import TILE_PX, ItemBufferQueries

PLP = SUITE.method("plp", PLPCulling, leaf=4, budget=12)
PLP_COUNT = SUITE.method("plp-count", PLPCulling, leaf=4, budget=12, solidity="count")


def conservative(name: str, **options):
    return SUITE.method(f"cplp-{name}", ConservativePLPCulling, leaf=4, budget=12, **options)


EXT = conservative("ext", query="fragment-histogram")
HP = conservative("hp", query="occlusion-query")
IB = conservative("ib", query="item-buffer")
HG = conservative("hg", query="histogram")
IB_RESTORE = conservative("ib-restore", query="item-buffer", image="restore")
HG_RESTORE = conservative("hg-restore", query="histogram", image="restore")

ITEMS = (IB, HG)
RESTORES = (IB_RESTORE, HG_RESTORE)
WAYS = (EXT, HP, *ITEMS)
ALL = (*WAYS, *RESTORES)

SUITE.kept_by(*ALL, PLP, PLP_COUNT)
SUITE.kept_by(EXT, solidity="count")


def item_step(step: type) -> type:
    """A culler's step that breaks `step`, a class to put before the item buffer's own."""

    class Broken:
        __doc__ = step.__doc__

        def items_of(self, query):
            kind = HistogramQueries if query == "histogram" else ItemBufferQueries
            return type(step.__name__, (step, kind), {})(self.device)

    Broken.__name__ = step.__name__
    return Broken


# Traversal.


@mutant("U1", of=(EXT,), caught_by="walk_through_a_city")
class StopsAtTheBudget:
    """What PLP's budget leaves out is never asked."""

    def complete(self, frame):
        frame.stats.iterations = 0


def filtered(links: Links, keep: np.ndarray) -> Links:
    """The links that `keep` marks."""
    before = np.concatenate([[0], np.cumsum(keep)])
    return links._replace(
        offsets=before[links.offsets],
        to=links.to[keep],
        axis=links.axis[keep],
    )


@mutant("U5", of=(EXT,), caught_by="crowd")
class EqualSizeNeighboursOnly:
    """A cell has as neighbours only cells of its own size."""

    def links_of(self, octree):
        links = super().links_of(octree)
        start = np.repeat(np.arange(octree.leaf_count), np.diff(links.offsets))
        return filtered(links, octree.width[start] == octree.width[links.to])


@mutant("U6", of=(EXT,), caught_by="seen_from_outside")
class EmptyLeavesSkipped:
    """Nobody walks through a cell without triangles."""

    def links_of(self, octree):
        links = super().links_of(octree)
        return filtered(links, octree.units.sizes[links.to] > 0)

    def seeds(self, frame):
        cells = super().seeds(frame)
        return cells[self.octree.units.sizes[cells] > 0]


@mutant("U7", of=(EXT,), caught_by="walk_through_a_city")
class OnlyInTheCentroidsLeaf:
    """A triangle belongs to the one cell that holds its centroid."""

    def octree_of(self, scene):
        octree = super().octree_of(scene)
        units = octree.units
        cell = np.repeat(np.arange(units.count), units.sizes)
        centroid = scene.vertices[scene.triangles[units.triangles]].mean(axis=1)
        low, high = octree.bounds[cell, 0], octree.bounds[cell, 1]
        held = np.flatnonzero(((centroid >= low) & (centroid <= high)).all(axis=1))
        _, first = np.unique(units.triangles[held], return_index=True)
        keep = np.sort(held[first])
        offsets = np.searchsorted(cell[keep], np.arange(units.count + 1))
        return replace(octree, units=Units(offsets, units.triangles[keep], units.kind))


@mutant("U8", of=(EXT,), caught_by="large_object_at_the_edge")
class OnlyTheNearestCell:
    """The front starts with the one cell nearest to the eye, in view or not."""

    def seeds(self, frame):
        bounds, eye = self.octree.bounds, frame.view.camera.eye
        nearest = np.clip(eye, bounds[:, 0], bounds[:, 1])
        return np.argmin(np.linalg.norm(nearest - eye, axis=1), keepdims=True)


@mutant("W13", of=(EXT, PLP, PLP_COUNT), contract="cells_come_in_the_order_of_what_shows")
class SolidityIgnored:
    """No cell hides another: the largest on the screen comes first, or the first of all."""

    def solidity_of(self, octree):
        return np.zeros_like(super().solidity_of(octree))


@mutant("W13", of=(PLP_COUNT,), contract="cells_come_in_the_order_of_what_shows", budget=60)
class LeftSidewaysAsStraightOn:
    """What a cell stops does not depend on the face by which it is left."""

    def begin_walk(self, frame):
        super().begin_walk(frame)
        self.walk.transmittance = self.walk.transmittance[:, None]
        self.walk.look = self.walk.look._replace(slants=False)


@mutant("W14", of=WAYS, contract="no_cell_is_asked_twice")
class HiddenCellsQueuedAgain:
    """A hidden cell may join the front again, once (or it would go round and round)."""

    def decide(self, frame):
        self.once = np.zeros(self.octree.leaf_count, bool)
        super().decide(frame)

    def take_out(self, hidden):
        super().take_out(hidden)
        self.walk.status[hidden[~self.once[hidden]]] = UNMET
        self.once[hidden] = True


@mutant("W15", of=(EXT, IB_RESTORE, PLP, PLP_COUNT), contract="no_triangle_is_drawn_twice")
class TrianglesDrawnTwice:
    """A triangle is drawn with every cell that holds it."""

    def geometry_of(self, scene):
        class Careless(SharedGeometry):
            def fresh(self, unit_ids):
                return self.units.gather(unit_ids)

        return Careless(self.device, scene, self.units, self.occluders(scene))


# Queries.


@mutant("U4", of=ALL, caught_by="walk_through_a_city")
class DepthMaskLeftOn:
    """Boxes of cells write their depth, and hide each other and what is in them."""

    def query_state(self, state):
        return super().query_state(state)._replace(depth_write=True)


@mutant("U9", of=ALL, caught_by="walk_through_a_city", budget=0)
@mutant("G2", of=ALL, caught_by="eye_inside_an_object", budget=0)
class AskedWithTheEyeInside:
    """Cells around the eye are asked, by their front faces, which lie behind it."""

    def needs_no_query(self, view, boxes):
        return np.zeros(len(boxes), bool)


@mutant("G9", of=WAYS, caught_by="objects_of_one_sample", leaf=2, budget=0)
class ThresholdAboveOneSample:
    """A cell of a few passing samples counts as hidden."""

    def passes(self, samples):
        return samples > 40


common("G12", of=(HP,), caught_by="seen_from_outside")
common("G13", of=(EXT, IB), leaf=2)
common("G15", of=(EXT,))
common("G14", of=(EXT, HP), caught_by="lens_shift_and_zoom")


@mutant("U2", of=ITEMS, caught_by="seen_from_outside")
@item_step
class SinglePass:
    """Only the cells on top of the first picture are found."""

    def next_pass(self, rest, found):
        return rest[:0]


@mutant("U3", of=ITEMS, caught_by="lens_shift_and_zoom")
@item_step
class FirstIdIsTheBackgrounds:
    """Ids start at 0, which is the background's too."""

    def scan(self, framebuffer, tiles, count, stats):
        pixels, hit = super().scan(framebuffer, tiles, count, stats)
        pixels[:1] = 0
        return pixels, hit


@mutant("U10", of=ITEMS, caught_by="border_of_a_large_image", budget=0)
@item_step
class BorderTilesLeftOut:
    """Only whole tiles are active."""

    def begin(self, width, height):
        super().begin(max(width - width % TILE_PX, 1), max(height - height % TILE_PX, 1))


@mutant("U10", of=ITEMS, caught_by="border_of_a_large_image", budget=0)
@item_step
class TilesOfTheLastFrame:
    """Tiles retired in the frame before stay retired."""

    def begin(self, width, height):
        before = self.active
        super().begin(width, height)
        if before.shape == self.active.shape:
            self.active = before


@mutant("U11", of=ITEMS, caught_by="walk_through_a_city")
@item_step
class IdsAreBlended:
    """Ids add up where cells lie behind each other."""

    def render(self, view, boxes):
        context = self.device.context
        context.enable(moderngl.BLEND)
        context.blend_func = moderngl.ONE, moderngl.ONE
        super().render(view, boxes)
        context.disable(moderngl.BLEND)


@mutant("U12", of=RESTORES, caught_by="walk_through_a_city")
class NotRenderedAgain:
    """What went to depth alone stays out of the restored picture."""

    def render_again(self, frame):
        pass


# Where a method has no such step.

not_here("G1 G10", ALL, "no box is made or projected on the CPU: cells are the octree's")
not_here("G3", ALL, "no rectangle is computed")
not_here("G4", ALL, "no rectangle is computed; the tiles at the border are U10's")
not_here("G5 G6 G7", ALL, "no depth is compared or read back on the CPU")
not_here(
    "G8", ALL, "a cell's own triangles are not drawn when it is asked, but for its neighbours'"
)
not_here("G11", ALL, "nothing is kept from one frame to the next but the tiles, which are U10's")
not_here("G9 W14", RESTORES, "only what becomes of the picture differs from cplp-ib and cplp-hg")
not_here("G12", (EXT, *ITEMS, *RESTORES), "what is asked fills buffers of its own, not the image")
not_here("G13", (HP, HG, *RESTORES), "what is drawn is the same however cells are asked")
not_here("G14", (*ITEMS, *RESTORES), "the ids are read once the picture is finished")
not_here("U1 U5 U6 U7 U8 W13", (HP, *ITEMS, *RESTORES), "the ways of asking share the traversal")
not_here("U2 U3 U10 U11", (EXT, HP), "no ids are drawn")
not_here("U2 U3 U10 U11", RESTORES, "the ids are cplp-ib's and cplp-hg's")
not_here("U12", WAYS, "nothing is restored")
not_here("W15", (HP, *ITEMS, HG_RESTORE), "the ways of asking share the geometry")
UNSAFE = [id for id in (*COMMON, *SUITE.ids) if not id.startswith("W")]
ALONE = (PLP, PLP_COUNT)
not_here(" ".join(UNSAFE), ALONE, "it promises nothing: what its budget leaves out is measured")
not_here("W14", ALONE, "no cell is asked")
not_here("G15", (HP, *ITEMS, *RESTORES), "what is drawn is the same however cells are asked")
not_here("M1 M2 M3 M4 M5 M6", ALL, "it is for scenes that stand still, and says so")
