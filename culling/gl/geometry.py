"""A scene's triangles on the GPU, drawn by units with one indirect multi-draw each time.

Triangles fall into at most four classes, by whether they write depth (opaque ones do) and
whether a back face covers nothing. A unit's triangles of a class lie together in that class's
index buffer, so a list of units is a list of ranges. Triangles that do not occlude are drawn
after those that do, with depth writes off. Of them, masked ones then write depth, and depth
alone, where their masks are certainly solid (`visref_culling.gl.solid_masks`). On the generated
scene `leaves` the baseline of single queries so draws 7,081 triangles instead of 12,722.
`draw_commands`, whose list of units only the GPU has, and `SharedGeometry` do without.
"""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.culler import QueryStats
from visref.scene import Alpha, Int32, Int64, Scene, Units
from visref_culling.gl.changes import Changes, write_indices, write_vertices
from visref_culling.gl.device import Device, State, Target, set_uniform
from visref_culling.gl.masks import certainly_solid, with_known_mask
from visref_culling.gl.solid_masks import SolidMasks
from visref_culling.gl.view import View

NO_PLANE = np.array([0.0, 0.0, 0.0, 1.0])

COMMAND_WORDS = 5  # count, instances, first index, base vertex, base instance


def occluders(scene: Scene) -> NDArray[np.bool_]:
    """(t,) bool: what hides all that lies behind it. Opaque triangles, and masked ones that are
    solid wherever they are looked up; another masked one might hide nothing."""
    result: NDArray[np.bool_] = scene.alpha == Alpha.OPAQUE
    return result | certainly_solid(scene)


@dataclass(eq=False)
class TriangleClass:
    """Index buffer of one class. `first`, `count`: (u,) int64 ranges of each unit, in indices;
    `triangles`: (n,) int32, those in the buffer, in its order."""

    writes_depth: bool
    one_sided: bool
    indices: moderngl.Buffer
    vertex_array: moderngl.VertexArray
    first: Int64
    count: Int64
    triangles: Int32


