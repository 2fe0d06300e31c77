"""Culling by a pyramid of depth, wholly on the GPU (`boxes.commands`)."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import QueryStats
from visref.scene import Float64, Int64
from visref_culling.boxes.commands import LOOKED_UP, BoxCommands, Decided, view_bytes
from visref_culling.gl.device import Device, Target
from visref_culling.gl.geometry import Geometry
from visref_culling.gl.view import View
from visref_culling.hzb.cones import WORDS
from visref_culling.hzb.pyramid import DepthPyramid

SHADER = "hzb_cull.comp"
CONES = 8  # the binding of the units' cones
# As in the shader.
REMEMBERED, BY_THE_LAST, BY_THIS = 0, 1, 2
MOST_TEXELS = 4


@dataclass(eq=False)
class Past:
    """A view's pyramid, and its camera's rows when that was built; none yet where it is None."""

    pyramid: DepthPyramid
    rows: bytes | None = None


@dataclass(frozen=True)
class Lookup:
    """How a box is looked up: with how many `texels`, 4 or 1, and whether as a sphere."""

    texels: int
    spheres: bool


class PyramidCull(BoxCommands):
    """Units decided by pyramids of depth. `by_set`: what is drawn first is what the last frame saw,
    else what the last frame's pyramid does not hide; `twice`: the rest is then tested by this
    frame's. `cones`: (u, 9) float64 (`cones_of`), None where nothing is left out that faces away.
    Other arguments as `BoxCommands`'."""

    pyramid_of: type[DepthPyramid] = DepthPyramid

    def __init__(
        self,
        device: Device,
        geometry: Geometry,
        bounds: Float64,
        can_occlude: NDArray[np.bool_],
        *,
        lookup: Lookup,
        by_set: bool,
        twice: bool,
        cones: Float64 | None = None,
    ) -> None:
        super().__init__(
            device,
            geometry,
            bounds,
            can_occlude,
            fix="judge a smaller part of the scene",
            more={CONES: np.zeros((0, WORDS)) if cones is None else cones},
        )
        self.lookup, self.by_set, self.twice = lookup, by_set, twice
        self.has_cones = cones is not None
        self.past_of_view: dict[str, Past] = {}

    def load(self) -> moderngl.ComputeShader:
        return self.device.compute(SHADER)

    def frame(self, view: View, target: Target, stats: QueryStats) -> Decided:
        """Draw what may be visible. `Decided.asked` are those drawn that were looked up."""
        if not self.units:
            return Decided(*np.zeros((3, 0), np.int64))
        camera, past = view.camera, self.past_for(view.camera, target)
        rows = view_bytes(view, len(self.geometry.classes))
        known = self.rows_of_the_last(past, camera)
        self.look_from([rows, known or rows])
        self.shader["past"] = known is not None
        self.decide(REMEMBERED if self.by_set else BY_THE_LAST, past, camera)
        self.draw(view, target, stats)
        if self.twice:
            # What was seen is not what was looked up first.
            past.pyramid.build(target)
            self.decide(BY_THIS, past, camera)
            self.draw(view, target, stats)
        if not self.by_set:
            past.pyramid.build(target)
            past.rows = rows
        before = stats.queries or 0
        decided = self.read(camera, stats)
        stats.lookups = (stats.lookups or 0) + MOST_TEXELS * ((stats.queries or 0) - before)
        if self.twice:
            return decided
        seen = np.frombuffer(self.seen_by(camera).read(4 * self.units), np.uint32)
        asked = decided.occluders[seen[decided.occluders] & LOOKED_UP != 0]
        return decided._replace(asked=asked)

    def decide(self, step: int, past: Past, camera: Camera) -> None:
        """One of the shader's steps over all units."""
        past.pyramid.use(self.shader)
        self.shader["step"] = step
        self.shader["side"] = 2 if self.lookup.texels == MOST_TEXELS else 1
        self.shader["spheres"] = self.lookup.spheres
        self.shader["cones"] = self.has_cones
        self.run(camera)

    def move_cones(self, cones: Float64, units: Int64) -> None:
        """The units' cones from now on, (u, 9) float64; those of `units`, (k,) ids, have
        changed."""
        self.write(self.blocks[CONES], cones, units)

    def rows_of_the_last(self, past: Past, camera: Camera) -> bytes | None:
        """Where the last frame's camera stood; None where nothing is known of it."""
        return None if camera.cut else past.rows

    def past_for(self, camera: Camera, target: Target) -> Past:
        """What is kept of the camera's view, of this image's size."""
        size = target.framebuffer.size
        past = self.past_of_view.get(camera.view)
        if past is None or past.pyramid.size != size:
            if past is not None:
                past.pyramid.release()
            past = self.past_of_view[camera.view] = Past(self.pyramid_of(self.device, *size))
        return past

    def release(self) -> None:
        for past in self.past_of_view.values():
            past.pyramid.release()
        super().release()
