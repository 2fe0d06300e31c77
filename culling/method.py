"""What every culler on GL shares: the frame, its steps, and the conditions that keep it safe.

Each condition is one overridable step of `GLCuller`, so that a test can break exactly one:

| step | condition |
|---|---|
| `unit_bounds` | the box contains the geometry |
| `moved_bounds` | where it is in this frame; what is absent has no box |
| `move_geometry` | what is drawn, and what hides, is where it is in this frame |
| `occluders` | only opaque triangles fill the depth that queries see |
| `view_of` | this frame's camera, for drawing and for queries |
| `target_for`, `clear` | one image, emptied at the frame's start |
| `in_frustum` | no unit that may meet the view is left out |
| `needs_no_query` | eye in the box, or a box across the near plane: visible |
| `order` | front to back |
| `query_state` | no writes during a query; the draw after it sets its own state |
| `passes` | one passing sample means draw |
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import Culler, CullerError, DrawnSet, Option, QueryStats
from visref.errors import InputError
from visref.scene import Float32, Float64, Int32, Int64, Scene, Units
from visref.stopwatch import Stopwatch
from visref_culling.boxes.conservative import inflated, nearest_depth, needs_no_query, round_outward
from visref_culling.boxes.hierarchy import BoxTree, front_to_back
from visref_culling.gl import geometry
from visref_culling.gl.changes import Changes, taken
from visref_culling.gl.device import State, Target, UsesDevice, device
from visref_culling.gl.item_buffer import GLRaster
from visref_culling.gl.view import View
from visref_culling.queries.occlusion_query import BoxQueries

# Called as observer(step, data) at "clear", "draw", "query" and a method's own steps. The
# data are plain values; nothing that a method decides depends on it.
Observer = Callable[[str, Mapping[str, Any]], None]

GL_OPTIONS: dict[str, Option] = {
    "depth": Option(24, "bits of the depth buffer; 32 is floating point", (24, 32)),
    "fragments": Option(False, "count the fragments of queries and drawing, outside the timing"),
}
QUERY_OPTIONS: dict[str, Option] = {
    "query": Option(
        "sync",
        "wait for each query, or a batch of them, or one instanced draw",
        ("sync", "batch", "instanced"),
    ),
    "backfaces": Option(False, "rasterise the back faces of query boxes too"),
}


class Asked(NamedTuple):
    """One call's queries: (k, 2, 3) float32 boxes as drawn, and (k,) samples that passed."""

    boxes: Float32
    samples: Int64
    corners_only: bool


@dataclass(eq=False)
class Frame:
    """One camera's work. Arrays are over `ids`, the units in the view in the method's order.

    `boxes`: (k, 2, 3) float64, inflated, relative to the eye; `nearest`: (k,) float64, least
    view depth; `sure`: (k,) bool, visible without a query; `drawn`, `asked`: the units drawn
    and the queries made so far, in order, a part a call.
    """

    view: View
    target: Target
    stats: QueryStats
    ids: Int64
    boxes: Float64
    nearest: Float64
    sure: NDArray[np.bool_]
    drawn: list[Int64] = field(default_factory=list)
    asked: list[Asked] = field(default_factory=list)
    asked_about: list[tuple[Int64, int]] = field(default_factory=list)

    def note_asked(self, units: Int64) -> None:
        """The depth buffer is asked about these units, (n,) int64 ids, now: for the record of
        why each was drawn."""
        self.asked_about.append((units, len(self.drawn)))


