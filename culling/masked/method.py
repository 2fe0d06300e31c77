"""Masked software occlusion culling.

J. Hasselgren, M. Andersson, T. Akenine-Möller: Masked Software Occlusion Culling. High-Performance
Graphics 2016.

Units are taken front to back. The rectangle and the least depth of a unit's box are looked up in a
masked depth buffer of the processor's (`masked.buffer`); what it does not hide is shown, and
rasterised into it: all shown units, or with `least` those of a rectangle that large. What is shown
is then drawn by OpenGL, which decides nothing. Nothing is kept from one frame to the next.

Every pixel's bound says no less than how far its nearest occluder certainly is, so what is hidden
by it is hidden. Two depths in a tile are coarser than one each pixel (`queries.software_depth`).

Departures from the paper:

- Coverage and depth are tested sample by sample in double precision, and count where they are
  certain (`queries.software_depth`); the paper's rasteriser steps along edges, 32 pixels at once.
- A triangle's depth in a tile is the greatest over the samples that it covers, which is no
  farther than the paper's, over the tile within the triangle's own range.
- A lookup takes the second layer where the mask holds all of the rectangle in a tile.
- A box across the near plane is visible without a lookup.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from visref.culler import Option
from visref.errors import InputError
from visref.scene import Float64, Scene, Units
from visref_culling.boxes.conservative import nearest_depth
from visref_culling.boxes.rectangles import screen_rectangles
from visref_culling.gl.item_buffer import GLRaster
from visref_culling.gl.view import View
from visref_culling.masked import buffer
from visref_culling.masked.buffer import MaskedBuffer
from visref_culling.method import GL_OPTIONS, Frame, GLCuller, phase
from visref_culling.queries.software_depth import Mesh, mesh_of, rays_of


class MaskedOcclusion(GLCuller):
    """Boxes looked up in a masked depth buffer on the processor, front to back."""

    name = "masked-occlusion"
    summary = "Hasselgren et al. 2016: boxes looked up in a masked depth buffer on the processor"
    options: ClassVar[Mapping[str, Option]] = {
        "least": Option(0, "pixels of its rectangle from which on a unit hides others"),
        **GL_OPTIONS,
    }

    notes_asked = True

    def __init__(self, *, least: int = 0, depth: int = 24, fragments: bool = False) -> None:
        super().__init__(depth=depth, fragments=fragments)
        if least < 0:
            raise InputError(f"least is {least}", fix="give 0 or more pixels")
        self.least = least

    def prepare(self, scene: Scene) -> Units:
        units = super().prepare(scene)
        self.masked = MaskedBuffer.of(1, 1)
        self.size = 1, 1
        return units

    def raster_of(self, scene: Scene) -> GLRaster | None:
        """None: GL's depth decides nothing."""
        return None

    def needs_no_query(self, view: View, boxes: Float64) -> NDArray[np.bool_]:
        # A rectangle is computed and not drawn, so nothing else needs sparing.
        crosses: NDArray[np.bool_] = nearest_depth(view, boxes) <= view.camera.near
        return crosses

    def rectangles(self, frame: Frame) -> NDArray[np.int32]:
        """(k, 4) int32: the pixels x0, y0, x1, y1, inclusive, that the frame's boxes may touch."""
        return screen_rectangles(frame.view, frame.boxes)

    def nearest(self, frame: Frame) -> Float64:
        """(k,) float64: the least view depths of the frame's boxes."""
        return frame.nearest

    def decide(self, frame: Frame) -> None:
        size = frame.view.camera.width, frame.view.camera.height
        if self.size != size:
            self.masked, self.size = MaskedBuffer.of(*size), size
        self.empty(self.masked)
        shown = np.zeros(len(frame.ids), np.bool_)
        rectangles = self.rectangles(frame)
        # Nothing of an empty rectangle is in the image.
        inside = frame.sure | (
            (rectangles[:, 0] <= rectangles[:, 2]) & (rectangles[:, 1] <= rectangles[:, 3])
        )
        places = np.flatnonzero(inside)
        found = np.zeros(len(places), np.bool_)
        with phase(frame.stats, "query"):
            tiles = self.kernel()(
                self.mesh(),
                rays_of(frame.view),
                self.units.offsets,
                self.units.triangles,
                frame.ids[places],
                rectangles[places],
                self.nearest(frame)[places],
                frame.sure[places],
                self.least,
                self.masked,
                found,
            )
        shown[places] = found
        asked = places[~frame.sure[places]]
        frame.stats.queries = len(asked)
        frame.stats.queries_passed = int(shown[asked].sum())
        frame.stats.lookups = int(tiles)
        frame.note_asked(frame.ids[asked[shown[asked]]])
        self.observe("masked", shown=shown)
        self.draw(frame, np.flatnonzero(shown))

    def mesh(self) -> Mesh:
        """What is rasterised, as it stands in this frame."""
        return mesh_of(self.scene, self.occluders(self.scene))

    def empty(self, masked: MaskedBuffer) -> None:
        masked.clear()

    def kernel(self) -> Any:
        """What decides about the units in order: `masked.buffer.decide`."""
        return buffer.decide
