"""Geometry for units that share triangles: each triangle is drawn once a frame.

A unit's triangles are no fixed range here, since those that an earlier unit of the frame has
drawn fall out; so the indices of what is left go to the GPU with every draw.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.culler import QueryStats
from visref.scene import Int32, Int64, Scene, Units
from visref_culling.gl.device import Device, State, Target
from visref_culling.gl.geometry import Geometry, view_uniforms
from visref_culling.gl.view import View

NOTHING = Units(np.zeros(1, np.int64), np.zeros(0, np.int32))


class Marks:
    """Which triangles a frame has counted already; a new frame clears none of a million."""

    def __init__(self, triangle_count: int) -> None:
        self.frame_of_triangle = np.zeros(triangle_count, np.int32)
        self.frame = 0

    def begin(self) -> None:
        self.frame += 1

    def fresh(self, units: Units, ids: Int64) -> Int32:
        """The triangles of units `ids`, (k,), that this frame has not counted: (n,) int32, now
        counted."""
        result = np.empty(int(units.sizes[ids].sum()), np.int32)
        count = _fresh(
            units.offsets, units.triangles, ids, self.frame_of_triangle, self.frame, result
        )
        return result[:count]


class SharedGeometry(Geometry):
    """Draws units of which a triangle may belong to several."""

    def __init__(
        self, device: Device, scene: Scene, units: Units, occludes: NDArray[np.bool_]
    ) -> None:
        super().__init__(device, scene, NOTHING, occludes)
        self.units, self.triangles = units, scene.triangles
        # As in the base class: those that write depth first.
        self.class_of_triangle = 2 * ~occludes + scene.one_sided
        self.indices = device.context.buffer(reserve=12, dynamic=True)
        self.vertex_array = device.context.vertex_array(
            self.program, [(self.vertices, "3f", "vertex_world")], index_buffer=self.indices
        )
        self.marks = Marks(scene.triangle_count)

    def begin(self) -> None:
        """A new frame: nothing is drawn yet."""
        self.marks.begin()

    def fresh(self, unit_ids: Int64) -> Int32:
        """(n,) int32: the triangles of units, (k,) ids, that this frame has not drawn; they count
        as drawn now."""
        return self.marks.fresh(self.units, unit_ids)

    def draw(self, view: View, target: Target, unit_ids: Int64, stats: QueryStats) -> None:
        """Draw what the units, (k,) ids, add to the frame, and count what that took."""
        state = State(target.framebuffer, self.program)
        self.draw_triangles(view, state, self.fresh(unit_ids), stats)
        stats.units_drawn = (stats.units_drawn or 0) + len(unit_ids)

    def draw_triangles(self, view: View, base: State, triangles: Int32, stats: QueryStats) -> None:
        """Draw triangles, (n,) ids, whatever was drawn before."""
        view_uniforms(self.program, view)
        calls = changes = 0
        class_of = self.class_of_triangle[triangles]
        for number in range(4):
            chosen = triangles[class_of == number]
            if not len(chosen):
                continue
            rows = self.triangles[chosen]
            self.indices.orphan(max(self.indices.size, rows.nbytes))
            self.indices.write(rows.tobytes())
            changes += self.device.apply(
                base._replace(
                    depth_write=base.depth_write and number < 2,
                    cull_back_faces=number % 2 == 1,
                    cut=view.is_cut,
                )
            )
            self.vertex_array.render(vertices=rows.size)
            calls += 1
        stats.triangles_drawn = (stats.triangles_drawn or 0) + len(triangles)
        stats.draw_calls = (stats.draw_calls or 0) + calls
        stats.state_changes = (stats.state_changes or 0) + changes

    def fragments(self, view: View, target: Target, unit_ids: Int64) -> int:
        """How many fragments the triangles of units, (k,) ids, have, each counted once. Beside
        a frame, not in it."""
        marks = Marks(len(self.triangles))
        marks.begin()
        state = State(target.scratch, self.program, depth_func="", depth_write=False)
        query = self.device.queries(1)[0]
        with query:
            self.draw_triangles(view, state, marks.fresh(self.units, unit_ids), QueryStats())
        return int(query.samples)

    def release(self) -> None:
        self.vertex_array.release()
        self.indices.release()
        super().release()


@njit()
def _fresh(
    offsets: NDArray[Any],
    triangles: NDArray[Any],
    units: NDArray[Any],
    frame_of_triangle: NDArray[Any],
    frame: int,
    result: NDArray[Any],
) -> int:
    count = 0
    for unit in units:
        for k in range(offsets[unit], offsets[unit + 1]):
            triangle = triangles[k]
            if frame_of_triangle[triangle] != frame:
                frame_of_triangle[triangle] = frame
                result[count] = triangle
                count += 1
    return count
