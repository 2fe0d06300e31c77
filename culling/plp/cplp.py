"""Conservative Prioritized-Layered Projection: PLP on a budget, then queries of its front.

Klosowski, Silva 2001. Section 2.2: PLP draws its estimate; then, until the front is empty, the
cells of the front that the depth buffer hides are taken out of it, and all others are projected,
whose neighbours make the next front. What is found hidden stays hidden, since depth only comes
nearer, so no cell is asked twice.

Why nothing visible is missed: on the way from the near plane to a visible point, a ray passes a
chain of cells, each a face neighbour of the one before. The first seeds the front. While the
point is not drawn, nothing that is drawn lies before it, so the next cell of the chain shows at
that sample, in whatever order it is asked, and is projected. Where a ray runs through an edge
that cells share, the chain goes by a cell that it only touches; queried boxes are inflated, so
that one shows too.

The four ways of asking (section 3) are `query`; each finds the same cells:

- `occlusion-query` (cPLP-HP): a hardware query for each, waited for.
- `item-buffer` (cPLP-IB) and `histogram` (cPLP-HG): ids in a colour buffer, in several passes.
- `fragment-histogram` (cPLP-EXT): all at once, behind early fragment tests. The paper proposes
  it as hardware that counts each cell's fragments; shaders do it today, and since only whether a
  cell shows is asked, they leave a mark in place of a count.

The item buffer and the histogram need a colour buffer. `image=restore` is section 3.5: the
estimate's picture is saved, ids go over it while later triangles go to depth alone, and in the
end the picture is restored and those triangles are drawn once more, with colour. `image=separate`
gives ids an image of their own beside the same depth.

`order` gives the baselines: `front-to-back` is the paper's HP, cells by distance, each asked
before it is drawn, without PLP; `frustum` its VF-BF, every cell in view.

Departures from the paper, besides PLP's: a cell that holds the eye or crosses the near plane is
projected without a query as soon as it is in the front, since its box cannot be drawn whole.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import Option, Promise, QueryStats
from visref.errors import InputError
from visref.scene import Int32, Int64, Scene
from visref_culling.boxes.conservative import round_outward
from visref_culling.gl.device import State, Target
from visref_culling.gl.item_buffer import GLRaster
from visref_culling.method import GL_OPTIONS, QUERY_OPTIONS, Asked, Frame, GLCuller, phase
from visref_culling.plp.plp import PLP_OPTIONS, PLPCulling
from visref_culling.queries.histogram import HistogramQueries
from visref_culling.queries.item_buffer_query import ItemBufferQueries

HARDWARE_WAYS = {"occlusion-query": "sync", "fragment-histogram": "instanced"}
ITEM_WAYS = {"item-buffer": ItemBufferQueries, "histogram": HistogramQueries}


class ConservativePLPCulling(PLPCulling):
    """cPLP; see the module."""

    name = "cplp"
    summary = "Klosowski 2001: PLP on a budget, then visibility queries of its front until empty"
    promise = Promise.CONSERVATIVE
    options: ClassVar[Mapping[str, Option]] = {
        "query": Option(
            "fragment-histogram",
            "how the front is asked: -EXT, -HP, -IB or -HG",
            ("fragment-histogram", "occlusion-query", "item-buffer", "histogram"),
        ),
        **PLP_OPTIONS,
        "order": Option(
            "plp",
            "the method; or a baseline: cells by distance, each asked (HP), or all in view (VF-BF)",
            ("plp", "front-to-back", "frustum"),
        ),
        "image": Option(
            "separate",
            "where item buffer and histogram put ids: beside the picture, or over it (3.5)",
            ("separate", "restore"),
        ),
        "backfaces": QUERY_OPTIONS["backfaces"],
        **GL_OPTIONS,
    }

    def __init__(
        self,
        *,
        query: str = "fragment-histogram",
        budget: int = 25000,
        leaf: int = 5000,
        solidity: str = "area",
        order: str = "plp",
        image: str = "separate",
        backfaces: bool = False,
        depth: int = 24,
        fragments: bool = False,
    ) -> None:
        super().__init__(
            budget=budget, leaf=leaf, solidity=solidity, depth=depth, fragments=fragments
        )
        self.query_back_faces = backfaces
        self.cell_order = order
        self.items: ItemBufferQueries | None = None
        if query in HARDWARE_WAYS:
            self.way = HARDWARE_WAYS[query]
        else:
            self.items = self.items_of(query)
        self.restores = image == "restore"
        if self.restores and (self.items is None or order != "plp"):
            raise InputError(
                "image=restore has no ids to put over the picture",
                place="image",
                fix="give query=item-buffer or query=histogram, and order=plp",
            )
        # Cells found after the estimate are asked about over others drawn to depth alone.
        self.notes_asked = not self.restores
        self.saved: moderngl.Framebuffer | None = None

    def decide(self, frame: Frame) -> None:
        if self.items is not None:
            self.items.begin(frame.view.camera.width, frame.view.camera.height)
        if self.cell_order == "plp":
            self.begin_walk(frame)
            self.estimate(frame)
            self.complete(frame)
        else:
            self.baseline(frame)

    def complete(self, frame: Frame) -> None:
        """Step 2: ask the front and project what shows, until the front is empty."""
        walk = self.walk
        self.later: list[tuple[Int64, Int32]] = []
        frame.stats.iterations = 0
        self.save(frame)
        while True:
            self.project_sure(frame)
            front = walk.front()
            if self.is_done(len(front)):
                break
            frame.stats.iterations += 1
            visible = self.query(frame, self.place_of_cell[front])
            self.take_out(front[~visible])
            with phase(frame.stats, "traverse"):
                cells = walk.project(only=front[visible])
            self.show(frame, cells)
        self.restore(frame)

    def baseline(self, frame: Frame) -> None:
        """HP or VF-BF: the cells in view that are not empty, by distance."""
        filled = np.flatnonzero(self.units.sizes[frame.ids] > 0)
        if self.cell_order == "frustum":
            self.draw(frame, filled)
            return
        for place in filled:
            one = np.array([place])
            if frame.sure[place] or self.query(frame, one)[0]:
                self.draw(frame, one)

    def close(self) -> None:
        super().close()
        if self.items is not None:
            self.items.release()
            self.items = None
        self.forget_saved()

    # The steps.

    def items_of(self, query: str) -> ItemBufferQueries:
        return ITEM_WAYS[query](self.device)

    def raster_of(self, scene: Scene) -> GLRaster | None:
        return GLCuller.raster_of(self, scene)

    def target_for(self, camera: Camera) -> Target:
        channels = 1 if self.items is None else 4
        return self.device.target(camera.width, camera.height, self.depth_bits, channels=channels)

    def is_done(self, front: int) -> bool:
        return front == 0

    def project_sure(self, frame: Frame) -> None:
        """Project the cells of the front that need no query, until there are none."""
        while True:
            front = self.walk.front()
            sure = front[frame.sure[self.place_of_cell[front]]]
            if not len(sure):
                return
            self.show(frame, self.walk.project(only=sure))

    def take_out(self, hidden: Int64) -> None:
        """Cells found hidden, (n,) int64 ids, leave the front, and never return."""
        self.walk.hide(hidden)

    def show(self, frame: Frame, cells: Int64) -> None:
        """Draw cells found after the estimate, (n,) int64 ids: to depth alone where the picture
        is taken."""
        self.observe("show", cells=cells)
        if not self.restores:
            self.draw_cells(frame, cells)
            return
        assert self.geometry is not None
        cells = cells[self.units.sizes[cells] > 0]
        with phase(frame.stats, "draw"):
            triangles = self.geometry.fresh(cells)
            state = State(frame.target.framebuffer, self.geometry.program, colour_write=False)
            self.geometry.draw_triangles(frame.view, state, triangles, QueryStats())
        self.later.append((cells, triangles))

    def save(self, frame: Frame) -> None:
        """Keep the estimate's picture."""
        if not self.restores:
            return
        size = frame.target.framebuffer.size
        if self.saved is None or self.saved.size != size:
            self.forget_saved()
            self.saved = self.device.context.framebuffer([self.device.context.texture(size, 4)])
        with phase(frame.stats, "restore"):
            self.device.context.copy_framebuffer(self.saved, frame.target.framebuffer)

    def restore(self, frame: Frame) -> None:
        """Bring the estimate's picture back, and what was found since into it."""
        if not self.restores:
            return
        assert self.geometry is not None
        assert self.saved is not None
        with phase(frame.stats, "restore"):
            # No depth is copied: what is kept has none.
            self.device.context.copy_framebuffer(frame.target.framebuffer, self.saved)
        self.render_again(frame)

    def render_again(self, frame: Frame) -> None:
        """Draw in colour what went to depth alone."""
        assert self.geometry is not None
        if not self.later:
            return
        ids = np.concatenate([cells for cells, _ in self.later])
        triangles = np.concatenate([triangles for _, triangles in self.later])
        with phase(frame.stats, "restore"):
            state = State(frame.target.framebuffer, self.geometry.program)
            self.geometry.draw_triangles(frame.view, state, triangles, frame.stats)
        frame.stats.units_drawn = (frame.stats.units_drawn or 0) + len(ids)
        frame.drawn.append(ids)
        self.observe("draw", units=ids)

    def query(
        self, frame: Frame, places: Int64, *, corners_only: bool = False
    ) -> NDArray[np.bool_]:
        """(n,) bool: whether the boxes of the cells `frame.ids[places]`, (n,) int64 places,
        would show."""
        if self.items is None:
            return super().query(frame, places, corners_only=corners_only)
        boxes = round_outward(frame.boxes[places])
        target = frame.target.framebuffer if self.restores else frame.target.scratch
        with phase(frame.stats, "query"):
            samples = self.items.ask(
                frame.view,
                target,
                boxes,
                frame.stats,
                whole_front=self.cell_order == "plp",
                cull_back_faces=not self.query_back_faces,
                state_hook=self.query_state,
            )
        visible = self.passes(samples)
        frame.note_asked(frame.ids[places])
        for drawn in self.items.passes:
            frame.asked.append(Asked(boxes[drawn], samples[drawn], corners_only=False))
        self.observe("query", units=frame.ids[places], samples=samples, visible=visible)
        return visible

    def forget_saved(self) -> None:
        if self.saved is not None:
            for image in self.saved.color_attachments:
                image.release()
            self.saved.release()
            self.saved = None
