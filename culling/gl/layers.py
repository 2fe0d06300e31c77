"""All fragments of some triangles before what a depth buffer holds, read back as hits."""

from __future__ import annotations

from typing import NamedTuple

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.scene import Float32, Int32, Int64, Scene
from visref_culling.gl.changes import Changes, write_indices
from visref_culling.gl.device import Device, State, Target, set_uniform
from visref_culling.gl.geometry import view_uniforms
from visref_culling.gl.view import View

HIT_BYTES = 12  # sample, triangle, depth
# Hits that the buffer has room for at first; it grows with what a frame needs.
FIRST_CAPACITY = 1 << 16


class Hits(NamedTuple):
    """(h,) arrays sorted by sample, window depth, then triangle: `sample` int64 (flat index),
    `triangle` int32, `depth` float32."""

    sample: Int64
    triangle: Int32
    depth: Float32


class Layers:
    """Triangles on the GPU, `chosen` (t,) bool, that give all their fragments. `vertices`: the
    scene's, (v, 3) float32, which stay the caller's."""

    def __init__(
        self, gl: Device, scene: Scene, vertices: moderngl.Buffer, chosen: NDArray[np.bool_]
    ) -> None:
        self.device = gl
        self.program = gl.program("mesh.vert", "layers.frag")
        self.count = gl.context.buffer(reserve=4)
        self.most = gl.max_block_bytes // HIT_BYTES
        self.capacity = 0
        self.cut = False
        self.hits: moderngl.Buffer | None = None
        self.parts: list[tuple[bool, int, moderngl.VertexArray, list[moderngl.Buffer]]] = []
        self.triangles: list[Int32] = []
        for one_sided in (False, True):
            ids = np.flatnonzero(chosen & (scene.one_sided == one_sided)).astype(np.int32)
            if len(ids):
                self.triangles.append(ids)
                buffers = [
                    gl.context.buffer(scene.triangles[ids].tobytes()),
                    gl.context.buffer(ids.tobytes()),
                ]
                vertex_array = gl.context.vertex_array(
                    self.program, [(vertices, "3f", "vertex_world")], index_buffer=buffers[0]
                )
                self.parts.append((one_sided, len(ids), vertex_array, buffers))

    def update(self, scene: Scene, changes: Changes) -> None:
        """Follow the scene to another moment, in which this has changed; the vertices are the
        caller's."""
        for (_, _, _, buffers), ids in zip(self.parts, self.triangles, strict=True):
            write_indices(buffers[0], scene, changes, ids)

    def before(self, view: View, target: Target) -> Hits:
        """The fragments before the target's depth or level with it; that depth stays."""
        view_uniforms(self.program, view)
        self.cut = view.is_cut
        size = np.array(target.framebuffer.size, np.int32)
        set_uniform(self.program, "size", size.tobytes())
        found = [np.zeros((0, 3), np.uint32)]
        for part, (_, count, _, _) in enumerate(self.parts):
            self._collect(target, part, 0, count, found)
        words = np.concatenate(found)
        sample, triangle = words[:, 0].astype(np.int64), words[:, 1].astype(np.int32)
        depth = np.ascontiguousarray(words[:, 2]).view(np.float32)
        # A depth is not negative, so its bits are ordered as it is.
        key = sample << 32 | words[:, 2]
        order = np.argsort(key)
        if (np.diff(key[order]) == 0).any():
            order = np.lexsort((triangle, key))
        return Hits(sample[order], triangle[order], depth[order])

    def _collect(
        self, target: Target, part: int, first: int, count: int, found: list[NDArray[np.uint32]]
    ) -> None:
        """Draw a range of a part's triangles; halves of it where the buffer cannot hold all."""
        needed = self._draw(target, part, first, count)
        if needed > self.capacity and needed <= self.most:
            self._grow(needed)
            needed = self._draw(target, part, first, count)
        if needed <= self.capacity:
            if needed and self.hits is not None:
                raw = self.hits.read(HIT_BYTES * needed)
                found.append(np.frombuffer(raw, np.uint32).reshape(-1, 3))
        elif count == 1:
            raise InputError(
                "an image with more pixels than this OpenGL can list for one triangle",
                place="width",
                fix=f"give at most {self.most} pixels in all",
            )
        else:
            self._collect(target, part, first, count // 2, found)
            self._collect(target, part, first + count // 2, count - count // 2, found)

    def _grow(self, needed: int) -> None:
        if self.hits is not None:
            self.hits.release()
        self.capacity = min(self.most, max(FIRST_CAPACITY, needed + needed // 2))
        self.hits = self.device.context.buffer(reserve=HIT_BYTES * self.capacity)

    def _draw(self, target: Target, part: int, first: int, count: int) -> int:
        """How many fragments there are; as many as fit are in the buffer."""
        if self.hits is None:
            self._grow(0)
        assert self.hits is not None
        one_sided, _, vertex_array, buffers = self.parts[part]
        set_uniform(self.program, "capacity", np.uint32(self.capacity).tobytes())
        set_uniform(self.program, "first_primitive", np.int32(first).tobytes())
        self.count.write(bytes(4))
        buffers[1].bind_to_storage_buffer(0)
        self.count.bind_to_storage_buffer(1)
        self.hits.bind_to_storage_buffer(2)
        self.device.apply(
            State(
                target.scratch,
                self.program,
                depth_write=False,
                cull_back_faces=one_sided,
                cut=self.cut,
            )
        )
        vertex_array.render(vertices=3 * count, first=3 * first)
        self.device.context.memory_barrier()
        return int(np.frombuffer(self.count.read(), np.uint32)[0])

    def release(self) -> None:
        for _, _, vertex_array, buffers in self.parts:
            vertex_array.release()
            for buffer in buffers:
                buffer.release()
        if self.hits is not None:
            self.hits.release()
        self.count.release()


class GivenDepth:
    """Brings depths from the CPU into a target."""

    def __init__(self, gl: Device) -> None:
        self.device = gl
        self.program = gl.program("rectangle.vert", "given_depth.frag")
        self.vertex_array = gl.context.vertex_array(self.program, [])

    def write(self, target: Target, depth: Float32) -> None:
        """Move the target's depth nearer, to `depth` (height, width), window depth, top row
        first, where that is nearer."""
        height, width = depth.shape
        rows = np.ascontiguousarray(depth[::-1], np.float32)
        texture = self.device.context.texture((width, height), 1, rows.tobytes(), dtype="f4")
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        texture.use(0)
        set_uniform(self.program, "depth", np.int32(0).tobytes())
        whole = np.array([-1.0, -1.0, 1.0, 1.0], np.float32)
        set_uniform(self.program, "sides_ndc", whole.tobytes())
        set_uniform(self.program, "depth_ndc", np.float32(0.0).tobytes())
        self.device.apply(State(target.framebuffer, self.program, "<", colour_write=False))
        self.vertex_array.render(moderngl.TRIANGLE_STRIP, vertices=4)
        texture.release()

    def release(self) -> None:
        self.vertex_array.release()
