"""Culling wholly on the GPU: a compute shader tests all units and fills their draw commands.

A command has no triangles for what is not drawn; one indirect multi-draw a class of triangles
(`gl.geometry`: at most four) draws them. The number of GL calls does not hang on the number of
units. Which were drawn comes back once, at the end, for the record alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

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

GROUP = 64  # work items of a group, as in the shaders
SEEN = 3  # the binding of what a view has seen
# As in the shaders: of `seen`, and of `drawn`.
VISIBLE, LOOKED_UP = 1, 2
BEFORE, AFTER = 1, 2
BOUNDS_BYTES = 8 * 6  # a box of float64
VIEW_ROWS = 17  # of four float64, as `box_commands.glsl` has them
MOST_VIEWS = 2


class Decided(NamedTuple):
    """Units drawn before the test and after it, and which of the latter were looked up before;
    int64, ascending."""

    occluders: Int64
    others: Int64
    asked: Int64


class BoxCommands:
    """The units of a scene on the GPU, and which of them the last frame saw.

    `bounds`: (u, 2, 3) float64 world boxes; `can_occlude`: (u,) bool; `more`: blocks that
    only this shader has, by binding, (u, …) each. Raises InputError, with `fix`, for more units
    than a storage block holds.
    """

    def __init__(
        self,
        device: Device,
        geometry: Geometry,
        bounds: Float64,
        can_occlude: NDArray[np.bool_],
        *,
        fix: str,
        more: Mapping[int, NDArray[Any]] = MappingProxyType({}),
    ) -> None:
        self.device, self.geometry, self.units = device, geometry, len(bounds)
        self.shader = self.load()
        # What lies beyond a block's end is read as nothing: units would be lost without a word.
        largest = self.units * max(BOUNDS_BYTES, 4 * COMMAND_WORDS * len(geometry.classes))
        largest = max(largest, *(rows.nbytes for rows in more.values()), 0)
        if largest > device.max_block_bytes:
            raise InputError(
                f"{self.units:,} units are more than this OpenGL's storage blocks hold", fix=fix
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
        self.views = buffer(reserve=8 * 4 * VIEW_ROWS * MOST_VIEWS)
        # By binding; that of what a view has seen is `SEEN`.
        self.blocks = {
            1: self.bounds,
            2: buffer(can_occlude.astype(np.uint32).tobytes() or bytes(4)),
            4: self.drawn,
            5: buffer(np.ascontiguousarray(ranges).tobytes() or bytes(8)),
            6: self.commands,
            7: self.views,
            **{binding: buffer(rows.tobytes() or bytes(8)) for binding, rows in more.items()},
        }

    def load(self) -> moderngl.ComputeShader:
        raise NotImplementedError

    def move(self, bounds: Float64, units: Int64) -> None:
        """The units' boxes from now on, (u, 2, 3) float64; those of `units`, (k,) ids, have
        changed."""
        self.write(self.bounds, bounds, units)

    def write(self, buffer: moderngl.Buffer, rows: NDArray[Any], units: Int64) -> None:
        """Bring a block of a row per unit up to date; those of `units`, (k,) ids, have changed."""
        changed = np.zeros(self.units, np.bool_)
        changed[units] = True
        write_rows(buffer, changed, lambda first, end: rows[first:end])

    def seen_by(self, camera: Camera) -> moderngl.Buffer:
        """What the camera's view has seen in its last frame, a word per unit."""
        if camera.view not in self.seen_of_view:
            self.seen_of_view[camera.view] = self.device.context.buffer(self.nothing)
        return self.seen_of_view[camera.view]

    def look_from(self, views: Sequence[bytes]) -> None:
        """The cameras (`view_bytes`) that the shader looks from."""
        self.views.write(b"".join(views))

    def run(self, camera: Camera) -> None:
        """Let the shader, whose uniforms are set, decide and fill the commands."""
        for binding, buffer in self.blocks.items():
            buffer.bind_to_storage_buffer(binding)
        self.seen_by(camera).bind_to_storage_buffer(SEEN)
        self.shader["units"] = self.units
        self.shader.run(-(-self.units // GROUP))
        self.device.context.memory_barrier()

    def draw(self, view: View, target: Target, stats: QueryStats) -> None:
        self.geometry.draw_commands(view, target, self.commands, self.units, stats)

    def read(self, camera: Camera, stats: QueryStats) -> Decided:
        """What was drawn in this frame, and how many units were looked up."""
        self.device.context.memory_barrier()
        drawn = np.frombuffer(self.drawn.read(4 * self.units), np.uint32)
        self.geometry.tally(np.flatnonzero(drawn), stats)
        seen = np.frombuffer(self.seen_by(camera).read(4 * self.units), np.uint32)
        stats.bytes_read_back = (stats.bytes_read_back or 0) + 8 * self.units
        stats.batches = (stats.batches or 0) + 1
        asked, passed = seen & LOOKED_UP != 0, seen == (VISIBLE | LOOKED_UP)
        stats.queries = (stats.queries or 0) + int(asked.sum())
        stats.queries_passed = (stats.queries_passed or 0) + int(passed.sum())
        before, after = drawn == BEFORE, drawn == AFTER
        return Decided(*map(np.flatnonzero, (before, after, after & asked)))

    def release(self) -> None:
        for buffer in (*self.blocks.values(), *self.seen_of_view.values()):
            buffer.release()


def view_bytes(view: View, classes: int) -> bytes:
    """A camera's rows in the shaders' block `View`."""
    camera = view.camera
    rows = np.zeros((VIEW_ROWS, 4))
    rows[: len(view.planes)] = view.planes
    rows[7:11] = view.clip_from_relative
    rows[11, :3] = view.depth_row
    rows[12] = *camera.eye, np.abs(camera.eye).max()
    rows[13] = *growth(view), camera.near
    clip = camera.clip_from_camera(view.far)
    rows[14] = -clip[2, 2], clip[2, 3], view.depth_shift_ndc, float(camera.is_perspective)
    rows[15] = camera.width, camera.height, len(view.planes), classes
    rows[16, :3] = camera.forward
    return rows.tobytes()
