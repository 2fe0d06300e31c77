"""Occlusion culling with N-buffers.

X. Décoret: N-Buffers for efficient depth map query. Computer Graphics Forum 24(3), 2005, section
3.1.

What was visible in the last frame is drawn first, with this frame's camera. An N-buffer is built
of that depth, and every object in the view is tested against it, those just drawn too: an object
is hidden if the nearest depth of its box is farther than all depths in its box's rectangle on the
screen. What is visible and not drawn yet is drawn then. What was tested visible, and not what was
drawn, is remembered: a stale occluder is drawn once for nothing and forgotten.

Memory only chooses occluders, and these are drawn with the camera of the frame that they hide
things in, and where they are in that frame; so neither a jump cut nor a fast turn, and nothing that
moves, can make the method unsafe. What is absent is not drawn, and what appears was not seen, so it
is tested. Each view of a frame remembers what it saw itself. An occluder hides nothing of itself
either: its own depth lies in its own rectangle, and is not nearer than its box.

- `where=cpu`: `n_buffer.depth_map`; `where=gpu`: `n_buffer.gpu_cull`.
- `hierarchy`: whole branches of a tree of boxes are tested first (CPU).
- `test=query`: the paper's comparison, the same algorithm with occlusion queries of the boxes.

Departures from the paper:

- The box's depth and rectangle come from the inflated box (`boxes.conservative`), and depths that
  compare equal are visible.
- A box across the near plane or around the eye is visible without a test.
- Objects without opaque triangles are no occluders.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import Option
from visref.errors import InputError
from visref.scene import Float64, Int64, Scene, Units
from visref_culling.boxes.conservative import inflated, meets_frustum, nearest_depth
from visref_culling.boxes.hierarchy import FAN_OUT
from visref_culling.gl.changes import Changes
from visref_culling.gl.view import View
from visref_culling.method import GL_OPTIONS, Frame, GLCuller, phase
from visref_culling.n_buffer.cover import FOUR, ONE
from visref_culling.n_buffer.depth_map import DepthMapQueries
from visref_culling.n_buffer.gpu_cull import GpuCull


class NBufferCulling(GLCuller):
    """Last frame's visible objects as occluders, all objects tested by an N-buffer."""

    name = "n-buffer"
    summary = "Décoret 2005: boxes looked up in an N-buffer of last frame's visible objects"
    options: ClassVar[Mapping[str, Option]] = {
        "where": Option("cpu", "who tests the boxes", ("cpu", "gpu")),
        "hierarchy": Option(False, "test branches of a tree of boxes first (where=cpu)"),
        "squares": Option(FOUR, "squares over a box's rectangle", (FOUR, ONE)),
        "test": Option("n-buffer", "look up, or occlusion queries instead", ("n-buffer", "query")),
        **GL_OPTIONS,
    }

    notes_asked = True
    # With test=query: all boxes out, then all answers in.
    way = "batch"
    map_queries: type[DepthMapQueries] = DepthMapQueries
    gpu_cull: type[GpuCull] = GpuCull

    def __init__(
        self,
        *,
        where: str = "cpu",
        hierarchy: bool = False,
        squares: int = FOUR,
        test: str = "n-buffer",
        depth: int = 24,
        fragments: bool = False,
    ) -> None:
        super().__init__(depth=depth, fragments=fragments)
        if where == "gpu" and (hierarchy or test == "query"):
            raise InputError("the GPU looks up every box alone", fix="leave where=cpu")
        if test == "query" and squares != FOUR:
            raise InputError("an occlusion query covers no squares", fix="leave squares out")
        self.on_gpu, self.hierarchy, self.squares = where == "gpu", hierarchy, squares
        self.looks_up = test == "n-buffer"
        self.gpu: GpuCull | None = None

    def prepare(self, scene: Scene) -> Units:
        units = super().prepare(scene)
        assert self.geometry is not None
        self.map = self.map_queries(self.squares)
        # Commands on the GPU draw no masked occluder.
        hides = self.occluders(scene) if self.on_gpu else self.geometry.hides
        self.can_occlude = self.units_with(hides)
        # By view, whose occluders are what it saw itself.
        self.seen_of_view: dict[str, NDArray[np.bool_]] = {}
        if self.on_gpu:
            self.gpu = self.gpu_cull(
                self.device, self.geometry, self.unit_boxes, self.can_occlude, self.squares
            )
        return units

    def follow(self, changes: Changes) -> None:
        super().follow(changes)
        if self.gpu is not None:
            self.gpu.move(self.unit_boxes, changes.units(self.units))

    def _release(self) -> None:
        super()._release()
        if self.gpu is not None:
            self.gpu.release()
            self.gpu = None

    # The steps.

    def remembered(self, frame: Frame) -> NDArray[np.bool_]:
        """(k,) bool of the frame's units: the occluders."""
        seen = self.seen_by(frame.view.camera)
        chosen: NDArray[np.bool_] = (seen & self.can_occlude)[frame.ids]
        return chosen

    def seen_by(self, camera: Camera) -> NDArray[np.bool_]:
        """(u,) bool: the units that the camera's view saw last."""
        nothing = np.zeros(self.units.count, np.bool_)
        return self.seen_of_view.setdefault(camera.view, nothing)

    def visible(self, frame: Frame, boxes: Float64, sure: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(k,) bool, whether boxes would show: units' or branches'. `boxes`: (k, 2, 3) float64,
        inflated, relative to the eye; `sure`: (k,) bool, visible without asking."""
        shown = sure.copy()
        unsure = np.flatnonzero(~sure)
        if self.looks_up:
            nearest = self.nearest(frame, boxes[unsure])
            with phase(frame.stats, "query"):
                shown[unsure] = self.map.ask(boxes[unsure], nearest, frame.stats)
        else:
            shown[unsure] = self.passes(self.samples_of_boxes(frame, boxes[unsure]))
        self.observe("test", boxes=boxes, sure=sure, visible=shown)
        return shown

    def nearest(self, frame: Frame, boxes: Float64) -> Float64:
        """(k,) float64: the least view depths of boxes (k, 2, 3) float64 relative to the eye."""
        return nearest_depth(frame.view, boxes)

    def needs_no_query(self, view: View, boxes: Float64) -> NDArray[np.bool_]:
        """(k,) bool, visible without asking, of inflated boxes (k, 2, 3) float64 relative to
        the eye."""
        if not self.looks_up:
            return super().needs_no_query(view, boxes)
        # A rectangle is computed and not drawn, so nothing else needs sparing.
        crosses: NDArray[np.bool_] = nearest_depth(view, boxes) <= view.camera.near
        return crosses

    # The algorithm.

    def begin(self, camera: Camera) -> Frame:
        # On the GPU nothing is sorted or culled here.
        return self.open(camera) if self.on_gpu else super().begin(camera)

    def decide(self, frame: Frame) -> None:
        if self.gpu is not None:
            decided = self.gpu.frame(frame.view, frame.target, frame.stats)
            frame.drawn.append(decided.occluders)
            frame.note_asked(decided.asked)
            frame.drawn.append(decided.others)
            return
        old = self.remembered(frame)
        self.draw(frame, np.flatnonzero(old))
        if self.looks_up:
            with phase(frame.stats, "build"):
                self.map.begin(frame.view, frame.target, frame.stats)
        shown = self.descend(frame) if self.hierarchy else self.test_all(frame)
        # Occluders were drawn without asking, and are asked about for the next frame's sake.
        frame.note_asked(frame.ids[shown & ~frame.sure & ~old])
        seen = self.seen_by(frame.view.camera)
        seen[:] = False
        seen[frame.ids[shown]] = True
        self.draw(frame, np.flatnonzero(shown & ~old))

    def test_all(self, frame: Frame) -> NDArray[np.bool_]:
        """(k,) bool over the frame's units."""
        return self.visible(frame, frame.boxes, frame.sure)

    def descend(self, frame: Frame) -> NDArray[np.bool_]:
        """(k,) bool over the frame's units, down the tree: what is hidden whole is not looked
        into."""
        view, levels = frame.view, self.tree.levels
        nodes: Int64 = np.arange(len(levels[-1]))
        for depth in range(len(levels) - 1, -1, -1):
            boxes = inflated(view, levels[depth][nodes])
            inside = meets_frustum(view, boxes)
            nodes, boxes = nodes[inside], boxes[inside]
            nodes = nodes[self.visible(frame, boxes, self.needs_no_query(view, boxes))]
            if depth:
                children = (nodes[:, None] * FAN_OUT + np.arange(FAN_OUT)).reshape(-1)
                nodes = children[children < len(levels[depth - 1])]
        return np.isin(frame.ids, self.tree.ids[nodes])
