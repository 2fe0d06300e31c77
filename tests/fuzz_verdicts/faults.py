"""Faults to plant in visref: what the fuzz has to notice. Each is put in by a MonkeyPatch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest

from visref.camera import Camera
from visref.exact import scene as exact_scene
from visref.exact.contests import Contest
from visref.exact.rational import ExactFrame
from visref.formats import placed
from visref.formats.gltf import meshes
from visref.judging import disputes, settle, superfluous, walk
from visref.masks import hits
from visref.masks.lookup import HOLE, SOLID
from visref.scene import Alpha, Scene, Units
from visref.visibility import Doubt

Patch = pytest.MonkeyPatch
Plant = Callable[[Patch], None]
# By name: what plants it, and the first case that shows it.
FAULTS: dict[str, tuple[Plant, int]] = {}


def fault(case: int) -> Callable[[Plant], Plant]:
    def register(plant: Plant) -> Plant:
        FAULTS[plant.__name__] = plant, case
        return plant

    return register


def engine_for(name: str) -> str:
    """The engine whose run shows a fault: the exact one but for what is at a ray engine's door."""
    return "embree" if "ray_engine" in name else "exact"


@fault(1)
def edges_are_open(patch: Patch) -> None:
    """A sample on an edge is not covered."""
    covers = ExactFrame.covers

    def without_edges(self: Any, which: Any, samples: Any) -> Any:
        result = covers(self, which, samples)
        for edge in self._edges:
            result &= np.array([value > 0 for value in self._at(edge, which, samples)], np.bool_)
        return result

    patch.setattr(ExactFrame, "covers", without_edges)


def _limits(patch: Patch, of: str, sign: int) -> None:
    compare = ExactFrame._compare_depth

    def shifted(self: Any, n: Any, d: Any, limit: float) -> Any:
        result = compare(self, n, d, limit)
        return np.where((result == 0) & (limit == getattr(self.camera, of)), sign, result)

    patch.setattr(ExactFrame, "_compare_depth", shifted)


@fault(5)
def near_is_open(patch: Patch) -> None:
    """What lies exactly at near does not count."""
    _limits(patch, "near", -1)


@fault(3)
def far_is_open(patch: Patch) -> None:
    """What lies exactly at far does not count."""
    _limits(patch, "far", 1)


@fault(0)
def origin_is_not_subtracted(patch: Patch) -> None:
    """Cameras stay where they are in the world, while vertices are relative to an origin."""
    patch.setattr(Camera, "relative_to", lambda self, origin: self)


@fault(0)
def vertices_are_rounded_before_the_origin(patch: Patch) -> None:
    """Far out, the reader rounds to float32 before it subtracts the origin."""
    place_vertices = placed.place_vertices

    def rounded(positions: Any, worlds: Any, objects: Any, starts: Any, origin: Any,
                vertices: Any, moved: Any, *rest: Any) -> None:  # fmt: skip
        place_vertices(positions, worlds, objects, starts, np.zeros(3), vertices, moved, *rest)
        rows = starts[objects, None] + np.arange(len(positions))
        vertices[rows] -= origin.astype(np.float32)
        moved[rows] = 0

    patch.setattr(placed, "place_vertices", rounded)


def _states(patch: Patch, change: Callable[..., Any]) -> None:
    states_at = hits.states_at
    patch.setattr(hits, "states_at", lambda *given: change(states_at, *given))


@fault(9)
def footprint_is_not_doubled(patch: Patch) -> None:
    """A mask looks at the pixel's own footprint."""

    def single(states_at: Any, masks: Any, row: Any, axes: Any, at: Any, *rest: Any) -> Any:
        return states_at(masks, row, axes * [[1], [1], [0.5], [0.5]], at * 2.0, *rest)

    _states(patch, single)


@fault(9)
def solid_and_hole_are_swapped(patch: Patch) -> None:
    """Where a mask lets through and where it does not."""

    def swapped(states_at: Any, *given: Any) -> Any:
        state = states_at(*given)
        return np.where(state == SOLID, HOLE, np.where(state == HOLE, SOLID, state))

    _states(patch, swapped)


@fault(0)
def ties_are_dropped(patch: Patch) -> None:
    """Of several triangles at the nearest depth, one is kept."""
    crown = exact_scene.crown

    def alone(*given: Any) -> Any:
        sample, triangle = crown(*given)
        return sample[:0], triangle[:0]

    patch.setattr(exact_scene, "crown", alone)


@fault(1)
def blend_is_opaque(patch: Patch) -> None:
    """BLEND materials occlude."""
    init = Scene.__post_init__

    def opaque(self: Any) -> None:
        object.__setattr__(self, "alpha", np.where(self.alpha == Alpha.BLEND, 0, self.alpha))
        object.__setattr__(self, "alpha", self.alpha.astype(np.uint8))
        init(self)

    patch.setattr(Scene, "__post_init__", opaque)


@fault(1)
def transmission_is_opaque(patch: Patch) -> None:
    """KHR_materials_transmission is not looked at."""
    patch.setattr(meshes, "transmission", lambda material: (False, False))


@fault(1)
def glass_is_seen_behind(patch: Patch) -> None:
    """Blended triangles are seen after the nearest opaque hit instead of before it."""
    before = exact_scene.ExactScene.before

    def after(self: Any, camera: Any, alpha: Any, owner: Any, bounds: Any, wanted: Any,
              moved: Any, *, closed: bool) -> Any:  # fmt: skip
        found = before(self, camera, alpha, owner, bounds, wanted, moved, closed=closed)
        if alpha != Alpha.BLEND:
            return found
        every = self.hits(camera, self.scene.alpha == alpha, wanted)
        count = self.scene.triangle_count
        kept = ~np.isin(every.sample * count + every.triangle,
                        found.sample * count + found.triangle)  # fmt: skip
        return Contest(*(column[kept] for column in every))

    patch.setattr(exact_scene.ExactScene, "before", after)


