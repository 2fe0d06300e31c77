"""Effects broken on purpose, one step each; the image protocol has to convict them.

By name: the class, its base first. `tests/mutants/test_effect_mutants.py` says on which scene.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from tests.support.shader_edits import edited
from visref_culling.gl import device
from visref_culling.n_buffer.gpu import NBufferTexture
from visref_culling.n_buffer.particles import Particles
from visref_culling.shadow_volumes import ShadowVolumes
from visref_culling.shadow_volumes.casters import Faces
from visref_culling.shadow_volumes.litmaps import Litmaps


def compute(shader, *changes):
    return device.device().context.compute_shader(edited(shader, *changes))


# Particles.


class EditedParticles(Particles):
    """Its vertex shader with some changes."""

    changes: tuple[tuple[str, str], ...] = ()

    def load_program(self):
        return self.device.context.program(
            vertex_shader=edited("particle.vert", *self.changes),
            geometry_shader=device.shader_source("particle.geom"),
            fragment_shader=device.shader_source("plain.frag"),
        )


class SquareRoundedInward(EditedParticles):
    """A row and a column of pixels less on each side."""

    changes = (
        ("max(corner_px, ivec2(0))", "max(corner_px + 1, ivec2(0))"),
        ("image_px) - 1);", "image_px) - 2);"),
    )


class SquareOnePixelShort(EditedParticles):
    """The last row and column left out."""

    changes = (("image_px) - 1);", "image_px) - 2);"),)


class CentreAlone(EditedParticles):
    """Only the pixel of the centre is tested: popping at silhouettes, as the paper warns."""

    changes = (("n_buffer_one(r)", "n_buffer_one((r + r.zwxy) / 2)"),)


class LevelTooSmall(EditedParticles):
    """A level below the one whose squares hold the sprite."""

    changes = (("n_buffer_one(r)", "n_buffer_square(r.xy, findMSB(r.z - r.x + 1) - 1)"),)


class SquareUnclipped(EditedParticles):
    """The square starts outside the image, where no texel is."""

    changes = (("max(corner_px, ivec2(0))", "corner_px"),)


class RowsFromTheBottom(EditedParticles):
    """The lookup takes rows from the bottom."""

    changes = (
        (
            "n_buffer_one(r)",
            "n_buffer_one(ivec4(r.x, image_px.y - 1 - r.w, r.z, image_px.y - 1 - r.y))",
        ),
    )


class FarSideOfTheSprite(Particles):
    """As if the sprite lay a little farther than it does."""

    def depth_shift(self, view):
        return -(2.0**-9)


class NearestDepthOfTheSquare(Particles):
    """Minimum for maximum."""

    def make_levels(self, width, height):
        return NBufferTexture(self.device, width, height, farthest=False)


class DepthOfTheFrameBefore(Particles):
    """The N-buffer is built once, and kept."""

    def build(self, target):
        if self.levels is None:
            super().build(target)


# Shadow volumes.


class NoFootprint(ShadowVolumes):
    """Samples are points, and GL does not err."""

    def make_litmaps(self):
        class Points(Litmaps):
            def doubt(self, view, reach):
                return 0.0, 0.0, 0.0

        return Points(self.device, self.light)


class LexelCentresAlone(ShadowVolumes):
    """As a litmap drawn from the light: what is seen between lexel centres is not in it."""

    def make_litmaps(self):
        class Centres(Litmaps):
            def load_scatter(self):
                off_centre = "abs(fract(light.xy / light.w) - 0.5)"
                return compute(
                    "litmap.comp",
                    (
                        "    vec2 lexel =",
                        f"    if (any(greaterThan({off_centre}, vec2(0.05)))) return;\n"
                        "    vec2 lexel =",
                    ),
                )

        return Centres(self.device, self.light)


class LevelsSwapped(ShadowVolumes):
    """The greatest of the nearest distances in a rectangle, and the least of the farthest."""

    def make_litmaps(self):
        class Other(NBufferTexture):
            def join(self, **how):
                self.farthest = not self.farthest
                super().join(**how)
                self.farthest = not self.farthest

            def use(self, program, **how):
                super().use(program, **how)
                program["n_buffer_farthest"] = not self.farthest

        litmaps = Litmaps(self.device, self.light)
        litmaps.nearest.__class__ = litmaps.farthest.__class__ = Other
        return litmaps


class LitmapOfTheFrameBefore(ShadowVolumes):
    """The litmaps are made once, and kept."""

    def make_litmaps(self):
        class Kept(Litmaps):
            built = False

            def build(self, view, target, reach):
                if not self.built:
                    super().build(view, target, reach)
                self.built = True

        return Kept(self.device, self.light)


class RectanglesRoundedInward(ShadowVolumes):
    def rectangles(self):
        low, high = self.casters.rectangle[:, :2], self.casters.rectangle[:, 2:]
        return np.concatenate([np.ceil(low), np.floor(high) - 1.0], axis=1).astype(np.int32)


class RectanglesRoundedToNearest(ShadowVolumes):
    def rectangles(self):
        low, high = self.casters.rectangle[:, :2], self.casters.rectangle[:, 2:]
        return np.concatenate([np.rint(low), np.rint(high) - 1.0], axis=1).astype(np.int32)


class LastRowLeftOut(ShadowVolumes):
    def rectangles(self):
        return super().rectangles() - np.array([0, 0, 0, 1], np.int32)


class RowsFlipped(ShadowVolumes):
    def rectangles(self):
        x0, y0, x1, y1 = super().rectangles().T
        height = self.light.camera.height
        return np.stack([x0, height - 1 - y1, x1, height - 1 - y0], axis=1).astype(np.int32)


class LightCapMovedVertexByVertex(ShadowVolumes):
    """The paper's rule: what is farther than the plane stays, what is nearer is projected."""

    def load_extents(self):
        return compute("volume_extents.comp", ("if (range.y <= least)", "if (true)"))


