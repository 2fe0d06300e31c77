"""Ask the depth buffer about rectangles of pixels: the pixel-level query of a grid of cells.

Hey, Tobler, Purgathofer 2001, section 5, names three ways:

- `Readback` reads the area's depth and looks at every pixel: the paper's own set-up.
- `SoftwareBuffer` (`queries.software_depth`) keeps a depth buffer beside GL's.
- `RectangleQueries` draws the area as one rectangle at the asked depth, with an occlusion query
  around it: the only one that needs no pixel on the CPU.

Two questions are asked. `any_free`: is there a pixel where nothing was drawn yet? `reach`: is
there a pixel not nearer than a depth, and what does that say of the farthest one? The answer to
the second is a pair (reached, farthest) of bounds: some pixel is at least as far as the first,
none is farther than the second. A depth z is hidden where z > farthest and shows where
z <= reached; a query about z always decides z.

A way that sees pixels returns the true z_far as both bounds. A rectangle drawn over the *whole*
area at depth z decides z alone:

- A sample passes: some stored depth is not less than z, so reached = z. Nothing is learnt about
  how far the pixels go, so farthest is left.
- None passes: every stored depth is less than z, so farthest is the largest number below z. A
  box at exactly z is hidden too, which `z_near <= z_far -> visible` would miss with z itself.

This is what section 5 wants of an occlusion query, and not what it says. It tests the *box* in
the cell's area and stores the box's z_near if no sample passes. As printed that is useless,
since z_near <= z_far still holds then and Fig. 3 goes on to call the box visible. With `<` in
its place it is unsafe: that no sample of the box passes says that the box's own surface, which
may lie far behind its nearest corner or cover little of the cell, is hidden; it does not say
that the cell's pixels are nearer than z_near. With the whole area at z_near it does.

What is kept stays true while the frame goes on: depths only come nearer, so `farthest` stands
for good and only `reached` is forgotten when something is drawn. Every answer equals the one
that the true z_far would give, so the drawn set does too.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.culler import QueryStats
from visref.scene import Float32, Float64, Int64, Scene
from visref_culling.gl.device import Device, State, Target, set_uniform
from visref_culling.gl.view import View

Area = tuple[int, int, int, int]  # x0, y0, x1, y1 in pixels, half-open, y down
StateHook = Callable[[State], State]

CLEARED = 1.0  # window depth where nothing was drawn


class AreaQueries(ABC):
    """One way of asking. `begin` starts a frame; depths compared are what `depth_of` returns."""

    z_max: float = CLEARED

    def begin(self, view: View, target: Target, stats: QueryStats) -> None:
        self.view, self.target, self.stats = view, target, stats

    def update(self, scene: Scene) -> None:
        """The scene as it stands from now on."""

    def depth_of(self, nearest: Float64) -> Float64:
        """Depths as the buffer holds them, (k,) float64, from view depths beyond the near plane.

        Nearer only draws too much.
        """
        return self.view.window_depth(nearest)

    def drawn(self, units: Int64) -> None:
        """These units, (k,) int64 ids, were drawn; a buffer beside GL's must follow."""

    @abstractmethod
    def any_free(self, area: Area) -> bool:
        """Whether nothing was drawn at some pixel of the area."""

    @abstractmethod
    def reach(self, area: Area, depth: float) -> tuple[float, float]:
        """(reached, farthest) of the area, with depth <= reached or depth > farthest."""

    def release(self) -> None:
        """Free what the queries hold."""

    def _count(self, passed: bool, *, bytes_read_back: int = 0, fragments: int = 0) -> None:
        stats = self.stats
        stats.queries = (stats.queries or 0) + 1
        stats.queries_passed = (stats.queries_passed or 0) + passed
        stats.batches = (stats.batches or 0) + 1
        stats.bytes_read_back = (stats.bytes_read_back or 0) + bytes_read_back
        stats.query_fragments = (stats.query_fragments or 0) + fragments
        if passed:
            stats.query_fragments_passed = (stats.query_fragments_passed or 0) + fragments