@fault(2)
def level_glass_is_seen(patch: Patch) -> None:
    """Glass exactly at the nearest opaque depth counts as before it."""
    before = exact_scene.ExactScene.before
    patch.setattr(
        exact_scene.ExactScene,
        "before",
        lambda *given, closed: before(*given, closed=True),
    )


@fault(8)
def mirrored_winding_is_kept(patch: Patch) -> None:
    """A mirroring transform does not flip the winding."""
    determinants = placed._determinants
    patch.setattr(placed, "_determinants", lambda worlds: abs(determinants(worlds)))


@fault(0)
def sides_are_forgotten(patch: Patch) -> None:
    """One-sided triangles are seen from behind."""
    covers = ExactFrame.__init__
    patch.setattr(
        ExactFrame,
        "__init__",
        lambda self, camera, corners, sides: covers(self, camera, corners, sides & False),
    )
    init = Scene.__post_init__

    def two_sided(self: Any) -> None:
        object.__setattr__(self, "one_sided", np.zeros(len(self.triangles), np.bool_))
        init(self)

    patch.setattr(Scene, "__post_init__", two_sided)


@fault(6)
def lens_shift_has_the_other_sign(patch: Patch) -> None:
    """shift_x_px moves the image the other way."""

    def column_a(self: Camera) -> Any:
        x = np.arange(self.width, dtype=np.float64)
        return 2.0 * (x - self.shift_x_px) + 1.0 - self.width

    turned = cached_property(column_a)
    turned.__set_name__(Camera, "column_a")
    patch.setattr(Camera, "column_a", turned)


def _walks(patch: Patch, change: Callable[[Any, Any], Any]) -> None:
    walked = settle.walk_samples

    def changed(truth: Any, scene: Any, drawn: Any) -> Any:
        return change(walked(truth, scene, drawn), scene)

    patch.setattr(settle, "walk_samples", changed)


@fault(19)
def partly_missed_is_not_counted(patch: Patch) -> None:
    """An object that shows somewhere has lost nothing."""

    def forgiving(found: walk.SampleWalk, scene: Scene) -> walk.SampleWalk:
        whole = ~found.shows
        return replace(
            found,
            lost=found.lost * whole,
            lost_blended=found.lost_blended * whole,
            blended_hit=np.where(whole, found.blended_hit, -1),
        )

    _walks(patch, forgiving)


@fault(22)
def overlapping_units_exclude_one_another(patch: Patch) -> None:
    """A triangle of several units is drawn with the last of them alone."""

    def mask(self: Units, unit_ids: Any, triangle_count: int) -> Any:
        owner = np.full(triangle_count, -1)
        owner[self.triangles] = np.repeat(np.arange(self.count), self.sizes)
        return np.isin(owner, unit_ids) & (owner >= 0)

    patch.setattr(Units, "mask", mask)


@fault(62)
def hidden_units_are_confirmed_without_masks(patch: Patch) -> None:
    """A sample that a mask leaves open clears no unit."""
    confirm = superfluous.confirm

    def blind(exact: Any, truth: Any, units: Any, unit_ids: Any) -> Any:
        return confirm(exact, replace(truth, doubt=Doubt()), units, unit_ids)

    patch.setattr(settle, "confirm", blind)


@fault(61)
def glass_clears_its_whole_object(patch: Patch) -> None:
    """All glass of an object counts as seen where some of it is."""
    looked_at = settle._looked_at

    def generous(scene: Scene, truth: Any, *rest: Any) -> Any:
        frame = looked_at(scene, truth, *rest)
        objects = np.isin(scene.object_of_triangle, truth.blend.object)
        glass = np.flatnonzero(objects & (scene.alpha == Alpha.BLEND)).astype(np.int32)
        draws = frame.draw_list
        draws.holders.mark(glass, draws.by_unit, frame.units_seen.may)
        return frame

    patch.setattr(settle, "_looked_at", generous)


@fault(3)
def lost_glass_is_not_looked_for(patch: Patch) -> None:
    """Blended triangles are never lost."""

    def without(found: walk.SampleWalk, scene: Scene) -> walk.SampleWalk:
        nothing = np.full(scene.object_count, -1)
        return replace(
            found,
            shows=found.shows | (found.blended_hit >= 0),
            lost_blended=found.lost_blended * 0,
            blended_hit=nothing,
        )

    _walks(patch, without)


@fault(15)
def a_ray_engine_convicts_by_itself(patch: Patch) -> None:
    """What Embree says is lost is not decided exactly."""
    patch.setattr(settle, "decide", lambda exact, truth, samples: disputes.Rulings())


@fault(106)
def depths_are_compared_roughly(patch: Patch) -> None:
    """Depths that differ by less than a millionth are taken for equal."""
    compare = ExactFrame.compare

    def rough(self: Any, first: Any, second: Any, samples: Any) -> Any:
        near, far = (self.depth(which, samples) for which in (first, second))
        result = compare(self, first, second, samples)
        return np.where(np.abs(near - far) < 1e-6 * np.abs(near), 0, result).astype(np.int8)

    patch.setattr(ExactFrame, "compare", rough)
