"""Ask the depth buffer about boxes with an image histogram: ids are counted where they are.

Klosowski, Silva 2001, section 3.3: as with the item buffer (`queries.item_buffer_query`),
but the picture of ids stays on the GPU, and only how often each id occurs comes back. The
paper's histogram is a pixel-transfer operation of OpenGL 1.2, gone today; here a compute shader
counts, over the active tiles alone. Its 256 bins limit the ids no longer.
"""

from __future__ import annotations

from importlib.resources import files

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.culler import QueryStats
from visref.scene import Int64
from visref_culling.gl.device import Device
from visref_culling.queries.item_buffer_query import TILE_PX, ItemBufferQueries


class HistogramQueries(ItemBufferQueries):
    """The item buffer's passes, with the scan on the GPU."""

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        source = files("visref_culling") / "shaders" / "item_histogram.comp"
        self.counting = device.context.compute_shader(source.read_text(encoding="utf-8"))
        self.corners, self.histogram, self.hits = (
            device.context.buffer(reserve=8, dynamic=True) for _ in range(3)
        )

    def scan(
        self,
        framebuffer: moderngl.Framebuffer,
        tiles: NDArray[np.bool_],
        count: int,
        stats: QueryStats,
    ) -> tuple[Int64, NDArray[np.bool_]]:
        """As of the base class: pixels of each id, (count,) int64, and which `tiles`,
        (rows, columns) bool, hold any, the same shape."""
        hit = np.zeros_like(tiles)
        places = np.argwhere(tiles)
        if not len(places):
            return np.zeros(count, np.int64), hit
        corners = (places[:, ::-1] * TILE_PX).astype(np.int32)
        self.corners.orphan(max(self.corners.size, corners.nbytes))
        self.corners.write(np.ascontiguousarray(corners).tobytes())
        for buffer, size in ((self.histogram, 4 * (count + 1)), (self.hits, 4 * len(places))):
            buffer.orphan(max(buffer.size, size))
            buffer.clear()
        for binding, buffer in enumerate((self.corners, self.histogram, self.hits), start=1):
            buffer.bind_to_storage_buffer(binding)
        image = framebuffer.color_attachments[0]
        assert isinstance(image, moderngl.Texture)
        image.use(0)
        for name, value in (("items", 0), ("tile", TILE_PX), ("ids", count)):
            self.counting[name] = value
        self.counting.run(len(places))
        self.device.context.memory_barrier(moderngl.BUFFER_UPDATE_BARRIER_BIT)
        pixels = np.frombuffer(self.histogram.read(4 * (count + 1)), np.uint32)
        of_tile = np.frombuffer(self.hits.read(4 * len(places)), np.uint32)
        stats.bytes_read_back = (stats.bytes_read_back or 0) + pixels.nbytes + of_tile.nbytes
        hit[tuple(places.T)] = of_tile > 0
        return pixels[1:].astype(np.int64), hit

    def release(self) -> None:
        super().release()
        self.counting.release()
        for buffer in (self.corners, self.histogram, self.hits):
            buffer.release()
