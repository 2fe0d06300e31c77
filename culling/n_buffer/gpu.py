"""N-buffers on the GPU: one pass per level, and the levels for shaders to look up."""

from __future__ import annotations

import moderngl
import numpy as np

from visref.scene import Float32
from visref_culling.gl.device import Device, Target
from visref_culling.n_buffer.levels import level_count

GROUP = 16  # work items on a side of a group, as in the shaders


class NBufferTexture:
    """An N-buffer of one image size: a float32 texture array, one layer per level.

    Window depth goes in as GL samples it: a 24-bit depth comes as the float32 nearest to it.
    Levels only copy and compare, so they add no rounding. `farthest` False keeps the nearest.
    """

    def __init__(self, device: Device, width: int, height: int, *, farthest: bool = True) -> None:
        self.device, self.size, self.farthest = device, (width, height), farthest
        self.levels = level_count(width, height) + 1
        self.texture = device.context.texture_array((width, height, self.levels), 1, dtype="f4")
        # Only texelFetch looks, which filters nothing; without mipmaps, Mesa calls the texture
        # complete with this filter alone.
        self.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)

    def build(self, target: Target, *, levels: int | None = None) -> None:
        """All levels, or the first `levels` above level 0, from the target's depth."""
        base = self.shader("n_buffer_base.comp")
        target.depth.use(0)
        base["depth_buffer"] = 0
        self.texture.bind_to_image(0, read=False, write=True)
        self._run(base)
        self.join(levels=levels)

    def join(self, *, levels: int | None = None) -> None:
        """The levels above level 0, which is as it is."""
        step = self.shader("n_buffer_level.comp")
        step["farthest"] = self.farthest
        self.texture.bind_to_image(0, read=True, write=False)
        self.texture.bind_to_image(1, read=False, write=True)
        for level in range(1, self.levels if levels is None else min(levels + 1, self.levels)):
            step["level"] = level
            self._run(step)

    def shader(self, name: str) -> moderngl.ComputeShader:
        return self.device.compute(name)

    def _run(self, shader: moderngl.ComputeShader) -> None:
        width, height = self.size
        shader.run(-(-width // GROUP), -(-height // GROUP))
        self.device.context.memory_barrier(
            moderngl.SHADER_IMAGE_ACCESS_BARRIER_BIT | moderngl.TEXTURE_FETCH_BARRIER_BIT
        )

    def use(self, program: moderngl.Program | moderngl.ComputeShader, *, unit: int = 1) -> None:
        """Bind it for a shader that includes `n_buffer.glsl`."""
        self.texture.use(unit)
        program["n_buffer"] = unit
        # A compiler drops what one kind of lookup does not need.
        if "n_buffer_farthest" in program:
            program["n_buffer_farthest"] = self.farthest

    def read(self) -> Float32:
        """(levels, height, width) float32, first row at the top; of all levels, built or not."""
        width, height = self.size
        raw = np.frombuffer(self.texture.read(), np.float32)
        return raw.reshape(self.levels, height, width)

    def release(self) -> None:
        self.texture.release()