class Geometry:
    """Uploads a scene by units. `occludes`: (t,) bool, the triangles that write depth."""

    def __init__(
        self, device: Device, scene: Scene, units: Units, occludes: NDArray[np.bool_]
    ) -> None:
        self.device = device
        self.units = units
        self.program = device.program("mesh.vert", "plain.frag")
        self.vertices = device.context.buffer(scene.vertices.tobytes() or bytes(12))
        self.commands = device.context.buffer(reserve=4 * COMMAND_WORDS, dynamic=True)
        self.classes: list[TriangleClass] = []
        writes, sided = occludes[units.triangles], scene.one_sided[units.triangles]
        for writes_depth in (True, False):
            for one_sided in (False, True):
                chosen = (writes == writes_depth) & (sided == one_sided)
                if chosen.any():
                    self.classes.append(self._upload(scene, chosen, writes_depth, one_sided))
        by_mask = with_known_mask(scene) & ~occludes
        # (t,) bool, the triangles that write depth somewhere.
        self.hides = occludes | by_mask
        self.solid_masks: SolidMasks | None = None
        if by_mask[units.triangles].any():
            self.solid_masks = SolidMasks(device, scene, units, by_mask)

    def _upload(
        self, scene: Scene, chosen: NDArray[np.bool_], writes_depth: bool, one_sided: bool
    ) -> TriangleClass:
        context = self.device.context
        before = np.concatenate([[0], np.cumsum(chosen)])[self.units.offsets]
        triangles = self.units.triangles[chosen]
        indices = context.buffer(scene.triangles[triangles].tobytes())
        vertex_array = context.vertex_array(
            self.program, [(self.vertices, "3f", "vertex_world")], index_buffer=indices
        )
        return TriangleClass(
            writes_depth,
            one_sided,
            indices,
            vertex_array,
            3 * before[:-1],
            3 * np.diff(before),
            triangles,
        )

    def update(self, scene: Scene, changes: Changes) -> None:
        """Follow the scene to another moment, in which this has changed."""
        write_vertices(self.vertices, scene, changes)
        for part in self.classes:
            write_indices(part.indices, scene, changes, part.triangles)
        if self.solid_masks is not None:
            self.solid_masks.update(scene, changes)

    def draw(self, view: View, target: Target, unit_ids: Int64, stats: QueryStats) -> None:
        """Draw units, (k,) ids, into the target's image and depth, and count what that took."""
        self._draw(view, State(target.framebuffer, self.program), unit_ids, stats)

    def draw_commands(
        self, view: View, target: Target, commands: moderngl.Buffer, slots: int, stats: QueryStats
    ) -> None:
        """Draw what commands on the GPU say: `slots` of each class, class after class."""
        view_uniforms(self.program, view)
        for place, part in enumerate(self.classes):
            state = State(
                target.framebuffer, self.program, depth_write=part.writes_depth, cut=view.is_cut
            )
            changes = self.device.apply(state._replace(cull_back_faces=part.one_sided))
            part.vertex_array.render_indirect(commands, count=slots, first=place * slots)
            stats.state_changes = (stats.state_changes or 0) + changes
            stats.draw_calls = (stats.draw_calls or 0) + 1

    def tally(self, unit_ids: Int64, stats: QueryStats) -> None:
        """Count units, (k,) ids, that commands on the GPU drew."""
        triangles = sum(int(part.count[unit_ids].sum()) for part in self.classes) // 3
        stats.triangles_drawn = (stats.triangles_drawn or 0) + triangles
        stats.units_drawn = (stats.units_drawn or 0) + len(unit_ids)

    def draw_depth(self, view: View, target: Target, unit_ids: Int64, stats: QueryStats) -> None:
        """Draw what the units, (k,) ids, hide others with into the target's depth alone. It is no
        part of the final image, so only calls and state changes are counted."""
        state = State(target.framebuffer, self.program, colour_write=False)
        drawn = QueryStats()
        self._draw(view, state, unit_ids, drawn, depth_only=True)
        stats.draw_calls = (stats.draw_calls or 0) + (drawn.draw_calls or 0)
        stats.state_changes = (stats.state_changes or 0) + (drawn.state_changes or 0)

    def fragments(self, view: View, target: Target, unit_ids: Int64) -> int:
        """How many fragments these units, (k,) ids, have in the view, hidden ones included. It
        draws with no depth test: for counting, beside a frame and not in it."""
        return self._fragments(view, target, unit_ids, depth_only=False)

    def depth_fragments(self, view: View, target: Target, unit_ids: Int64) -> int:
        """The same of `draw_depth`: how many fragments the units, (k,) ids, have there."""
        return self._fragments(view, target, unit_ids, depth_only=True)

    def _fragments(self, view: View, target: Target, unit_ids: Int64, *, depth_only: bool) -> int:
        state = State(target.scratch, self.program, depth_func="", depth_write=False)
        query = self.device.queries(1)[0]
        with query:
            self._draw(view, state, unit_ids, QueryStats(), depth_only=depth_only)
        return int(query.samples)

    def _draw(
        self,
        view: View,
        base: State,
        unit_ids: Int64,
        stats: QueryStats,
        *,
        depth_only: bool = False,
    ) -> None:
        view_uniforms(self.program, view)
        triangles = changes = calls = 0
        for part in self.classes:
            if depth_only and not part.writes_depth:
                continue
            ids = unit_ids[part.count[unit_ids] > 0]
            if not len(ids):
                continue
            changes += self.device.apply(
                base._replace(
                    depth_write=base.depth_write and part.writes_depth,
                    cull_back_faces=part.one_sided,
                    cut=view.is_cut,
                )
            )
            self._draw_ranges(part.vertex_array, part.first[ids], part.count[ids])
            triangles += int(part.count[ids].sum()) // 3
            calls += 1
        masks = self.solid_masks
        if masks is not None and base.depth_write:
            # The triangles have been counted, where they are drawn.
            ids = unit_ids[masks.count[unit_ids] > 0]
            if len(ids):
                view_uniforms(masks.program, view)
                changes += masks.ready(view, base._replace(cut=view.is_cut))
                self._draw_ranges(masks.vertex_array, masks.first[ids], masks.count[ids])
                calls += 1
        stats.triangles_drawn = (stats.triangles_drawn or 0) + triangles
        stats.units_drawn = (stats.units_drawn or 0) + len(unit_ids)
        stats.draw_calls = (stats.draw_calls or 0) + calls
        stats.state_changes = (stats.state_changes or 0) + changes

    def _draw_ranges(self, vertex_array: moderngl.VertexArray, first: Int64, count: Int64) -> None:
        if len(first) == 1:
            vertex_array.render(vertices=int(count[0]), first=int(first[0]))
            return
        commands = np.zeros((len(first), COMMAND_WORDS), np.uint32)
        commands[:, 0], commands[:, 1], commands[:, 2] = count, 1, first
        if commands.nbytes > self.commands.size:
            self.commands.orphan(2 * commands.nbytes)
        else:
            self.commands.orphan()
        self.commands.write(commands.tobytes())
        vertex_array.render_indirect(self.commands, count=len(first))

    def release(self) -> None:
        if self.solid_masks is not None:
            self.solid_masks.release()
        for part in self.classes:
            part.vertex_array.release()
            part.indices.release()
        self.vertices.release()
        self.commands.release()


def view_uniforms(program: moderngl.Program, view: View) -> None:
    """Set what `mesh.vert` and its like need to know of the view."""
    if program.get("clip_plane", None) is not None:
        # Without one, everything is in front. llvmpipe (Mesa 22.3) went on to cut by a plane that
        # an earlier view left in the program, though the cutting was switched off.
        plane = NO_PLANE if view.clip_plane is None else view.clip_plane
        set_uniform(program, "clip_plane", plane.astype(np.float32).tobytes())
    set_uniform(program, "eye_high", view.eye_high.tobytes())
    set_uniform(program, "eye_low", view.eye_low.tobytes())
    set_uniform(program, "clip_from_relative", view.clip_from_relative_bytes)
