"""Three-pass culling with low-resolution stand-ins, from a set of slides, "Occlusion Culling",
on the visualisation of seismic data.

Objects are tiles of high resolution, each with a stand-in of low resolution. First pass: all
stand-ins, and additional occluders, fill the depth buffer. Second pass: the stand-ins are queried
against it, without writing. Third pass: both buffers are cleared, and every object whose stand-in
had more than a threshold of visible samples is drawn in full. The pipeline stalls once a frame;
nothing is sorted. The first two passes may use a smaller image.

`mode=published` does just that. A stand-in sticks out in front of its object, or shrinks behind
another; a threshold and a smaller image lose what is small. So it promises nothing and is measured.

`mode=conservative` draws every object that owns a sample:

- The first pass draws triangles of the scene itself, so the depth is never nearer than the
  scene's. Of the tiles' triangles it takes 1 in `reduction` as those of the nearest tiles, whole: a
  box behind a scattered subset would show through any of its holes.
- The second pass asks what contains the object: the boxes of its parts, inflated, which have 1 in
  `reduction` of its triangles; or the object itself, where it is an additional occluder.
- `threshold` is 0 and the comparison "not farther". A smaller image is the window's, drawn whole
  and reduced by the maximum (`three_pass.small_image`).

Departures from the slides, and what they leave open:

- "Additional occluders" are the objects of at most `extra` triangles, such as faults and slices of
  the volume. They stand in for themselves in both passes, and are queried as all others are.
- What is semi-transparent (BLEND) or alpha-tested does not occlude; it is queried and drawn.
- Only objects whose boxes meet the view take part; what is drawn comes front to back.
- The slides divide objects into tiles before anything else, and do not say how. Here objects are
  taken as they come, or with `tile` the large ones divided (`three_pass.tiles`).
- `ask=boxes` is not theirs: the second pass asks about bounding boxes instead of stand-ins, against
  the same depth. So the slides' "more precise than bounding boxes" is measured and nothing else.
- The slides do not say how they simplify: see `three_pass.stand_ins`.
- They say that it "works for dynamic scenes", and not how. Here the stand-in of an object that
  moves as one (by an affine map) moves with it, and one of an object that is deformed is made anew
  before the frame; in the conservative mode the boxes of its parts are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import Option, Promise
from visref.errors import InputError
from visref.scene import Float32, Float64, Int64, Scene, Units
from visref_culling.boxes.conservative import (
    cut_by_plane,
    inflated,
    meets_frustum,
    round_outward,
)
from visref_culling.gl.changes import Changes, taken
from visref_culling.gl.device import Target
from visref_culling.gl.geometry import Geometry
from visref_culling.gl.view import View
from visref_culling.method import GL_OPTIONS, Frame, GLCuller, phase
from visref_culling.queries.mesh_query import ask_meshes, mesh_fragments
from visref_culling.three_pass.parts import parts_of
from visref_culling.three_pass.small_image import FarthestDepth, grown, small_camera
from visref_culling.three_pass.stand_ins import StandIns
from visref_culling.three_pass.tiles import divided, tiles_of


@dataclass(frozen=True, eq=False)
class PrePass:
    """The image of the first two passes. `small`: whether it is smaller than the window."""

    view: View
    target: Target
    small: bool


@dataclass(frozen=True, eq=False)
class PartBoxes:
    """Boxes to be asked, (k, 2, 3) float32 relative to the eye, and the place in the frame of
    the object that each is a part of, (k,) int64, ascending."""

    boxes: Float32
    place: Int64


class ThreePassCulling(GLCuller):
    """Both modes; see the module."""

    name = "three-pass"
    memory = 0
    summary = "Seismic slides: low-resolution stand-ins are drawn, then queried, then replaced"
    promise = Promise.APPROXIMATE
    options: ClassVar[Mapping[str, Option]] = {
        "mode": Option(
            "published",
            "as the slides have it, and measured; or so that nothing visible is missed",
            ("published", "conservative"),
        ),
        "reduction": Option(100, "an object's triangles for one of its stand-in's"),
        "threshold": Option(0, "an object is drawn if more samples than this of it show"),
        "scale": Option(1, "pixels a side for one of the image of the first passes", (1, 2, 4, 8)),
        "extra": Option(1000, "objects of at most so many triangles stand in for themselves"),
        "tile": Option(0, "triangles of a tile, into which larger objects are divided; 0 for none"),
        "ask": Option(
            "stand-ins",
            "what the published mode queries in the second pass",
            ("stand-ins", "boxes"),
        ),
        **GL_OPTIONS,
    }

    def __init__(
        self,
        *,
        mode: str = "published",
        reduction: int = 100,
        threshold: int = 0,
        scale: int = 1,
        extra: int = 1000,
        tile: int = 0,
        ask: str = "stand-ins",
        depth: int = 24,
        fragments: bool = False,
    ) -> None:
        super().__init__(depth=depth, fragments=fragments)
        self.conservative = mode == "conservative"
        if self.conservative:
            self.promise = Promise.CONSERVATIVE
        if reduction < 1:
            raise InputError(f"reduction is {reduction}", place="reduction", fix="give 1 or more")
        for name, value in (("threshold", threshold), ("extra", extra), ("tile", tile)):
            if value < 0:
                raise InputError(f"{name} is {value}", place=name, fix="give 0 or more")
        if threshold and self.conservative:
            raise InputError(
                f"threshold is {threshold} and the mode conservative",
                place="threshold",
                fix="give 0: an object of one sample is visible",
            )
        if ask == "boxes" and self.conservative:
            raise InputError(
                "ask is boxes and the mode conservative",
                place="ask",
                fix="leave it out: that mode asks the boxes of parts",
            )
        self.tile, self.asks_boxes = tile, ask == "boxes"
        self.reduction, self.threshold = reduction, threshold
        self.scale, self.extra = scale, extra
        self.farthest = FarthestDepth(self.device)
        self.low: Geometry | None = None

    def prepare(self, scene: Scene) -> Units:
        units = super().prepare(scene)
        # What stands in for itself, and in the conservative mode occludes whole.
        self.whole = units.sizes <= self.extra
        if self.conservative:
            self.parts, self.first_part = self.parts_of(scene)
            self.part_bounds = self.unit_bounds(scene, self.parts)
        else:
            self.stand_ins = StandIns(self.tiled(scene), self.reduction, self.extra)
            self.make_low()
        return units

    def make_low(self) -> None:
        """Put the stand-ins on the GPU."""
        if self.low is not None:
            self.low.release()
        self.low_scene = self.stand_ins_of(self.tiled(self.scene))
        units, occludes = self.low_scene.object_units(), self.occluders(self.low_scene)
        self.low = Geometry(self.device, self.low_scene, units, occludes)

    def follow(self, changes: Changes) -> None:
        super().follow(changes)
        if self.conservative:
            parts = changes.units(self.parts)
            self.part_bounds = self.part_bounds.copy()
            self.part_bounds[parts] = self.unit_bounds(self.scene, taken(self.parts, parts))
            return
        assert self.low is not None
        tiled = self.tiled(self.scene)
        self.stand_ins.update(tiled, changes.units(self.units))
        before, now = self.low_scene, self.stand_ins_of(tiled)
        if (
            len(before.vertices) != len(now.vertices)
            or not np.array_equal(before.object_offsets, now.object_offsets)
            or not np.array_equal(before.alpha, now.alpha)
            or not np.array_equal(before.one_sided, now.one_sided)
        ):
            self.make_low()
            return
        self.low_scene = now
        self.low.update(now, Changes.between(before, now))

    def decide(self, frame: Frame) -> None:
        before = self.pre_pass(frame)
        with phase(frame.stats, "occluders"):
            self.fill_depth(frame, before)
        with phase(frame.stats, "query"):
            visible = self.ask(frame, before)
        self.clear_again(frame)
        self.draw(frame, np.flatnonzero(visible))

    def close(self) -> None:
        super().close()
        self.farthest.release()

    def _release(self) -> None:
        super()._release()
        if self.low is not None:
            self.low.release()
            self.low = None

    # The steps.

    def units_of(self, scene: Scene) -> Units:
        return tiles_of(scene, self.tile) if self.tile else scene.object_units()

    def tiled(self, scene: Scene) -> Scene:
        """The scene with each unit as an object."""
        return divided(scene, self.units) if self.tile else scene

    def stand_ins_of(self, scene: Scene) -> Scene:
        """Published: the same objects at low resolution."""
        return self.stand_ins.scene(scene)

    def parts_of(self, scene: Scene) -> tuple[Units, Int64]:
        """Conservative: parts of each unit, and each unit's first part, (units + 1,) int64."""
        parts, first = parts_of(self.tiled(scene), self.reduction)
        # Of the tiles' triangles, which come in the units' order.
        return Units(parts.offsets, self.units.triangles[parts.triangles], parts.kind), first

    def small_camera(self, camera: Camera) -> Camera:
        return small_camera(camera, self.scale)

    def pre_pass(self, frame: Frame) -> PrePass:
        """The image of the first two passes; where no smaller one fits, the window's."""
        camera = frame.view.camera
        small = self.small_camera(camera) if self.scale > 1 else camera
        if (small.width, small.height) == (camera.width, camera.height):
            return PrePass(frame.view, frame.target, False)
        target = self.target_for(small)
        self.clear(target, frame.stats)
        return PrePass(self.view_of(small), target, True)

    def fill_depth(self, frame: Frame, before: PrePass) -> None:
        """The first pass."""
        if self.low is not None:
            ids = frame.ids
            self.low.draw_depth(before.view, before.target, ids, frame.stats)
        else:
            assert self.geometry is not None
            ids = frame.ids[self.inner_occluders(frame)]
            self.geometry.draw_depth(frame.view, frame.target, ids, frame.stats)
            if before.small:
                self.reduce(frame, before)
        self.observe("fill", units=ids)

    def inner_occluders(self, frame: Frame) -> Int64:
        """(n,) int64: the places of objects that hide others in the conservative first pass."""
        whole = self.whole[frame.ids]
        sizes = np.where(whole, 0, self.units.sizes[frame.ids])
        budget = -(-int(sizes.sum()) // self.reduction)
        # The last one may pass the budget: more occluders only hide more.
        return np.flatnonzero(whole | (np.cumsum(sizes) - sizes < budget))

    def reduce(self, frame: Frame, before: PrePass) -> None:
        self.farthest.reduce(frame.target, before.target, self.scale, frame.stats)

    def ask(self, frame: Frame, before: PrePass) -> NDArray[np.bool_]:
        """The second pass: which of the frame's units to draw, (k,) bool."""
        ids = frame.ids
        if self.low is not None and self.asks_boxes:
            return self.ask_bounds(frame, before)
        if self.low is not None:
            samples = ask_meshes(
                self.low,
                before.view,
                before.target,
                self.answering(ids),
                frame.stats,
                state_hook=self.query_state,
            )
            visible = self.passes(samples)
            self.observe("query", units=ids, samples=samples, visible=visible)
            return visible
        visible = self.sure(frame)
        self_asked = self.asked_themselves(frame, before) & ~visible
        places = np.flatnonzero(self_asked)
        visible[places] = self.ask_objects(frame, places)
        places = np.flatnonzero(~self_asked & ~visible)
        visible[places] = self.ask_boxes(frame, before, places)
        return visible

    def ask_bounds(self, frame: Frame, before: PrePass) -> NDArray[np.bool_]:
        """The second pass with `ask=boxes`: (k,) bool over the frame's units."""
        ids, visible = frame.ids, frame.sure.copy()
        places = np.flatnonzero(~frame.sure)
        samples = self.queries.ask(
            before.view,
            before.target,
            round_outward(frame.boxes[places]),
            frame.stats,
            way="batch",
            cull_back_faces=True,
            state_hook=self.query_state,
        )
        visible[places] = self.passes(samples)
        self.observe("query", units=ids[places], samples=samples, visible=visible[places])
        return visible

    def answering(self, ids: Int64) -> Int64:
        """(n,) int64: the units by whose stand-ins these, (n,) int64 ids, are decided."""
        return ids

    def sure(self, frame: Frame) -> NDArray[np.bool_]:
        """(k,) bool over the frame's units: visible without a query. What the clip plane cuts, or
        touches, may be asked about by its own triangles, which are cut off there."""
        return frame.sure | cut_by_plane(frame.view, frame.boxes)

    def asked_themselves(self, frame: Frame, before: PrePass) -> NDArray[np.bool_]:
        """(k,) bool over the frame's units: whose own triangles are queried. Drawn as they are
        in the end, they miss a sample where that drawing does; in a smaller image they would
        miss more."""
        result: NDArray[np.bool_] = self.whole[frame.ids] & (not before.small)
        return result

    def ask_objects(self, frame: Frame, places: Int64) -> NDArray[np.bool_]:
        """(n,) bool: whether the units at `places`, (n,) int64, show by their own triangles."""
        assert self.geometry is not None
        samples = ask_meshes(
            self.geometry,
            frame.view,
            frame.target,
            self.answering(frame.ids[places]),
            frame.stats,
            state_hook=self.query_state,
        )
        visible = self.passes(samples)
        self.observe("query", units=frame.ids[places], samples=samples, visible=visible)
        return visible

    def ask_boxes(self, frame: Frame, before: PrePass, places: Int64) -> NDArray[np.bool_]:
        """(n,) bool: whether any box of the parts of the units at `places`, (n,) int64, shows,
        asked in one draw."""
        asked, sure = self.part_boxes(frame, before, places)
        samples = np.zeros(len(frame.ids), np.int64)
        counted = self.queries.ask(
            before.view,
            before.target,
            asked.boxes,
            frame.stats,
            way="instanced",
            cull_back_faces=True,
            state_hook=self.query_state,
        )
        np.add.at(samples, asked.place, counted)
        visible = self.passes(samples[places]) | sure[places]
        self.observe("query", units=frame.ids[places], samples=samples[places], visible=visible)
        return visible

    def part_boxes(
        self, frame: Frame, before: PrePass, places: Int64
    ) -> tuple[PartBoxes, NDArray[np.bool_]]:
        """The boxes to ask of the units at `places`, (n,) int64, those in view, and which of
        the frame's units are visible without asking, (k,) bool, because GL cannot draw one of
        their boxes whole."""
        asked = self.answering(frame.ids[places])
        first = self.first_part[asked]
        counts = self.first_part[asked + 1] - first
        part = np.repeat(first - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
        place = np.repeat(places, counts)
        boxes = inflated(before.view, self.part_bounds[part])
        if before.small:
            boxes = self.grown(before.view, boxes)
        shown = meets_frustum(before.view, boxes)
        unasked = shown & self.needs_no_query(before.view, boxes)
        sure = np.zeros(len(frame.ids), np.bool_)
        sure[place[unasked]] = True
        shown &= ~sure[place]
        return PartBoxes(round_outward(boxes[shown]), place[shown]), sure

    def grown(self, view: View, boxes: Float64) -> Float64:
        """(m, 2, 3) float64: boxes of that shape, relative to the eye, grown for the smaller
        image."""
        return grown(view, boxes)

    def passes(self, samples: Int64) -> NDArray[np.bool_]:
        """(k,) bool of (k,) int64 samples, one per unit: whether they mean visible."""
        return samples > self.threshold

    def clear_again(self, frame: Frame) -> None:
        """The third pass starts on empty buffers."""
        self.clear(frame.target, frame.stats)
        self.observe("clear")

    def _count(self, frame: Frame, drawn: Int64) -> None:
        """Fragments of the three passes."""
        assert self.geometry is not None
        before, stats = self.pre_pass(frame), frame.stats
        ids = frame.ids
        passed = np.isin(ids, drawn)
        if self.low is not None:
            filling = self.low.depth_fragments(before.view, before.target, ids)
            of_unit = self._published_fragments(frame, before)
        else:
            occluders = ids[self.inner_occluders(frame)]
            filling = self.geometry.depth_fragments(frame.view, frame.target, occluders)
            of_unit = self._conservative_fragments(frame, before)
        stats.query_fragments = int(of_unit.sum())
        stats.query_fragments_passed = int(of_unit[passed].sum())
        final = self.geometry.fragments(frame.view, frame.target, drawn)
        stats.depth_tests = filling + stats.query_fragments + final

    def _published_fragments(self, frame: Frame, before: PrePass) -> Int64:
        assert self.low is not None
        if not self.asks_boxes:
            return mesh_fragments(self.low, before.view, before.target, frame.ids)
        result = np.zeros(len(frame.ids), np.int64)
        places = np.flatnonzero(~frame.sure)
        result[places] = self.queries.fragments(
            before.view, before.target, round_outward(frame.boxes[places]), cull_back_faces=True
        )
        return result

    def _conservative_fragments(self, frame: Frame, before: PrePass) -> Int64:
        assert self.geometry is not None
        result = np.zeros(len(frame.ids), np.int64)
        sure = self.sure(frame)
        self_asked = self.asked_themselves(frame, before) & ~sure
        places = np.flatnonzero(self_asked)
        result[places] = mesh_fragments(self.geometry, frame.view, frame.target, frame.ids[places])
        asked, _ = self.part_boxes(frame, before, np.flatnonzero(~self_asked & ~sure))
        counted = self.queries.fragments(
            before.view, before.target, asked.boxes, cull_back_faces=True
        )
        np.add.at(result, asked.place, counted)
        return result
