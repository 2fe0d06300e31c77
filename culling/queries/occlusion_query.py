"""Ask the depth buffer whether boxes would show: the hardware occlusion query.

Four ways, one answer:

- "sync": a query, wait for it, the next. What a method pays that decides box by box.
- "batch": all queries out, then all answers in.
- "instanced": all boxes in one draw; a shader behind early fragment tests leaves a mark for each
  box that has a passing sample.
- "counted": the same, with an atomic counter a box in place of the mark. Where the shader runs on
  a CPU, a box of many samples pays for each of them.

The depth and image are read only in all four. Each can ask the eight corners, a point each, in
place of the box: cheaper, and a "no" says nothing about the box.

Boxes come inflated and in float32 (see `boxes.conservative`), wholly beyond the near plane; depth
is clamped behind the far plane, so a box that reaches across it is not cut open.
"""

from __future__ import annotations

from collections.abc import Callable

import moderngl
import numpy as np

from visref.culler import QueryStats
from visref.scene import Float32, Int64
from visref_culling.gl.device import Device, State, Target, set_uniform
from visref_culling.gl.view import View

STRIP_VERTICES = 14
CORNERS = 8
STRIP_STRIDE = 16  # of vertex ids from a box to the next

StateHook = Callable[[State], State]


class BoxQueries:
    """Occlusion queries of boxes against a target's depth, with the buffers they need."""

    def __init__(self, device: Device) -> None:
        self.device = device
        context = device.context
        self.plain = device.program("box.vert", "plain.frag")
        self.plain_array = context.vertex_array(self.plain, [])
        # By way of asking.
        self.instanced = {
            "instanced": device.program("box.vert", "box_seen.frag"),
            "counted": device.program("box.vert", "box_count.frag"),
        }
        self.instanced_arrays = {
            way: context.vertex_array(program, []) for way, program in self.instanced.items()
        }
        self.boxes = context.buffer(reserve=24, dynamic=True)
        self.answers = context.buffer(reserve=4, dynamic=True)

    def ask(
        self,
        view: View,
        target: Target,
        boxes: Float32,
        stats: QueryStats,
        *,
        way: str,
        cull_back_faces: bool,
        corners_only: bool = False,
        state_hook: StateHook = lambda state: state,
    ) -> Int64:
        """Samples of each box, (k,) int64, that are not behind the target's depth; the way
        "instanced" says 1 for any number of them.

        `boxes`: (k, 2, 3) float32, relative to the eye. `way` is "sync", "batch", "instanced" or
        "counted". `corners_only` draws corners as points. `state_hook` sees the GL state
        before it is set.
        """
        if not len(boxes):
            return np.zeros(0, np.int64)
        if way in self.instanced:
            samples, stalls, changes = self._instanced(
                way, view, target, boxes, cull_back_faces, corners_only, state_hook
            )
            stats.bytes_read_back = (stats.bytes_read_back or 0) + 4 * len(boxes)
        else:
            samples, stalls, changes = self._hardware(
                view,
                target,
                boxes,
                cull_back_faces,
                corners_only,
                state_hook,
                wait_for_each=way == "sync",
            )
        stats.queries = (stats.queries or 0) + len(boxes)
        stats.queries_passed = (stats.queries_passed or 0) + int(np.count_nonzero(samples))
        stats.batches = (stats.batches or 0) + stalls
        stats.state_changes = (stats.state_changes or 0) + changes
        return samples

    def upload(
        self, program: moderngl.Program, view: View, boxes: Float32, corners_only: bool
    ) -> tuple[int, int]:
        """Make boxes, (k, 2, 3) float32 relative to the eye, and uniforms ready for a program;
        returns the primitive and its number of vertices."""
        set_uniform(program, "corners_only", np.int32(corners_only).tobytes())
        set_uniform(program, "clip_from_relative", view.clip_from_relative_bytes)
        set_uniform(program, "depth_shift_ndc", np.float32(view.depth_shift_ndc).tobytes())
        self.boxes.orphan(max(self.boxes.size, boxes.nbytes))
        self.boxes.write(np.ascontiguousarray(boxes, np.float32).tobytes())
        self.boxes.bind_to_storage_buffer(1)
        if corners_only:
            return moderngl.POINTS, CORNERS
        return moderngl.TRIANGLE_STRIP, STRIP_VERTICES

    def _hardware(
        self,
        view: View,
        target: Target,
        boxes: Float32,
        cull_back_faces: bool,
        corners_only: bool,
        state_hook: StateHook,
        *,
        wait_for_each: bool,
    ) -> tuple[Int64, int, int]:
        mode, vertices = self.upload(self.plain, view, boxes, corners_only)
        state = State(
            target.framebuffer,
            self.plain,
            depth_write=False,
            colour_write=False,
            cull_back_faces=cull_back_faces,
            clamp_depth=True,
        )
        changes = self.device.apply(state_hook(state))
        in_flight = 1 if wait_for_each else len(boxes)
        pool = self.device.queries(in_flight)
        samples = np.zeros(len(boxes), np.int64)
        for start in range(0, len(boxes), in_flight):
            for place in range(in_flight):
                with pool[place]:
                    self.plain_array.render(
                        mode, vertices=vertices, first=STRIP_STRIDE * (start + place)
                    )
            for place in range(in_flight):
                # Reading the result waits until the query has finished.
                samples[start + place] = pool[place].samples
        return samples, len(boxes) // in_flight, changes

    def _instanced(
        self,
        way: str,
        view: View,
        target: Target,
        boxes: Float32,
        cull_back_faces: bool,
        corners_only: bool,
        state_hook: StateHook,
        *,
        depth_func: str = "<=",
    ) -> tuple[Int64, int, int]:
        program = self.instanced[way]
        mode, vertices = self.upload(program, view, boxes, corners_only)
        self.answers.orphan(max(self.answers.size, 4 * len(boxes)))
        self.answers.clear()
        self.answers.bind_to_storage_buffer(2)
        state = State(
            target.scratch,
            program,
            depth_func=depth_func,
            depth_write=False,
            cull_back_faces=cull_back_faces,
            clamp_depth=True,
        )
        changes = self.device.apply(state_hook(state))
        self.instanced_arrays[way].render(mode, vertices=vertices, instances=len(boxes))
        self.device.context.memory_barrier(moderngl.BUFFER_UPDATE_BARRIER_BIT)
        raw = self.answers.read(4 * len(boxes))
        return np.frombuffer(raw, np.uint32).astype(np.int64), 1, changes

    def fragments(
        self,
        view: View,
        target: Target,
        boxes: Float32,
        *,
        cull_back_faces: bool,
        corners_only: bool = False,
    ) -> Int64:
        """Samples that each box covers in the viewport, (k,) int64, hidden ones included.
        An instrumented pass without a depth test: beside a frame, not in it."""
        if not len(boxes):
            return np.zeros(0, np.int64)
        samples, _, _ = self._instanced(
            "counted",
            view,
            target,
            boxes,
            cull_back_faces,
            corners_only,
            lambda state: state,
            depth_func="",
        )
        return samples

    def release(self) -> None:
        self.plain_array.release()
        for array in self.instanced_arrays.values():
            array.release()
        self.boxes.release()
        self.answers.release()
