"""Ask the depth buffer about boxes with an item buffer: their ids as colours, read back.

Klosowski, Silva 2001, sections 3.2 and 3.4. Boxes are drawn with a colour each, tested against
depth and not writing it. What of a box comes first at a pixel hides the ids of the others there,
so the boxes found are left out and the rest is drawn again, until a pass finds none: that pass
alone proves that the rest is hidden.

- Tiles of 64 x 64 pixels: a tile in which a pass finds no id has none in later passes of the
  same question, whose boxes are fewer. Where the caller asks about the *whole* front, a tile
  that the first pass finds empty is retired for the frame: whatever could still show there would
  do so in a cell of the front.
- A single channel is read, and not four, while the ids fit in a byte. There is no limit at 255.

The colour buffer is the caller's choice: an image of its own beside the depth, or the picture
itself, which the caller then has to save and restore (section 3.5).
"""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.culler import QueryStats
from visref.scene import Float32, Int64
from visref_culling.gl.device import Device, State, set_uniform
from visref_culling.gl.view import View
from visref_culling.queries.occlusion_query import STRIP_VERTICES, StateHook

TILE_PX = 64
MOST_IDS_IN_A_BYTE = 255  # 0 is the background


class ItemBufferQueries:
    """Questions about boxes, answered by their ids in a colour buffer of four 8-bit channels."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.program = device.program("box.vert", "item_box.frag")
        self.vertex_array = device.context.vertex_array(
            self.program, [], mode=moderngl.TRIANGLE_STRIP
        )
        self.boxes = device.context.buffer(reserve=24, dynamic=True)
        self.active = np.zeros((0, 0), np.bool_)
        self.passes: list[Int64] = []

    def begin(self, width: int, height: int) -> None:
        """A new frame: every tile is active. Tiles count from the bottom left."""
        self.active = np.ones((-(-height // TILE_PX), -(-width // TILE_PX)), np.bool_)

    def ask(
        self,
        view: View,
        framebuffer: moderngl.Framebuffer,
        boxes: Float32,
        stats: QueryStats,
        *,
        whole_front: bool,
        cull_back_faces: bool,
        state_hook: StateHook = lambda state: state,
    ) -> Int64:
        """Pixels in which each box came first when it was found, (k,) int64; 0 where it is
        hidden. `boxes`: (k, 2, 3) float32, relative to the eye. `passes` then says which boxes
        each pass drew."""
        samples = np.zeros(len(boxes), np.int64)
        rest = np.arange(len(boxes))
        tiles = self.active.copy()
        self.passes = []
        while len(rest):
            state = State(
                framebuffer,
                self.program,
                depth_write=False,
                cull_back_faces=cull_back_faces,
                clamp_depth=True,
            )
            changes = self.device.apply(state_hook(state))
            self.clear(framebuffer)
            self.render(view, boxes[rest])
            pixels, hit = self.scan(framebuffer, tiles, len(rest), stats)
            stats.batches = (stats.batches or 0) + 1
            stats.state_changes = (stats.state_changes or 0) + changes
            self.passes.append(rest)
            tiles &= hit
            if whole_front and len(self.passes) == 1:
                self.retire(hit)
            found = pixels > 0
            samples[rest[found]] = pixels[found]
            rest = self.next_pass(rest, found)
        stats.queries = (stats.queries or 0) + len(boxes)
        stats.queries_passed = (stats.queries_passed or 0) + int(np.count_nonzero(samples))
        return samples

    # The steps.

    def next_pass(self, rest: Int64, found: NDArray[np.bool_]) -> Int64:
        """(m,) int64: the boxes to draw again, of `rest`, (n,) int64, of which `found`, (n,)
        bool, showed; none where the pass found none."""
        return rest[~found] if found.any() else rest[:0]

    def retire(self, hit: NDArray[np.bool_]) -> None:
        """Take tiles without an id out of the frame. `hit`: (rows, columns) bool, lowest row
        first."""
        self.active &= hit

    def clear(self, framebuffer: moderngl.Framebuffer) -> None:
        self.device.clear_colour(framebuffer)

    def render(self, view: View, boxes: Float32) -> None:
        """Draw boxes, (n, 2, 3) float32 relative to the eye, each with its place + 1 as id."""
        set_uniform(self.program, "corners_only", np.int32(0).tobytes())
        set_uniform(self.program, "clip_from_relative", view.clip_from_relative_bytes)
        set_uniform(self.program, "depth_shift_ndc", np.float32(view.depth_shift_ndc).tobytes())
        self.boxes.orphan(max(self.boxes.size, boxes.nbytes))
        self.boxes.write(np.ascontiguousarray(boxes, np.float32).tobytes())
        self.boxes.bind_to_storage_buffer(1)
        self.vertex_array.render(vertices=STRIP_VERTICES, instances=len(boxes))

    def channels(self, count: int) -> int:
        """How many of the four to read for so many ids."""
        return 1 if count <= MOST_IDS_IN_A_BYTE else 4

    def scan(
        self,
        framebuffer: moderngl.Framebuffer,
        tiles: NDArray[np.bool_],
        count: int,
        stats: QueryStats,
    ) -> tuple[Int64, NDArray[np.bool_]]:
        """Read the `tiles`, (rows, columns) bool, lowest row first: pixels of each of `count`
        ids, (count,) int64, and the tiles that hold any, (rows, columns) bool."""
        pixels = np.zeros(count + 1, np.int64)
        hit = np.zeros_like(tiles)
        for row, first, last in runs(tiles):
            items = self.read(framebuffer, row, first, last, self.channels(count))
            stats.bytes_read_back = (stats.bytes_read_back or 0) + items.nbytes
            starts = np.arange(0, items.shape[1], TILE_PX)
            hit[row, first:last] = np.maximum.reduceat(items.max(axis=0), starts) > 0
            if hit[row, first:last].any():
                pixels += np.bincount(items.reshape(-1), minlength=count + 1)[: count + 1]
        return pixels[1:], hit

    def read(
        self, framebuffer: moderngl.Framebuffer, row: int, first: int, last: int, channels: int
    ) -> NDArray[np.unsignedinteger[Any]]:
        """(height, width) uint8 or uint32, lowest row first: the ids in tiles first ...
        last - 1 of a row of tiles, a pixel each."""
        x, y = first * TILE_PX, row * TILE_PX
        width = min(last * TILE_PX, framebuffer.width) - x
        height = min(TILE_PX, framebuffer.height - y)
        raw = framebuffer.read(viewport=(x, y, width, height), components=channels, alignment=1)
        kind: type[np.unsignedinteger[Any]] = np.uint8 if channels == 1 else np.uint32
        return np.frombuffer(raw, np.dtype(kind).newbyteorder("<")).reshape(height, width)

    def release(self) -> None:
        self.vertex_array.release()
        self.boxes.release()


def runs(tiles: NDArray[np.bool_]) -> list[tuple[int, int, int]]:
    """(row, first, last) of each run of neighbouring tiles in a row, `last` exclusive."""
    found = []
    for row, line in enumerate(tiles):
        edges = np.flatnonzero(np.diff(line, prepend=False, append=False))
        found += [(row, int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return found
