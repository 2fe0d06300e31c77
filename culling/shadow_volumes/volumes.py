"""Shadow volumes, and their culling and clamping by N-buffers.

X. Décoret: N-Buffers for efficient depth map query. Computer Graphics Forum 24(3), 2005, section
3.3.

The scene is drawn for the observer. What is seen from the lit side is put into two maps over the
light, of its nearest and farthest distance from the light, lexel by lexel; an N-buffer over each
gives the extremes in any rectangle. A caster whose rectangle over the light holds nothing lit that
is seen casts no visible shadow: it is culled. The others' volumes are clamped between two planes
across the light, at the least and the greatest distance found. The volumes are then counted behind
the visible surface ("z-fail": the eye may be in a volume, and no near plane cuts a cap open), and a
sample is in shadow where the count is above 0, or where its unlit side is seen.

Which way it errs. Maps hold every visible lit sample over its whole footprint
(`shadow_volumes.litmaps`) and rectangles are whole lexels, rounded outward: so the planes enclose
all of these samples that the full volume shadows, by more than GL may err. A map too coarse, or a
box too wide, only clamps less. The sides of a clamped volume are other polygons than those of the
full one, so a sample within GL's snap of a shadow's edge may fall to either side.

Departures from the paper:

- Counts are sums in a float image, not a stencil of eight bits: they do not wrap at 256.
- Samples are scattered into the litmaps, not the light's own fragments (see there).
- The light cap moves only where the whole caster is nearer to the light than the plane. The paper
  moves vertex by vertex; where the plane cuts a triangle, the moved corner takes the cap behind
  the triangle, and what is seen between the two loses its shadow.
- A caster is culled too where all that is seen is nearer to the light than the caster.
- Silhouettes are those of triangle soup, and of solids where the soup has any
  (`shadow_volumes.casters`).
- What is seen from the side that the light does not meet is dark without any volume, and takes
  part in no litmap. The paper puts all that is seen into its litmaps; the light cannot see those
  samples either, but its slanted lexels let many in.
- A light cap is drawn as the scene's own triangle, corner for corner, so it has the very depth
  that the visible surface has, and counts as behind it (`>=`): no bias is needed, and a surface
  that the light meets from the eye's side is not in its own shadow.
- The view has no far plane, and it is a perspective one.
- The lookups, the extents and the draw commands are made on the GPU; nothing is read back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import RasterTolerance
from visref.effects.light import Light
from visref.errors import InputError
from visref.scene import Float32, Int32, Int64, Scene
from visref_culling.gl.device import Device, State, Target, device, set_uniform
from visref_culling.gl.geometry import COMMAND_WORDS, view_uniforms
from visref_culling.gl.sums import Sums
from visref_culling.gl.view import View
from visref_culling.shadow_volumes.casters import Casters, Faces, casters_of
from visref_culling.shadow_volumes.litmaps import Litmaps, light_from_relative

GROUP = 64  # work items of a group, as in the shader

# Float64 bounds of a caster over the light, in lexels up to the map's side, are off by some 20
# roundings; a lexel that is touched by less is a lexel too many. Outward.
LEXEL_SLACK = 2.0**-30


@dataclass(frozen=True, eq=False)
class ShadowFrame:
    """One camera's shadows.

    `count`: (height, width) int32, casting triangles between a lit sample and the light, 0 where
    nothing is seen; `unlit`: (height, width) bool, samples seen from the side that the light does
    not meet. `planes`: (n, 2) float32, each caster's light and dark plane, ±inf where it is not
    clamped; `kept`: (k,) int64 casters not culled. `fragments`: of all volumes drawn, hidden ones
    included; None where not counted. What is unlit is told by shading, and no fragment of these.
    """

    count: Int32
    unlit: NDArray[np.bool_]
    planes: Float32
    kept: Int64
    fragments: int | None

    @property
    def image(self) -> Int32:
        """(height, width) int32: 1 where a seen sample is in shadow, else 0."""
        return ((self.count > 0) | self.unlit).astype(np.int32)


class ShadowVolumes:
    """Shadows of a solid scene (`visref.effects.solid`) by one light."""

    def __init__(self, scene: Scene, light: Light) -> None:
        self.device: Device = device()
        self.scene, self.light = scene, light
        self.sums = Sums(self.device, scene)
        self.casters: Casters = casters_of(scene, light)
        self.litmaps = self.make_litmaps()
        self.extents_shader = self.load_extents()
        self.program = self.load_program()
        self.unlit_program = self.device.program("mesh.vert", "unlit.frag")
        self._upload()

    def frame(
        self, camera: Camera, *, clamped: bool = True, fragments: bool = False
    ) -> ShadowFrame:
        """The shadows that a camera sees; without `clamped` every volume is drawn in full, to
        infinity. `fragments` counts them, beside the frame."""
        view = self.view_of(camera)
        target = self.begin(view, camera, clamped=clamped)
        unlit = self.sums.read(target) > 0
        self.device.clear_colour(target.framebuffer)
        self.draw_volumes(view, self.sums.adding(target, self.program))
        # The background receives no shadow.
        count = np.where(target.read_depth() < 1.0, self.read(target), 0).astype(np.int32)
        counted = None
        if fragments:
            counted = self.sums.fragments(
                target, self.program, lambda state: self.draw_volumes(view, state)
            )
        return ShadowFrame(count, unlit, *self._read_extents(), counted)

    def fragments_of(self, camera: Camera, casters: Int64, *, clamped: bool = True) -> int:
        """The fragments of some casters' volumes alone, (k,) ids, hidden ones included."""
        view = self.view_of(camera)
        target = self.begin(view, camera, clamped=clamped)
        words = np.frombuffer(self.commands.read(), np.uint32)
        chosen = words[: COMMAND_WORDS * len(self.vertex_arrays) * self.casters.count].copy()
        chosen = chosen.reshape(len(self.vertex_arrays), self.casters.count, COMMAND_WORDS)
        others = np.ones(self.casters.count, np.bool_)
        others[casters] = False
        chosen[:, others, 1] = 0
        self.commands.write(chosen.tobytes() or bytes(4))
        return self.sums.fragments(
            target, self.program, lambda state: self.draw_volumes(view, state)
        )

    def tolerance(self, camera: Camera) -> RasterTolerance:
        """What this rasteriser declares for a camera."""
        return self.sums.tolerance(self.view_of(camera))

    # The steps.

    def begin(self, view: View, camera: Camera, *, clamped: bool) -> Target:
        """The scene's depth, its unlit samples marked, and what is to be drawn."""
        target = self.sums.begin(view)
        self.mark_unlit(view, target)
        if clamped:
            self.litmaps.build(view, target, self._reach(camera))
            self._clamp()
        else:
            self._keep_all()
        return target

    def view_of(self, camera: Camera) -> View:
        if not camera.is_perspective:
            raise InputError("shadow volumes of an orthographic camera", fix="give one with yfov")
        return View.of(endless(camera), self.scene, self.device.subpixel_bits)

    def make_litmaps(self) -> Litmaps:
        return Litmaps(self.device, self.light)

    def load_extents(self) -> moderngl.ComputeShader:
        return self.device.compute("volume_extents.comp")

    def load_program(self) -> moderngl.Program:
        return self.device.program("volume.vert", "volume.frag")

    def rectangles(self) -> Int32:
        """(n, 4) int32, the lexels x0, y0, x1, y1 (inclusive) that each caster may touch, clipped
        to the map; x1 < x0 where there are none."""
        size = np.array([self.light.camera.width, self.light.camera.height])
        low = np.floor(np.clip(self.casters.rectangle[:, :2] - LEXEL_SLACK, 0.0, size))
        high = np.floor(np.clip(self.casters.rectangle[:, 2:] + LEXEL_SLACK, -1.0, size - 0.5))
        result = np.concatenate([low, high], axis=1)
        # A caster without triangles touches nothing.
        return np.where(np.isnan(result), [0, 0, -1, -1], result).astype(np.int32)

    def ranges(self) -> Float32:
        """(n, 2) float32, the distances along the light between which each caster lies."""
        near, far = self.casters.nearest, self.casters.farthest
        # Outward: nearer and farther than any of its vertices.
        result = np.stack(
            [
                np.nextafter(near.astype(np.float32), np.float32(-np.inf)),
                np.nextafter(far.astype(np.float32), np.float32(np.inf)),
            ],
            axis=1,
        )
        return np.where(np.isnan(result), np.float32(-np.inf), result)

    def mark_unlit(self, view: View, target: Target) -> None:
        """Add 1 to each sample that is seen from the side which the light does not meet."""
        view_uniforms(self.unlit_program, view)
        state = self.sums.adding(target, self.unlit_program)._replace(depth_func="==")
        for vertex_array, front_is_lit in zip(self.lit_arrays, (True, False), strict=True):
            if vertex_array is not None:
                self.unlit_program["front_is_lit"] = front_is_lit
                self.device.apply(state)
                vertex_array.render()

    def draw_volumes(self, view: View, state: State) -> None:
        """Caps and sides, as many triangles as their commands say; `state` has no depth test
        where all fragments are counted."""
        self._set_view(view)
        lists = ((">=", 1.0), (">=", -1.0), (">", 1.0))
        for place, (vertex_array, (behind, outward)) in enumerate(
            zip(self.vertex_arrays, lists, strict=True)
        ):
            if vertex_array is None:
                continue
            self.program["outward"] = outward
            self.device.apply(state._replace(depth_func=behind if state.depth_func else ""))
            first, count = place * self.casters.count, self.casters.count
            vertex_array.render_indirect(self.commands, count=count, first=first)

    def read(self, target: Target) -> Int32:
        """(height, width) int32 counts, as they were added up."""
        return self.sums.read(target)

    # The rest.

    def _upload(self) -> None:
        context, casters = self.device.context, self.casters
        rows = np.empty((2 * len(casters.caster), 4), np.int32)
        rows[:, :3] = np.tile(casters.vertex_world, (2, 1)).view(np.int32)
        rows[:, 3] = np.tile(casters.caster, 2)
        self.vertices = context.buffer(rows.tobytes() or bytes(16))
        lists: tuple[Faces, ...] = (casters.caps_front, casters.caps_back, casters.body)
        self.index_buffers = [context.buffer(part.indices.tobytes() or bytes(12)) for part in lists]
        layout = [(self.vertices, "3f 1i", "vertex_world", "caster")]
        self.vertex_arrays = [
            context.vertex_array(self.program, layout, index_buffer=buffer)
            if len(part.indices)
            else None
            for part, buffer in zip(lists, self.index_buffers, strict=True)
        ]
        lit = (casters.front_lit, casters.back_lit)
        self.lit_buffers = [context.buffer(part.tobytes() or bytes(12)) for part in lit]
        self.lit_arrays = [
            context.vertex_array(
                self.unlit_program, [(self.vertices, "3f 4x", "vertex_world")], index_buffer=buffer
            )
            if len(part)
            else None
            for part, buffer in zip(lit, self.lit_buffers, strict=True)
        ]
        words = np.zeros((len(lists), casters.count, COMMAND_WORDS), np.uint32)
        for row, part in zip(words, lists, strict=True):
            row[:, 0], row[:, 2] = 3 * np.diff(part.offsets), 3 * part.offsets[:-1]
        words[:, :, 1] = 1
        self.all_commands = words.tobytes() or bytes(4)
        self.commands = context.buffer(self.all_commands)
        self.lexels = context.buffer(self.rectangles().tobytes() or bytes(16))
        self.range = context.buffer(self.ranges().tobytes() or bytes(8))
        self.planes = context.buffer(reserve=max(8, 8 * casters.count))

    def _clamp(self) -> None:
        """Look up every caster's planes, and write its commands."""
        shader = self.extents_shader
        for binding, buffer in enumerate(
            (self.lexels, self.range, self.planes, self.commands), start=1
        ):
            buffer.bind_to_storage_buffer(binding)
        shader["casters"] = self.casters.count
        shader["lists"] = len(self.vertex_arrays)
        shader["light_near"] = self.light.camera.near
        for levels in (self.litmaps.nearest, self.litmaps.farthest):
            levels.use(shader)
            shader["farthest"] = levels.farthest
            shader.run(-(-self.casters.count // GROUP))
            self.device.context.memory_barrier()

    def _keep_all(self) -> None:
        self.commands.write(self.all_commands)
        endless_planes = np.tile(np.array([-np.inf, np.inf], np.float32), (self.casters.count, 1))
        self.planes.write(endless_planes.tobytes())

    def _set_view(self, view: View) -> None:
        program, light = self.program, self.light.camera
        view_uniforms(program, view)
        eye = view.camera.eye
        away = np.append(light.forward, 0.0)
        if not self.light.directional:
            away = np.append(light.eye - eye, 1.0)
        set_uniform(program, "light_relative", away.astype(np.float32).tobytes())
        row = light_from_relative(self.light, eye)[2]
        set_uniform(program, "distance_row", row.astype(np.float32).tobytes())
        program["vertices"] = len(self.casters.caster)
        self.planes.bind_to_storage_buffer(3)

    def _read_extents(self) -> tuple[Float32, Int64]:
        count = self.casters.count
        self.device.context.memory_barrier()
        planes = np.frombuffer(self.planes.read(), np.float32)[: 2 * count].reshape(count, 2)
        words = np.frombuffer(self.commands.read(), np.uint32)
        kept = words[: COMMAND_WORDS * count].reshape(count, COMMAND_WORDS)[:, 1] > 0
        return planes, np.flatnonzero(kept)

    def _reach(self, camera: Camera) -> float:
        low, high = np.abs(self.scene.bounds - camera.eye)
        return float(np.linalg.norm(np.maximum(low, high)))

    def close(self) -> None:
        for array in (*self.vertex_arrays, *self.lit_arrays):
            if array is not None:
                array.release()
        buffers = (self.vertices, self.commands, self.lexels, self.range, self.planes)
        for buffer in (*self.index_buffers, *self.lit_buffers, *buffers):
            buffer.release()
        self.litmaps.release()
        self.sums.release()


def endless(camera: Camera) -> Camera:
    """The camera without a far plane."""
    return replace(camera, far=math.inf)
