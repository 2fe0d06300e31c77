"""Images that add up: what effects draw over a scene's depth, summed at each sample.

Sums are floats, exact up to 2**24.
"""

from __future__ import annotations

from collections.abc import Callable

import moderngl
import numpy as np

from visref.culler import QueryStats, RasterTolerance
from visref.scene import Int32, Scene
from visref_culling.gl.device import Device, State, Target
from visref_culling.gl.geometry import Geometry
from visref_culling.gl.view import View

DEPTH_BITS = 24


class Sums:
    """A solid scene's depth (`visref.effects.solid`), and sums over it."""

    def __init__(self, device: Device, scene: Scene) -> None:
        self.device = device
        self.units = np.arange(scene.object_count, dtype=np.int64)
        every = np.ones(scene.triangle_count, np.bool_)
        self.geometry = Geometry(device, scene, scene.object_units(), every)

    def begin(self, view: View) -> Target:
        """The scene's depth as this view has it; all sums 0."""
        camera = view.camera
        target = self.device.target(camera.width, camera.height, DEPTH_BITS, "f4")
        self.device.begin_frame()
        self.device.clear(State(target.framebuffer, self.geometry.program))
        self.geometry.draw(view, target, self.units, QueryStats())
        self.device.clear_colour(target.framebuffer)
        return target

    def adding(self, target: Target, program: moderngl.Program) -> State:
        """The state in which fragments before the scene add to the sums, and hide nothing."""
        return State(target.framebuffer, program, depth_write=False, add_colours=True)

    def fragments(
        self, target: Target, program: moderngl.Program, draw: Callable[[State], None]
    ) -> int:
        """How many fragments a draw has, hidden ones included: beside the frame, not in it."""
        query = self.device.queries(1)[0]
        with query:
            draw(State(target.scratch, program, depth_func="", depth_write=False))
        return int(query.samples)

    def read(self, target: Target) -> Int32:
        """(height, width) int32, the sums, top row first."""
        width, height = target.framebuffer.size
        raw = np.frombuffer(target.framebuffer.read(components=1, dtype="f4"), np.float32)
        return raw.reshape(height, width)[::-1].astype(np.int32)

    def tolerance(self, view: View) -> RasterTolerance:
        """What this rasteriser declares for a view."""
        return view.tolerance(DEPTH_BITS)

    def release(self) -> None:
        self.geometry.release()
