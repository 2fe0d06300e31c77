"""N-buffer culling wholly on the GPU (`boxes.commands`)."""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.culler import QueryStats
from visref.scene import Float64
from visref_culling.boxes.commands import BoxCommands, Decided, view_bytes
from visref_culling.gl.device import Device, Target
from visref_culling.gl.geometry import Geometry
from visref_culling.gl.view import View
from visref_culling.n_buffer.cover import ONE
from visref_culling.n_buffer.gpu import NBufferTexture

SHADER = "n_buffer_cull.comp"


class GpuCull(BoxCommands):
    """What was seen in the last frame is drawn, and then what an N-buffer of that does not hide.
    Arguments as `BoxCommands`'."""

    texture: type[NBufferTexture] = NBufferTexture

    def __init__(
        self,
        device: Device,
        geometry: Geometry,
        bounds: Float64,
        can_occlude: NDArray[np.bool_],
        squares: int,
    ) -> None:
        super().__init__(device, geometry, bounds, can_occlude, fix="use where=cpu")
        self.squares = squares
        self.map: NBufferTexture | None = None

    def load(self) -> moderngl.ComputeShader:
        return self.device.compute(SHADER)

    def frame(self, view: View, target: Target, stats: QueryStats) -> Decided:
        """Draw what may be visible."""
        if not self.units:
            return Decided(*np.zeros((3, 0), np.int64))
        levels = self.map_of(target)
        self.look_from([view_bytes(view, len(self.geometry.classes))])
        for occluders in (True, False):
            if not occluders:
                levels.build(target)
                self.shader["one_square"] = self.squares == ONE
            levels.use(self.shader)
            self.shader["occluders"] = occluders
            self.run(view.camera)
            self.draw(view, target, stats)
        before = stats.queries or 0
        decided = self.read(view.camera, stats)
        asked = (stats.queries or 0) - before
        stats.lookups = (stats.lookups or 0) + asked * self.squares
        return decided

    def map_of(self, target: Target) -> NBufferTexture:
        """The N-buffer of this image's size."""
        size = target.framebuffer.size
        if self.map is None or self.map.size != size:
            if self.map is not None:
                self.map.release()
            self.map = self.texture(self.device, *size)
        return self.map

    def release(self) -> None:
        if self.map is not None:
            self.map.release()
        super().release()
