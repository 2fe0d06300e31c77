"""Min and max litmaps: how near and how far from the light the visible surface is, lexel by lexel.

Of the visible surface only what is seen from its lit side can receive a shadow; the rest is dark
as it is, and left out.

Décoret 2005, section 3.3, draws the scene from the light and throws away the fragments that the
observer does not see. That loses receivers: a visible sample that lies between two lexel centres
may be in none of the light's fragments. So the samples themselves are scattered into the map,
with atomic minimum and maximum, each over its whole footprint; then no visible sample is missing
from the lexels that it touches.

How wide a footprint. Whether a sample is in a volume, GL decides by comparing the sample's stored
depth with depths of the volume's faces at the sample. A face may err there by `DEPTH_STEPS` of
depth, by the snap of its vertices (which moves it on the screen by no more than they move, and so
by that many pixels at the sample's own depth), and by the float32 transforms of a vertex, of the
same moved along the light, and of the sample. A sample that any such face puts into a caster's
volume lies within the sum of these of the true volume, in any direction.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np

from visref.effects.light import Light
from visref.scene import Float32, Float64
from visref_culling.gl.device import Device, Target, set_uniform
from visref_culling.gl.view import DEPTH_STEPS, FLOAT32_UNIT, TRANSFORM_ROUNDINGS, View
from visref_culling.n_buffer.gpu import GROUP, NBufferTexture

# Transforms at the cost of `TRANSFORM_ROUNDINGS` of the farthest distance from the eye each: a
# vertex's; its distance along the light, its way from there and the sum of both; the sample's
# position, and that in the light's space.
TRANSFORMS = 6.0

NOTHING_NEARER = np.float32(np.inf)
NOTHING_FARTHER = np.float32(0.0)


class Litmaps:
    """The two litmaps of one light, and an N-buffer over each."""

    def __init__(self, device: Device, light: Light) -> None:
        self.device, self.light = device, light
        self.scatter_shader = self.load_scatter()
        width, height = light.camera.width, light.camera.height
        self.nearest = NBufferTexture(device, width, height, farthest=False)
        self.farthest = NBufferTexture(device, width, height, farthest=True)
        self.buffers = [device.context.buffer(reserve=4 * width * height) for _ in range(2)]

    def load_scatter(self) -> moderngl.ComputeShader:
        return self.device.compute("litmap.comp")

    def build(self, view: View, target: Target, reach: float) -> None:
        """Both maps and all their levels from the target's depth, which `view` drew, where its
        colour is 0: elsewhere the unlit side is seen. `reach`: the farthest that anything in the
        scene is from the eye."""
        self.clear()
        self.scatter(view, target, reach)
        base = self.device.compute("litmap_base.comp")
        for levels, buffer in zip((self.nearest, self.farthest), self.buffers, strict=True):
            buffer.bind_to_storage_buffer(1)
            levels.texture.bind_to_image(0, read=False, write=True)
            self._run(base, *levels.size)
            levels.join()

    # The steps.

    def clear(self) -> None:
        """No sample is in any lexel."""
        count = self.light.camera.samples
        for buffer, value in zip(self.buffers, (NOTHING_NEARER, NOTHING_FARTHER), strict=True):
            buffer.write(np.full(count, value, np.float32).tobytes())

    def doubt(self, view: View, reach: float) -> tuple[float, float, float]:
        """How far apart GL may put a sample and a face: world units in all, for each unit of
        the sample's depth, and for its square."""
        camera = view.camera
        a, b = float(np.abs(camera.column_a).max()), float(np.abs(camera.row_b).max())
        aside = a * np.linalg.norm(camera.right_step) + b * np.linalg.norm(camera.up_step)
        slant = math.hypot(1.0, float(aside))  # length of a ray for a unit of depth
        return (
            TRANSFORMS * TRANSFORM_ROUNDINGS * FLOAT32_UNIT * reach,
            view.window_error,
            # Window depth is 1 - near / depth, so a step of it is depth^2 / near.
            DEPTH_STEPS * FLOAT32_UNIT / camera.near * slant,
        )

    def scatter(self, view: View, target: Target, reach: float) -> None:
        """Write every sample seen from its lit side into the lexels under its footprint."""
        shader, camera, light = self.scatter_shader, view.camera, self.light.camera
        for binding, buffer in enumerate(self.buffers, start=1):
            buffer.bind_to_storage_buffer(binding)
        target.depth.use(0)
        shader["depth_buffer"] = 0
        colour = target.framebuffer.color_attachments[0]
        assert isinstance(colour, moderngl.Texture)
        # Without mipmaps a texture is complete with this filter alone.
        colour.filter = (moderngl.NEAREST, moderngl.NEAREST)
        colour.use(1)
        shader["unlit"] = 1
        for name, vector in (
            ("forward", camera.forward),
            ("right_step", camera.right_step),
            ("up_step", camera.up_step),
            ("shift_px", np.array([camera.shift_x_px, camera.shift_y_px])),
            ("doubt", np.array(self.doubt(view, reach))),
            ("lexels_per_unit", lexels_per_unit(self.light)),
            ("light_from_relative", light_from_relative(self.light, camera.eye).T),
        ):
            set_uniform(shader, name, vector.astype(np.float32).tobytes())
        shader["near"] = camera.near
        shader["light_near"] = light.near
        shader["lexels"] = light.width, light.height
        self._run(shader, camera.width, camera.height)

    def _run(self, shader: moderngl.ComputeShader, width: int, height: int) -> None:
        shader.run(-(-width // GROUP), -(-height // GROUP))
        self.device.context.memory_barrier()

    def read(self) -> tuple[Float32, Float32]:
        """(height, width) float32 each: nearest (inf) and farthest (0 where nothing is seen)."""
        return self.nearest.read()[0], self.farthest.read()[0]

    def release(self) -> None:
        self.nearest.release()
        self.farthest.release()
        for buffer in self.buffers:
            buffer.release()


def light_from_relative(light: Light, eye: Float64) -> Float64:
    """(4, 4) float64, of a position relative to an eye, (3,) float64 in the world: x and y in
    lexels (of a spot light, times the distance), the distance along the light, the divisor of x
    and y."""
    camera = light.camera
    axes = np.linalg.inv(camera.world_from_camera[:3, :3])
    local = np.concatenate([axes, (axes @ (eye - camera.eye))[:, None]], axis=1)
    distance, one = -local[2], np.array([0.0, 0.0, 0.0, 1.0])
    divisor = distance if camera.is_perspective else one
    step = camera.half_pixel
    # As Camera.pixel_of, half a pixel on: lexel k is k ... k + 1.
    x = 0.5 * local[0] / step + (0.5 * camera.width - camera.shift_x_px) * divisor
    y = -0.5 * local[1] / step + (0.5 * camera.height - camera.shift_y_px) * divisor
    return np.stack([x, y, distance, divisor])


def lexels_per_unit(light: Light) -> Float64:
    """(2,) float64, lexels that a unit of length has: (at any distance, or of a spot light at
    distance 1)."""
    lexels = 0.5 / light.camera.half_pixel
    return np.array([lexels, 0.0] if light.directional else [0.0, lexels])
