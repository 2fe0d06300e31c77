"""N-buffer culling wholly on the GPU: it tests every box and writes the draw commands itself.

A compute shader decides about all units at once and fills a command for each, with no triangles
for what is not drawn; one indirect multi-draw a class of triangles (`gl.geometry`: at most
four) draws them. The number of GL calls hangs on the image's size, through the levels, and not on
the number of units. Which units were drawn comes back once, at the end, for the record alone.
"""

from __future__ import annotations

from typing import NamedTuple

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import QueryStats
from visref.errors import InputError
from visref.scene import Float64, Int64
from visref_culling.boxes.conservative import growth
from visref_culling.gl.changes import write_rows
from visref_culling.gl.device import Device, Target
from visref_culling.gl.geometry import COMMAND_WORDS, Geometry
from visref_culling.gl.view import View
from visref_culling.n_buffer.cover import ONE
from visref_culling.n_buffer.gpu import NBufferTexture

GROUP = 64  # work items of a group, as in the shader
SHADER = "n_buffer_cull.comp"
SEEN = 3  # its binding
# As in the shader: of `seen`, and of `drawn`.
VISIBLE, LOOKED_UP = 1, 2
BEFORE, AFTER = 1, 2
BOUNDS_BYTES = 8 * 6  # a box of float64


class Decided(NamedTuple):
    """Units drawn before the test and after it, and which of the latter were looked up before;
    int64, ascending."""

    occluders: Int64
    others: Int64
    asked: Int64


class GpuCull:
    """The units of a scene on the GPU, and which of them the last frame saw.

    `bounds`: (u, 2, 3) float64 world boxes; `can_occlude`: (u,) bool. Raises InputError for more
    units than a storage block holds.
    """

    texture: type[NBufferTexture] = NBufferTexture

    def __init__(
        self,
        device: Device,
        geometry: Geometry,
        bounds: Float64,
        can_occlude: NDArray[np.bool_],
        squares: int,
    ) -> None:
        self.device, self.geometry, self.units = device, geometry, len(bounds)
        self.squares = squares
        self.shader = self.load()
        # What lies beyond a block's end is read as nothing: units would be lost without a word.
        largest = self.units * max(BOUNDS_BYTES, 4 * COMMAND_WORDS * len(geometry.classes))
        if largest > device.max_block_bytes:
            raise InputError(
                f"{self.units:,} units are more than this OpenGL's storage blocks hold",
                fix="use where=cpu",
            )
        buffer = device.context.buffer
        nothing = bytes(4 * max(1, self.units))
        ranges = np.array(
            [[part.first, part.count] for part in geometry.classes], np.uint32
        ).transpose(0, 2, 1) if geometry.classes else np.zeros(0, np.uint32)  # fmt: skip
        slots = max(1, len(geometry.classes) * self.units)
        self.nothing = nothing
        self.seen_of_view: dict[str, moderngl.Buffer] = {}
        self.bounds, self.drawn = buffer(bounds.tobytes() or bytes(8)), buffer(nothing)
        self.commands = buffer(reserve=4 * COMMAND_WORDS * slots)
        self.view = buffer(reserve=8 * 4 * 16)
        # By binding; that of what a view has seen is `SEEN`.
        self.blocks = {
            1: self.bounds,
            2: buffer(can_occlude.astype(np.uint32).tobytes() or bytes(4)),
            4: self.drawn,
            5: buffer(np.ascontiguousarray(ranges).tobytes() or bytes(8)),
            6: self.commands,
            7: self.view,
        }
        self.map: NBufferTexture | None = None

    def load(self) -> moderngl.ComputeShader:
        return self.device.compute(SHADER)

    def move(self, bounds: Float64, units: Int64) -> None:
        """The units' boxes from now on, (u, 2, 3) float64; those of `units`, (k,) ids, have
        changed."""
        changed = np.zeros(self.units, np.bool_)
        changed[units] = True
        write_rows(self.bounds, changed, lambda first, end: bounds[first:end])

    def seen_by(self, camera: Camera) -> moderngl.Buffer:
        """What the camera's view has seen in its last frame, a word per unit."""
        if camera.view not in self.seen_of_view:
            self.seen_of_view[camera.view] = self.device.context.buffer(self.nothing)
        return self.seen_of_view[camera.view]

    def frame(self, view: View, target: Target, stats: QueryStats) -> Decided:
        """Draw what may be visible."""
        if not self.units:
            return Decided(*np.zeros((3, 0), np.int64))
        levels, of_view = self.map_of(target), self.seen_by(view.camera)
        self.view.write(_view_bytes(view, len(self.geometry.classes)))
        for occluders in (True, False):
            if not occluders:
                levels.build(target)
            for binding, buffer in self.blocks.items():
                buffer.bind_to_storage_buffer(binding)
            of_view.bind_to_storage_buffer(SEEN)
            levels.use(self.shader)
            self.shader["occluders"] = occluders
            self.shader["units"] = self.units
            if not occluders:
                self.shader["one_square"] = self.squares == ONE
            self.shader.run(-(-self.units // GROUP))
            self.device.context.memory_barrier()
            self.geometry.draw_commands(view, target, self.commands, self.units, stats)
        self.device.context.memory_barrier()
        drawn = np.frombuffer(self.drawn.read(4 * self.units), np.uint32)
        self.geometry.tally(np.flatnonzero(drawn), stats)
        seen = np.frombuffer(of_view.read(4 * self.units), np.uint32)
        stats.bytes_read_back = (stats.bytes_read_back or 0) + 8 * self.units
        stats.batches = (stats.batches or 0) + 1
        asked, passed = seen & LOOKED_UP != 0, seen == (VISIBLE | LOOKED_UP)
        stats.queries = (stats.queries or 0) + int(asked.sum())
        stats.queries_passed = (stats.queries_passed or 0) + int(passed.sum())
        stats.lookups = (stats.lookups or 0) + int(asked.sum()) * self.squares
        before, after = drawn == BEFORE, drawn == AFTER
        return Decided(*map(np.flatnonzero, (before, after, after & asked)))

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
        for buffer in (*self.blocks.values(), *self.seen_of_view.values()):
            buffer.release()


def _view_bytes(view: View, classes: int) -> bytes:
    """What the shader's block `View` holds, 16 rows of four float64."""
    camera = view.camera
    rows = np.zeros((16, 4))
    rows[: len(view.planes)] = view.planes
    rows[7:11] = view.clip_from_relative
    rows[11, :3] = view.depth_row
    rows[12] = *camera.eye, np.abs(camera.eye).max()
    rows[13] = *growth(view), camera.near
    clip = camera.clip_from_camera(view.far)
    rows[14] = -clip[2, 2], clip[2, 3], view.depth_shift_ndc, float(camera.is_perspective)
    rows[15] = camera.width, camera.height, len(view.planes), classes
    return rows.tobytes()