class DarkPlaneAtTheNearest(ShadowVolumes):
    """The volume ends where it begins to be needed."""

    def load_extents(self):
        return compute(
            "volume_extents.comp", ("vec2(-INFINITE, greatest)", "vec2(-INFINITE, least)")
        )


class HiddenCastersCulled(ShadowVolumes):
    """A caster that is not seen itself casts nothing."""

    def load_extents(self):
        return compute(
            "volume_extents.comp", ("kept = least <= greatest", "kept = least <= range.y")
        )


class EditedCasters(ShadowVolumes):
    """Volumes with some faces missing."""

    def _upload(self):
        self.casters = self.changed(self.casters)
        super()._upload()


def _some(faces, kept):
    owner = np.repeat(np.arange(len(faces.offsets) - 1), np.diff(faces.offsets))
    counts = np.bincount(owner[kept], minlength=len(faces.offsets) - 1)
    return Faces(faces.indices[kept], np.concatenate([[0], np.cumsum(counts)]))


class NoDarkCap(EditedCasters):
    def changed(self, casters):
        dark = (casters.body.indices >= len(casters.caster)).all(axis=1)
        return replace(casters, body=_some(casters.body, ~dark))


class NoLightCapOfBackFaces(EditedCasters):
    def changed(self, casters):
        none = np.zeros(len(casters.caps_back.indices), np.bool_)
        return replace(casters, caps_back=_some(casters.caps_back, none))


class SilhouetteByParity(EditedCasters):
    """An edge of two sheets is inside, whichever way they fold: the rule for closed meshes."""

    def changed(self, casters):
        size = len(casters.caster)
        low = np.sort(casters.body.indices % size, axis=1)
        side = (casters.body.indices >= size).any(axis=1) & ~(casters.body.indices >= size).all(
            axis=1
        )
        edge = np.where(low[:, 0] == low[:, 1], low[:, 0] * size + low[:, 2],
                        low[:, 0] * size + low[:, 1])  # fmt: skip
        count = np.zeros(size * size, np.int64)
        np.add.at(count, edge[side], 1)
        # Two triangles a side: four where an edge keeps two.
        return replace(casters, body=_some(casters.body, ~(side & (count[edge] % 4 == 0))))


class OtherDepthTest(ShadowVolumes):
    """Faces are counted by another depth test."""

    depth_funcs: ClassVar[dict[str, str]]

    def draw_volumes(self, view, state):
        apply = self.device.apply

        def other(state):
            return apply(
                state._replace(depth_func=self.depth_funcs.get(state.depth_func, state.depth_func))
            )

        self.device.apply = other
        try:
            super().draw_volumes(view, state)
        finally:
            del self.device.apply


class CapsInFrontOfTheirSurface(OtherDepthTest):
    """A light cap at the visible surface's depth does not count as behind it: every lit surface
    shadows itself."""

    depth_funcs: ClassVar = {">=": ">"}


class CountedInFront(OtherDepthTest):
    """Faces before the surface are counted ("z-pass"), as if the eye were never in a volume."""

    depth_funcs: ClassVar = {">=": "<", ">": "<="}

    def read(self, target):
        return -super().read(target)