class PixelQueries(AreaQueries):
    """A way that sees the pixels."""

    bytes_a_pixel = 0

    @abstractmethod
    def pixels(self, area: Area) -> Float32:
        """The area's depths, float32, in any order and shape."""

    def any_free(self, area: Area) -> bool:
        depths = self.pixels(area)
        free = self.free(depths)
        self._count(free, bytes_read_back=self.bytes_a_pixel * depths.size)
        return free

    def reach(self, area: Area, depth: float) -> tuple[float, float]:
        depths = self.pixels(area)
        farthest = self.farthest(depths)
        self._count(depth <= farthest, bytes_read_back=self.bytes_a_pixel * depths.size)
        return farthest, farthest

    def free(self, depths: Float32) -> bool:
        """Whether nothing was drawn at one of an area's depths, float32 of any shape."""
        return bool(depths.max() >= self.z_max)

    def farthest(self, depths: Float32) -> float:
        """The greatest of an area's depths, float32 of any shape."""
        return float(depths.max())


class Readback(PixelQueries):
    """Reads window depth from GL. A 24-bit depth comes as the float32 nearest to it, which is
    off by 2**-25 at most: a twentieth of what `depth_of` keeps for it."""

    bytes_a_pixel = 4

    def pixels(self, area: Area) -> Float32:
        """(n,) float32 window depths of the area's n pixels, lowest row first."""
        x0, y0, x1, y1 = area
        raw = self.target.framebuffer.read(
            viewport=(x0, self.bottom(area), x1 - x0, y1 - y0),
            components=1,
            attachment=-1,
            dtype="f4",
            alignment=4,
        )
        return self.decoded(np.frombuffer(raw, np.float32))

    def bottom(self, area: Area) -> int:
        """The area's lowest row as GL counts, from below."""
        return self.view.camera.height - area[3]

    def decoded(self, depths: Float32) -> Float32:
        """(n,) float32 window depths, from what GL gave, (n,) float32."""
        return depths


class RectangleQueries(AreaQueries):
    """An occlusion query around a rectangle at one depth."""

    def __init__(
        self, device: Device, state_hook: StateHook, passes: Callable[[Int64], NDArray[np.bool_]]
    ):
        self.device, self.state_hook, self.passes = device, state_hook, passes
        self.program = device.program("rectangle.vert", "plain.frag")
        self.vertex_array = device.context.vertex_array(
            self.program, [], mode=moderngl.TRIANGLE_STRIP
        )
        self.query = device.queries(1)[0]

    def any_free(self, area: Area) -> bool:
        return self._passes(area, CLEARED)

    def reach(self, area: Area, depth: float) -> tuple[float, float]:
        if self._passes(area, depth):
            return depth, np.inf
        return -np.inf, float(np.nextafter(depth, -np.inf))

    def _passes(self, area: Area, depth: float) -> bool:
        camera = self.view.camera
        x0, y0, x1, y1 = area
        # The rectangle's sides run between samples, half a pixel from the next, so that no
        # rounding can take one in or leave one out.
        sides = np.array(
            [
                2.0 * x0 / camera.width - 1.0,
                1.0 - 2.0 * y1 / camera.height,
                2.0 * x1 / camera.width - 1.0,
                1.0 - 2.0 * y0 / camera.height,
            ],
            np.float32,
        )
        set_uniform(self.program, "sides_ndc", sides.tobytes())
        set_uniform(self.program, "depth_ndc", np.float32(_ndc_towards_eye(depth)).tobytes())
        state = State(
            self.target.framebuffer,
            self.program,
            depth_write=False,
            colour_write=False,
            clamp_depth=True,
        )
        changes = self.device.apply(self.state_hook(state))
        self.stats.state_changes = (self.stats.state_changes or 0) + changes
        with self.query:
            self.vertex_array.render(vertices=4)
        # Reading the result waits until the query has finished.
        passed = bool(self.passes(np.array([self.query.samples]))[0])
        self._count(passed, fragments=(x1 - x0) * (y1 - y0))
        return passed

    def release(self) -> None:
        self.vertex_array.release()


def _ndc_towards_eye(depth: float) -> float:
    """NDC depth of a window depth, as a float32 that is not farther. The cleared depth stays
    exact."""
    ndc = np.float32(2.0 * depth - 1.0)
    if float(ndc) > 2.0 * depth - 1.0:
        ndc = np.nextafter(ndc, np.float32(-np.inf))
    return float(ndc)
