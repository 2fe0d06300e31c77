"""Deliberately broken cPLPs, one step each, and the small scenes that convict them.

`caught_by` names a scene, of `visref.conformance` or of `OWN` below, on which the verdict
convicts the mutant of each way of asking; `contract` says that only a checker of
`tests.mutants.test_plp_mutants` can see it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import moderngl
import numpy as np

from tests.mutants.bad_cullers import Method, Mutant, ResolvedMultisamples, registrar
from tests.support.culling_scenes import box as solid
from visref.conformance.scenes import Case, SceneMaker, camera, case
from visref.scene import Units
from visref_culling.gl.shared_geometry import SharedGeometry
from visref_culling.plp import ConservativePLPCulling
from visref_culling.plp.octree import Links
from visref_culling.plp.traversal import UNMET
from visref_culling.queries.histogram import HistogramQueries
from visref_culling.queries.item_buffer_query import TILE_PX, ItemBufferQueries


def method(name: str, **options: Any) -> Method:
    return Method(f"cplp-{name}", ConservativePLPCulling, {"leaf": 4, "budget": 12, **options})


EXT = method("ext", query="fragment-histogram")
HP = method("hp", query="occlusion-query")
IB = method("ib", query="item-buffer")
HG = method("hg", query="histogram")
IB_RESTORE = method("ib-restore", query="item-buffer", image="restore")
HG_RESTORE = method("hg-restore", query="histogram", image="restore")

ITEMS = (IB, HG)
RESTORES = (IB_RESTORE, HG_RESTORE)
WAYS = (EXT, HP, *ITEMS)
ALL = (*WAYS, *RESTORES)

MUTANTS: list[Mutant] = []
EQUIVALENT: dict[str, str] = {}
NOT_HERE: dict[str, str] = {
    "G1": "no box is projected on the CPU",
    "G3": "no rectangle is computed",
    "G4": "no rectangle is computed; the tiles at the border are U10's",
    "G5": "no depth is compared on the CPU",
    "G6": "no depth is compared on the CPU",
    "G7": "no depth is read back",
    "G8": "a cell's own triangles are not drawn when it is asked, but for those of neighbours",
    "G10": "no corner is transformed to make a box: cells are the octree's",
    "G11": "nothing is kept from one frame to the next but the tiles, which are U10's",
}

OF_THE_METHOD = {
    "U1": "stops at the budget",
    "U2": "a single item-buffer pass",
    "U3": "ids wrap at 256 or hit the background",
    "U4": "depth mask on during queries",
    "U5": "equal-size neighbours only",
    "U6": "empty leaves skipped",
    "U7": "a triangle only in its centroid's leaf",
    "U8": "eye outside: nearest cell not in the frustum, so an empty front",
    "U9": "back faces of cells culled",
    "U10": "tile retired at a viewport that is no multiple of 64, or on stale state",
    "U11": "multisampling, dither or blending on the item target",
    "U12": "no re-render after the restore",
    "W13": "solidity ignored",
    "W14": "occluded cells queued again",
    "W15": "triangles drawn twice",
}


mutant = registrar(MUTANTS)


def item_step(step: type) -> type:
    """A culler's step that breaks `step`, a class to put before the item buffer's own."""

    class Broken:
        __doc__ = step.__doc__

        def items_of(self, query):
            kind = HistogramQueries if query == "histogram" else ItemBufferQueries
            return type(step.__name__, (step, kind), {})(self.device)

    Broken.__name__ = step.__name__
    return Broken


# Scenes.

OWN: dict[str, SceneMaker] = {}


def own(claim: str) -> Callable[[Callable[..., Case]], Callable[..., Case]]:
    def register(build: Callable[..., Case]) -> Callable[..., Case]:
        OWN[build.__name__] = SceneMaker(build.__name__, claim, "", build)
        return build

    return register


def boxes_beyond(rng: np.random.Generator, count: int = 60) -> list[tuple[str, Any]]:
    made = []
    for k in range(count):
        centre = rng.uniform((-6, -5, -22), (6, 5, -8))
        made.append((f"box{k}", solid(tuple(centre), rng.uniform(0.1, 0.5))))
    return made


@own("draws boxes that lie far before an eye outside all cells")
def seen_from_outside(rng: np.random.Generator) -> Case:
    views = [
        camera(eye=(0.0, 0.0, 8.0), target=(0.0, 0.0, -15.0), width=100, height=70),
        camera(eye=(30.0, 20.0, 0.0), target=(0.0, 0.0, -15.0), width=100, height=70),
    ]
    return case(boxes_beyond(rng), views)


@own("draws what stands in the last rows and columns, frame after frame")
def border_of_a_large_image(rng: np.random.Generator) -> Case:
    def crowd(x: tuple[float, float], y: tuple[float, float], name: str) -> list[tuple[str, Any]]:
        return [
            (f"{name}{k}", solid((rng.uniform(*x), rng.uniform(*y), rng.uniform(-12, -8)), 0.12))
            for k in range(14)
        ]

    straight = camera(width=100, height=70, yfov=1.0)
    aside = camera(target=(6.0, 0.0, -8.0), width=100, height=70, yfov=1.0)
    objects = [*crowd((5.0, 7.0), (-4, 4), "right"), *crowd((-5, 5), (3.2, 4.6), "top")]
    return case(objects, [straight, aside, straight])


# Traversal.


@mutant("U1", of=(EXT,), caught_by="walk_through_a_city")
class StopsAtTheBudget:
    """What PLP's budget leaves out is never asked."""

    def complete(self, frame):
        frame.stats.iterations = 0


def filtered(links: Links, keep: np.ndarray) -> Links:
    """The links that `keep` marks."""
    before = np.concatenate([[0], np.cumsum(keep)])
    return replace(
        links,
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


@mutant("W13", of=(EXT,), contract="cells_come_in_the_order_of_what_shows")
class SolidityIgnored:
    """No cell hides another: the largest on the screen comes first."""

    def solidity_of(self, octree):
        return np.zeros((octree.leaf_count, 3))


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


@mutant("W15", of=(EXT, IB_RESTORE), contract="no_triangle_is_drawn_twice")
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


mutant("G12", of=(HP,), caught_by="seen_from_outside")(ResolvedMultisamples)


@mutant("G13", of=(EXT, IB), caught_by="glass", leaf=2)
class GlassOccludes:
    """Every triangle writes depth, the transparent ones too."""

    def occluders(self, scene):
        return np.ones(scene.triangle_count, bool)


@mutant("G14", of=(EXT, HP), caught_by="lens_shift_and_zoom")
class UnfinishedQueryReadAsZero:
    """The last query sent has no answer yet, and is taken to say zero."""

    def passes(self, samples):
        ready = samples.copy()
        ready[-1:] = 0
        return super().passes(ready)


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