class GLCuller(UsesDevice, Culler):
    """A culler on GL; a method says in `decide` what to draw and what to ask."""

    options: ClassVar[Mapping[str, Option]] = GL_OPTIONS
    observer: Observer | None = None

    # Whether every question about a unit is noted: it is by `query`, and a method that asks in
    # another way calls `Frame.note_asked` itself.
    notes_asked = False

    # Values of QUERY_OPTIONS; a method that takes them as options sets them.
    way = "sync"
    query_back_faces = False

    def __init__(self, *, depth: int = 24, fragments: bool = False) -> None:
        self.depth_bits = depth
        self.count_fragments = fragments
        self.device = device()
        self.queries = BoxQueries(self.device)
        self.geometry: geometry.Geometry | None = None

    def prepare(self, scene: Scene) -> Units:
        self._release()
        self.scene = scene
        self.units = self.units_of(scene)
        self.unit_boxes = self.unit_bounds(scene, self.units)
        self.tree = BoxTree(self.unit_boxes)
        self.geometry = self.geometry_of(scene)
        self.raster: GLRaster | None = self.raster_of(scene)
        return self.units

    def update(self, scene: Scene) -> None:
        """What has changed is sent to the GPU and gets boxes anew. The units stay what they are."""
        changes = Changes.between(self.scene, scene)
        self.scene = scene
        self.follow(changes)

    def follow(self, changes: Changes) -> None:
        """Bring all that was made of the scene up to `self.scene`. A method that makes more of it
        in `prepare` brings that up to date here."""
        units = changes.units(self.units)
        self.unit_boxes = self.moved_bounds(units)
        self.tree = BoxTree(self.unit_boxes)
        self.move_geometry(changes)
        if self.raster is not None:
            self.raster.update(self.scene, changes)

    def cull(self, camera: Camera) -> DrawnSet:
        """Raises CullerError where OpenGL cannot hold the scene as it is seen, or has no image of
        that size: a culler that needs none of it is judged all the same."""
        try:
            return self._cull(camera)
        except InputError as error:
            raise CullerError(str(error)) from error

    def _cull(self, camera: Camera) -> DrawnSet:
        if self.raster is not None:
            self.raster.see(camera)
        self.device.context.finish()
        with Stopwatch() as watch:
            frame = self.begin(camera)
            self.decide(frame)
            self.device.context.finish()
        frame.stats.ms["frame"] = watch.ms
        drawn = np.concatenate([np.zeros(0, np.int64), *frame.drawn])
        if self.count_fragments:
            self._count(frame, drawn)
        return DrawnSet(drawn.astype(np.int32), frame.stats, self._asked_at(frame, drawn))

    @abstractmethod
    def decide(self, frame: Frame) -> None:
        """Draw what may be visible, each unit at most once."""

    def bounds(self) -> Float64 | None:
        """(u, 2, 3) float64 world boxes, one per unit."""
        return self.unit_boxes

    def close(self) -> None:
        self._release()
        self.queries.release()

    def _release(self) -> None:
        if self.geometry is not None:
            self.geometry.release()
            if self.raster is not None:
                self.raster.close()
            self.geometry = None

    # The steps.

    def units_of(self, scene: Scene) -> Units:
        return scene.object_units()

    def unit_bounds(self, scene: Scene, units: Units) -> Float64:
        """(u, 2, 3) float64 world boxes."""
        return scene.bounds_of(units)

    def moved_bounds(self, units: Int64) -> Float64:
        """(u, 2, 3) float64 world boxes of all units as the scene stands now; those of `units`,
        (k,) ids, alone have changed."""
        boxes = self.unit_boxes.copy()
        boxes[units] = self.unit_bounds(self.scene, taken(self.units, units))
        return boxes

    def move_geometry(self, changes: Changes) -> None:
        assert self.geometry is not None
        self.geometry.update(self.scene, changes)

    def occluders(self, scene: Scene) -> NDArray[np.bool_]:
        """(t,) bool, the triangles that write depth."""
        return geometry.occluders(scene)

    def units_with(self, triangles: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(u,) bool: the units that hold some of these triangles, (t,) bool."""
        before = np.concatenate([[0], np.cumsum(triangles[self.units.triangles])])
        found: NDArray[np.bool_] = np.diff(before[self.units.offsets]) > 0
        return found

    def geometry_of(self, scene: Scene) -> geometry.Geometry:
        return geometry.Geometry(self.device, scene, self.units, self.occluders(scene))

    def raster_of(self, scene: Scene) -> GLRaster | None:
        """The rasteriser whose depth decides, None for a method that asks none."""
        return GLRaster(scene, self.depth_bits)

    def view_of(self, camera: Camera) -> View:
        return View.of(camera, self.scene, self.device.subpixel_bits)

    def target_for(self, camera: Camera) -> Target:
        return self.device.target(camera.width, camera.height, self.depth_bits)

    def clear(self, target: Target, stats: QueryStats) -> None:
        assert self.geometry is not None
        state = State(target.framebuffer, self.geometry.program)
        stats.state_changes = (stats.state_changes or 0) + self.device.clear(state)

    def in_frustum(self, view: View) -> Int64:
        """(k,) int64 unit ids, ascending."""
        return self.tree.in_frustum(view)

    def needs_no_query(self, view: View, boxes: Float64) -> NDArray[np.bool_]:
        """(k,) bool, visible without a query, of inflated boxes (k, 2, 3) float64 relative to
        the eye."""
        return needs_no_query(view, boxes)

    def order(self, ids: Int64, nearest: Float64) -> Int64:
        """(k,) int64 indices into `ids`, (k,) int64 units, whose least view depths are
        `nearest`, (k,) float64."""
        return front_to_back(ids, nearest)

    def query_state(self, state: State) -> State:
        return state

    def passes(self, samples: Int64) -> NDArray[np.bool_]:
        """(k,) bool: which of a call's queries mean visible, from their passing samples, (k,)
        int64."""
        return samples > 0

    # What a method calls.

    def begin(self, camera: Camera) -> Frame:
        """Clear, cull against the frustum, and sort."""
        frame = self.open(camera)
        view = frame.view
        with phase(frame.stats, "sort"):
            ids = self.in_frustum(view)
            boxes = inflated(view, self.unit_boxes[ids])
            nearest = nearest_depth(view, boxes)
            order = self.order(ids, nearest)
            frame.ids, frame.boxes, frame.nearest = ids[order], boxes[order], nearest[order]
            frame.sure = self.needs_no_query(view, frame.boxes)
        return frame

    def open(self, camera: Camera) -> Frame:
        """An empty image, and no unit to decide about yet."""
        stats = QueryStats(
            queries=0,
            queries_passed=0,
            batches=0,
            triangles_drawn=0,
            units_drawn=0,
            draw_calls=0,
            state_changes=0,
            bytes_read_back=0,
        )
        view, target = self.view_of(camera), self.target_for(camera)
        device().begin_frame()
        self.clear(target, stats)
        self.observe("clear")
        nothing = np.zeros(0)
        return Frame(
            view,
            target,
            stats,
            ids=np.zeros(0, np.int64),
            boxes=np.zeros((0, 2, 3)),
            nearest=nothing,
            sure=nothing.astype(np.bool_),
        )

    def draw(self, frame: Frame, places: Int64) -> None:
        """Draw the units `frame.ids[places]`, (n,) int64 places."""
        assert self.geometry is not None
        if not len(places):
            return
        ids = frame.ids[places]
        with phase(frame.stats, "draw"):
            self.geometry.draw(frame.view, frame.target, ids, frame.stats)
        frame.drawn.append(ids)
        self.observe("draw", units=ids)

    def query(
        self, frame: Frame, places: Int64, *, corners_only: bool = False
    ) -> NDArray[np.bool_]:
        """(n,) bool: whether the boxes of the units `frame.ids[places]`, (n,) int64 places,
        would show, asked together; or their corners alone."""
        samples = self.samples_of_boxes(frame, frame.boxes[places], corners_only=corners_only)
        visible = self.passes(samples)
        frame.note_asked(frame.ids[places])
        self.observe(
            "query",
            units=frame.ids[places],
            samples=samples,
            visible=visible,
            corners_only=corners_only,
        )
        return visible

    def samples_of_boxes(
        self, frame: Frame, boxes: Float64, *, corners_only: bool = False
    ) -> Int64:
        """(k,) int64 samples that would show of inflated boxes relative to the eye, (k, 2, 3)
        float64, asked together."""
        rounded = round_outward(boxes)
        with phase(frame.stats, "query"):
            samples = self.queries.ask(
                frame.view,
                frame.target,
                rounded,
                frame.stats,
                way=self.way,
                cull_back_faces=not self.query_back_faces,
                corners_only=corners_only,
                state_hook=self.query_state,
            )
        frame.asked.append(Asked(rounded, samples, corners_only))
        return samples

    def observe(self, step: str, **data: Any) -> None:
        if self.observer is not None:
            self.observer(step, data)

    def _asked_at(self, frame: Frame, drawn: Int64) -> Int32 | None:
        """`DrawnSet.asked_at`."""
        if not self.notes_asked:
            return None
        before = np.cumsum([0, *map(len, frame.drawn)])
        asked_at = np.full(self.units.count, -1, np.int32)
        for units, parts in frame.asked_about:
            asked_at[units] = before[parts]
        return asked_at[drawn]

    def _count(self, frame: Frame, drawn: Int64) -> None:
        assert self.geometry is not None
        fragments = self.geometry.fragments(frame.view, frame.target, drawn)
        # Counted already where queries are no boxes.
        frame.stats.query_fragments = frame.stats.query_fragments or 0
        frame.stats.query_fragments_passed = frame.stats.query_fragments_passed or 0
        for corners_only in (False, True):
            asked = [part for part in frame.asked if part.corners_only == corners_only]
            if asked:
                boxes = np.concatenate([part.boxes for part in asked])
                passed = np.concatenate([part.samples for part in asked]) > 0
                of_box = self.queries.fragments(
                    frame.view,
                    frame.target,
                    boxes,
                    cull_back_faces=not self.query_back_faces,
                    corners_only=corners_only,
                )
                frame.stats.query_fragments += int(of_box.sum())
                frame.stats.query_fragments_passed += int(of_box[passed].sum())
        frame.stats.depth_tests = fragments + frame.stats.query_fragments


@contextmanager
def phase(stats: QueryStats, name: str) -> Iterator[None]:
    """Add the wall time of a block to a phase, in milliseconds."""
    watch = Stopwatch()
    try:
        with watch:
            yield
    finally:
        stats.ms[name] = stats.ms.get(name, 0.0) + watch.ms
