"""Particles culled in the vertex shader, one lookup each, or four.

X. Décoret: N-Buffers for efficient depth map query. Computer Graphics Forum 24(3), 2005, sections
3.2 and 4.3.

The scene is drawn and an N-buffer built of its depth, no higher than a sprite's level. Each
sprite is one vertex. It knows its square of pixels. Where its side is a power of two, the
N-buffer's level whose squares have that size holds the farthest depth in it: one lookup and one
comparison say whether any of the sprite's samples can show. Where it is none, four squares of half
the next power cover it exactly, and four lookups say it. A geometry shader makes the square of
those that can.

Safe, since the lookup covers the samples that the square covers, no fewer: its sides lie on
borders between pixels, half a pixel from any sample, which no rounding bridges. The sprite's
depth is compared as it is stored, moved towards the eye by what both may err.

Departures from the paper:

- Sprites are squares made by a geometry shader, not point sprites: GL drops a wide point whole
  when its centre leaves the image, and so pops at the rim.
- A square of 16 pixels that lies anywhere touches samples of 17 columns in some places, and no
  level-4 square covers these. So squares are moved to the nearest pixel border, as GL's wide
  points once were; then 16 is 16, and one lookup is exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import moderngl
import numpy as np

from visref.camera import Camera
from visref.culler import RasterTolerance
from visref.effects.sprites import Sprites
from visref.errors import InputError
from visref.scene import Int32, Int64, Scene
from visref_culling.gl.device import Device, State, Target, device
from visref_culling.gl.geometry import view_uniforms
from visref_culling.gl.sums import Sums
from visref_culling.gl.view import View
from visref_culling.n_buffer.cover import FOUR, ONE, ceil_log2
from visref_culling.n_buffer.gpu import NBufferTexture

DRAWN, IN_IMAGE = 1, 2  # as in the shader


@dataclass(frozen=True, eq=False)
class ParticleFrame:
    """`layers`: (height, width) int32, sprites that show at each sample; `kept`: (k,) int64, the
    sprites drawn, ascending; `in_image`: how many have a pixel there; `lookups`: counted where the
    shader makes them; `fragments`: of the drawn sprites, hidden ones included, each a depth test;
    None where not counted."""

    layers: Int32
    kept: Int64
    in_image: int
    lookups: int
    fragments: int | None


class Particles:
    """Draws sprites in a solid scene (`visref.effects.solid`).

    `squares`: by how many a sprite's is covered, 1 or 4; by default as few as cover it exactly.
    """

    def __init__(self, scene: Scene, sprites: Sprites, *, squares: int | None = None) -> None:
        if squares is None:
            squares = FOUR if sprites.side_px & (sprites.side_px - 1) else ONE
        self.squares = squares
        self.device: Device = device()
        self.scene, self.sprites = scene, sprites
        self.sums = Sums(self.device, scene)
        context, count = self.device.context, len(sprites.centres)
        self.program = self.load_program()
        self.centres = context.buffer(sprites.centres.tobytes() or bytes(12))
        self.record = context.buffer(reserve=max(4, 4 * count))
        self.lookups = context.buffer(reserve=4)
        self.vertex_array = context.vertex_array(
            self.program, [(self.centres, "3f", "centre_world")], mode=moderngl.POINTS
        )
        self.levels: NBufferTexture | None = None

    def frame(
        self, camera: Camera, *, culled: bool = True, fragments: bool = False
    ) -> ParticleFrame:
        """The sprites that a camera sees. Without `culled` all are drawn; `fragments` counts
        their depth tests, beside the frame. Raises InputError for an endless orthographic view,
        whose depth buffer ends behind the scene and not behind the sprites."""
        if not camera.is_perspective and math.isinf(camera.far):
            raise InputError("an orthographic view of sprites has no end", fix="give it a far")
        view = View.of(camera, self.scene, self.device.subpixel_bits)
        target = self.sums.begin(view)
        self.build(target)
        self._draw(view, self.sums.adding(target, self.program), culled=culled)
        layers = self.sums.read(target)
        self.device.context.memory_barrier()
        (lookups,) = np.frombuffer(self.lookups.read(), np.uint32).tolist()
        counted = None
        if fragments:
            counted = self.sums.fragments(
                target, self.program, lambda state: self._draw(view, state, culled=culled)
            )
        self.device.context.memory_barrier()
        record = np.frombuffer(self.record.read(), np.uint32)[: len(self.sprites.centres)]
        in_image = int(np.count_nonzero(record & IN_IMAGE))
        kept = np.flatnonzero(record & DRAWN)
        return ParticleFrame(layers, kept, in_image, lookups, counted)

    def draw_alone(self, camera: Camera, *, culled: bool = True) -> None:
        """All of a frame that is drawn, and nothing read back or counted: for timing."""
        view = View.of(camera, self.scene, self.device.subpixel_bits)
        target = self.sums.begin(view)
        if culled:
            self.build(target)
        self._draw(view, self.sums.adding(target, self.program), culled=culled)

    def tolerance(self, camera: Camera) -> RasterTolerance:
        """What this rasteriser declares for a camera."""
        view = View.of(camera, self.scene, self.device.subpixel_bits)
        return self.sums.tolerance(view)

    # The steps.

    def load_program(self) -> moderngl.Program:
        return self.device.program("particle.vert", "plain.frag", "particle.geom")

    def make_levels(self, width: int, height: int) -> NBufferTexture:
        return NBufferTexture(self.device, width, height)

    def build(self, target: Target) -> None:
        """The N-buffer of the target's depth, up to the sprites' level."""
        size = target.framebuffer.size
        if self.levels is None or self.levels.size != size:
            if self.levels is not None:
                self.levels.release()
            self.levels = self.make_levels(*size)
        self.levels.build(target, levels=self.top_level())

    def top_level(self) -> int:
        """The highest level that is looked up: four squares have half the side of one."""
        top = int(ceil_log2(np.array([self.sprites.side_px]))[0])
        return max(top - 1, 0) if self.squares == FOUR else top

    def depth_shift(self, view: View) -> float:
        """By how much a sprite is taken nearer to the eye, in window depth."""
        return 0.5 * view.depth_shift_ndc

    # The rest.

    def _draw(self, view: View, state: State, *, culled: bool) -> None:
        program, camera = self.program, view.camera
        view_uniforms(program, view)
        assert self.levels is not None
        self.levels.use(program)
        program["image_px"] = camera.width, camera.height
        program["side_px"] = self.sprites.side_px
        program["depth_shift"] = self.depth_shift(view)
        program["culled"] = culled
        program["four_squares"] = self.squares == FOUR
        self.lookups.write(bytes(4))
        self.record.bind_to_storage_buffer(2)
        self.lookups.bind_to_storage_buffer(3)
        self.device.apply(state)
        self.vertex_array.render(vertices=len(self.sprites.centres))

    def close(self) -> None:
        if self.levels is not None:
            self.levels.release()
        for part in (self.vertex_array, self.centres, self.record, self.lookups, self.sums):
            part.release()
