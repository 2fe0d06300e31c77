"""A pyramid of depth on the GPU: each level holds the farthest depth of 2 x 2 texels below."""

from __future__ import annotations

import moderngl
import numpy as np

from visref.scene import Float32
from visref_culling.gl.device import Device, Target

GROUP = 16  # work items on a side of a group, as in the shaders
BASE, LEVEL = "hzb_base.comp", "hzb_level.comp"


class DepthPyramid:
    """The farthest window depths of one image, as the levels of a float32 texture.

    Level 0 has the image's size, each other one half of that below it, rounded down. A level's
    texel (x, y) holds the pixels from (x, y) << level on, 1 << level of them each way; the last of
    a row or column holds all that is left. Levels only copy and compare: they add no rounding.
    """

    def __init__(self, device: Device, width: int, height: int) -> None:
        self.device, self.size = device, (width, height)
        self.levels = max(width, height).bit_length()
        self.texture = device.context.texture((width, height), 1, dtype="f4")
        self.texture.build_mipmaps(0, self.levels - 1)
        # Only texelFetch looks, which filters nothing.
        self.texture.filter = (moderngl.NEAREST_MIPMAP_NEAREST, moderngl.NEAREST)

    def build(self, target: Target) -> None:
        """All levels, from the target's depth."""
        base = self.shader(BASE)
        target.depth.use(0)
        base["depth_buffer"] = 0
        self.texture.bind_to_image(0, read=False, write=True)
        self._run(base, 0)
        self.reduce()

    def reduce(self) -> None:
        """The levels above level 0, which is as it is."""
        step = self.shader(LEVEL)
        for level in range(1, self.levels):
            self.texture.bind_to_image(0, read=True, write=False, level=level - 1)
            self.texture.bind_to_image(1, read=False, write=True, level=level)
            self._run(step, level)

    def shader(self, name: str) -> moderngl.ComputeShader:
        return self.device.compute(name)

    def size_of(self, level: int) -> tuple[int, int]:
        width, height = self.size
        return max(1, width >> level), max(1, height >> level)

    def _run(self, shader: moderngl.ComputeShader, level: int) -> None:
        width, height = self.size_of(level)
        shader.run(-(-width // GROUP), -(-height // GROUP))
        self.device.context.memory_barrier(
            moderngl.SHADER_IMAGE_ACCESS_BARRIER_BIT | moderngl.TEXTURE_FETCH_BARRIER_BIT
        )

    def use(self, shader: moderngl.ComputeShader, *, unit: int = 1) -> None:
        """Bind it for a shader that includes `hzb.glsl`."""
        self.texture.use(unit)
        shader["pyramid"] = unit

    def read(self) -> list[Float32]:
        """Each level, (height, width) float32, first row at the top."""
        return [
            np.frombuffer(self.texture.read(level=level), np.float32).reshape(
                self.size_of(level)[::-1]
            )
            for level in range(self.levels)
        ]

    def release(self) -> None:
        self.texture.release()
