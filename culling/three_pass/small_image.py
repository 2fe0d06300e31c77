"""A smaller image for the first two passes, and how it stays safe.

A texel of the small image stands for `scale` x `scale` pixels of the window, counted from the
bottom left; its one sample lies in their middle. The published method draws the stand-ins there,
and sees neither a gap nor a tile that falls between the samples.

The conservative mode draws at full size, and gives each texel the *farthest* depth of its pixels.
Let an object own the sample of a pixel, at the point P of view depth d. The pixel's texel then
holds no depth nearer than d. The texel's sample is at most (scale - 1) / 2 pixels away in x and in
y, so the point P' that projects there at depth d is at most sqrt(1/2) * (scale - 1) pixels, taken
at depth d, from P. A box that contains P, grown on all sides by sqrt(1/2) texels at the depth of
its farthest corner or beyond, contains P'; drawn into the small image it covers that sample no
farther than d, and passes. No sample of a smaller viewport stands in for one of the window's.
"""

from __future__ import annotations

import math
from dataclasses import replace

import moderngl
import numpy as np

from visref.camera import Camera
from visref.culler import QueryStats
from visref.scene import Float64
from visref_culling.gl.device import Device, State, Target, set_uniform
from visref_culling.gl.view import FLOAT32_UNIT, View

# sqrt(1/2) of a texel where sqrt(1/2) * (1 - 1 / scale) is needed: the rest, at least a tenth of
# a pixel for any scale of 2 or more, is far more than the small camera's tan and atan round.
GROWTH_TEXELS = math.sqrt(0.5)

# Reading 24 bits of depth as a float rounds by half of 2**-24, adding and writing by as much
# again each, and storing by half a step: under 3 steps.
COPY_ERROR = 3.0 * FLOAT32_UNIT


def small_camera(camera: Camera, scale: int) -> Camera:
    """The camera of the image whose texels are `scale` x `scale` pixels of this one's, whole
    ones: the image may reach beyond the right and the top, and is never another aspect."""
    width, height = (-(-side // scale) for side in (camera.width, camera.height))
    taller = scale * height / camera.height
    yfov, ymag = camera.yfov, camera.ymag
    if yfov is not None:
        yfov = 2.0 * math.atan(taller * math.tan(yfov / 2.0))
    if ymag is not None:
        ymag *= taller
    # Columns count from the left as the image's do, rows from the bottom.
    shift_x = (scale * width - camera.width + 2.0 * camera.shift_x_px) / (2.0 * scale)
    shift_y = (camera.height - scale * height + 2.0 * camera.shift_y_px) / (2.0 * scale)
    return replace(
        camera,
        width=width,
        height=height,
        yfov=yfov,
        ymag=ymag,
        shift_x_px=shift_x,
        shift_y_px=shift_y,
    )


def grown(view: View, boxes: Float64) -> Float64:
    """Boxes (k, 2, 3) relative to the eye, larger by what the module's argument asks."""
    camera = view.camera
    texel = 2.0 * max(camera.half_pixel, float(np.linalg.norm(camera.up_step)))
    reach = np.linalg.norm(np.abs(boxes).max(axis=1), axis=1)
    growth = GROWTH_TEXELS * texel * (reach if camera.is_perspective else np.ones(len(boxes)))
    return boxes + np.array([[-1.0], [1.0]]) * growth[:, None, None]


class FarthestDepth:
    """Reduces a target's depth to a smaller one's."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.copy_error = COPY_ERROR
        self.program = device.program("rectangle.vert", "farthest.frag")
        self.vertex_array = device.context.vertex_array(
            self.program, [], mode=moderngl.TRIANGLE_STRIP
        )

    def reduce(self, whole: Target, small: Target, scale: int, stats: QueryStats) -> None:
        """Give each texel of `small`, which is cleared, its pixels' farthest depth."""
        set_uniform(self.program, "sides_ndc", np.array([-1, -1, 1, 1], np.float32).tobytes())
        set_uniform(self.program, "depth_ndc", np.float32(0.0).tobytes())
        set_uniform(self.program, "scale", np.int32(scale).tobytes())
        set_uniform(self.program, "copy_error", np.float32(self.copy_error).tobytes())
        set_uniform(self.program, "depth", np.int32(0).tobytes())
        changes = self.device.apply(State(small.framebuffer, self.program, colour_write=False))
        whole.depth.use(0)
        self.vertex_array.render(vertices=4)
        stats.state_changes = (stats.state_changes or 0) + changes
        stats.draw_calls = (stats.draw_calls or 0) + 1

    def release(self) -> None:
        self.vertex_array.release()
