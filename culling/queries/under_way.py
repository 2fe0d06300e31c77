"""Occlusion queries that go out one after the other and are read later, each about some boxes.

The boxes of a frame are sent once; a query is about ranges of them and passes where any of them
would show. Two ways:

- `BoxesUnderWay`: GL's own occlusion queries. Reading an answer waits until GL has it.
- `SoftwareBoxes`: the boxes' rectangles and nearest depths, looked up in `SoftwareBuffer`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable

import moderngl
import numpy as np

from visref.culler import QueryStats
from visref.scene import Float64, Int64
from visref_culling.boxes.conservative import nearest_depth, round_outward
from visref_culling.boxes.rectangles import screen_rectangles
from visref_culling.gl.device import State, Target
from visref_culling.gl.view import View
from visref_culling.queries.occlusion_query import (
    STRIP_STRIDE,
    STRIP_VERTICES,
    BoxQueries,
    StateHook,
)
from visref_culling.queries.software_depth import SoftwareBuffer

Range = tuple[int, int]  # the first of a frame's boxes, and the one after the last


class UnderWay(ABC):
    """Queries of one frame at a time, numbered as they go out."""

    def begin(self, view: View, target: Target, boxes: Float64, stats: QueryStats) -> None:
        """A new frame; what was under way is forgotten. `boxes`: (n, 2, 3) float64, inflated,
        relative to the eye; those that are asked about lie beyond the near plane."""
        self.view, self.target, self.boxes, self.stats = view, target, boxes, stats

    @abstractmethod
    def ask(self, ranges: Iterable[Range]) -> int:
        """Send a query about some ranges of boxes; its number."""

    @abstractmethod
    def samples(self, query: int) -> int:
        """Of a query that was sent: how many samples of its boxes would show, each box's counted;
        a way that does not count them says 1 for any number."""

    def drawn(self, units: Int64) -> None:
        """These units, (k,) ids, were drawn; a buffer beside GL's must follow."""

    def _count(self, samples: int) -> int:
        self.stats.queries_passed = (self.stats.queries_passed or 0) + (samples > 0)
        return samples


class BoxesUnderWay(UnderWay):
    """GL's own. `state_hook` sees the GL state before it is set."""

    def __init__(
        self, queries: BoxQueries, *, cull_back_faces: bool, state_hook: StateHook
    ) -> None:
        self.queries, self.device = queries, queries.device
        self.cull_back_faces, self.state_hook = cull_back_faces, state_hook

    def begin(self, view: View, target: Target, boxes: Float64, stats: QueryStats) -> None:
        super().begin(view, target, boxes, stats)
        self.sent = 0
        if len(boxes):
            self.queries.upload(self.queries.plain, view, round_outward(boxes), corners_only=False)

    def ask(self, ranges: Iterable[Range]) -> int:
        state = State(
            self.target.framebuffer,
            self.queries.plain,
            depth_write=False,
            colour_write=False,
            cull_back_faces=self.cull_back_faces,
            clamp_depth=True,
        )
        changes = self.device.apply(self.state_hook(state))
        self.stats.state_changes = (self.stats.state_changes or 0) + changes
        # Whatever drew meanwhile may have used the same place.
        self.queries.boxes.bind_to_storage_buffer(1)

        def draw() -> None:
            for first, end in ranges:
                self.queries.plain_array.render(
                    moderngl.TRIANGLE_STRIP,
                    vertices=STRIP_VERTICES,
                    first=STRIP_STRIDE * first,
                    instances=end - first,
                )

        return self.ask_around(draw)

    def ask_around(self, draw: Callable[[], None]) -> int:
        """Send a query about whatever `draw` draws; its number."""
        query = self.device.queries(self.sent + 1)[self.sent]
        with query:
            draw()
        self.stats.queries = (self.stats.queries or 0) + 1
        self.sent += 1
        return self.sent - 1

    def samples(self, query: int) -> int:
        return self._count(int(self.device.queries(query + 1)[query].samples))


class SoftwareBoxes(UnderWay):
    """By a depth buffer on the CPU that follows what is drawn. An answer is there at once."""

    def __init__(self, buffer: SoftwareBuffer) -> None:
        self.buffer = buffer

    def begin(self, view: View, target: Target, boxes: Float64, stats: QueryStats) -> None:
        super().begin(view, target, boxes, stats)
        self.buffer.begin(view, target, stats)
        self.rectangles = screen_rectangles(view, boxes)
        self.depths = self.buffer.depth_of(nearest_depth(view, boxes))
        self.answers: list[int] = []
        stats.lookups = stats.lookups or 0

    def ask(self, ranges: Iterable[Range]) -> int:
        boxes = np.concatenate([np.arange(first, end) for first, end in ranges])
        self.stats.queries = (self.stats.queries or 0) + 1
        self.answers.append(int(any(self._shows(box) for box in boxes.tolist())))
        return len(self.answers) - 1

    def _shows(self, box: int) -> bool:
        x0, y0, x1, y1 = self.rectangles[box].tolist()
        if x0 > x1 or y0 > y1:
            return False
        depths = self.buffer.pixels((x0, y0, x1 + 1, y1 + 1))
        self.stats.lookups = (self.stats.lookups or 0) + depths.size
        return bool(self.depths[box] <= self.buffer.farthest(depths))

    def samples(self, query: int) -> int:
        return self._count(self.answers[query])

    def drawn(self, units: Int64) -> None:
        self.buffer.drawn(units)
