"""Clamped shadow volumes with one step broken. They draw no set of objects: the verdict is that of
the image protocol."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from tests.mutants.harness import Suite, image_check, mutant
from tests.support.effect_scenes import eye_in_shadow, flat, no_solids, pedestals, shadow_verdict
from tests.support.shader_edits import edited
from visref_culling.gl.device import device
from visref_culling.n_buffer.gpu import NBufferTexture
from visref_culling.shadow_volumes import ShadowVolumes, closed
from visref_culling.shadow_volumes.casters import Faces
from visref_culling.shadow_volumes.litmaps import Litmaps

SUITE = Suite(
    {},
    says=("violation",),
    checks=[
        image_check("pedestals", lambda make: shadow_verdict(pedestals(2), make)),
        image_check("coarse", lambda make: shadow_verdict(pedestals(2, lexels=5), make)),
        image_check("flat", lambda make: shadow_verdict(flat(), make)),
        image_check("no_solids", lambda make: shadow_verdict(no_solids(), make)),
        image_check("eye_in_shadow", lambda make: shadow_verdict(eye_in_shadow(), make)),
    ],
)
VOLUMES = (SUITE.method("shadow-volumes", ShadowVolumes),)


def compute(shader, *changes):
    return device().context.compute_shader(edited(shader, *changes))


@mutant("S", of=VOLUMES, caught_by="flat")
class NoFootprint(ShadowVolumes):
    """Samples are points, and GL does not err."""

    def make_litmaps(self):
        class Points(Litmaps):
            def doubt(self, view, reach):
                return 0.0, 0.0, 0.0

        return Points(self.device, self.light)


@mutant("S", of=VOLUMES, caught_by="pedestals")
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


@mutant("S", of=VOLUMES, caught_by="pedestals")
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


@mutant("S", of=VOLUMES, caught_by="pedestals")
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


@mutant("S", of=VOLUMES, caught_by="pedestals")
class RectanglesRoundedInward(ShadowVolumes):
    def rectangles(self):
        low, high = self.casters.rectangle[:, :2], self.casters.rectangle[:, 2:]
        return np.concatenate([np.ceil(low), np.floor(high) - 1.0], axis=1).astype(np.int32)


@mutant("S", of=VOLUMES, caught_by="pedestals")
class RectanglesRoundedToNearest(ShadowVolumes):
    def rectangles(self):
        low, high = self.casters.rectangle[:, :2], self.casters.rectangle[:, 2:]
        return np.concatenate([np.rint(low), np.rint(high) - 1.0], axis=1).astype(np.int32)


@mutant("S", of=VOLUMES, caught_by="coarse")
class LastRowLeftOut(ShadowVolumes):
    def rectangles(self):
        return super().rectangles() - np.array([0, 0, 0, 1], np.int32)


@mutant("S", of=VOLUMES, caught_by="pedestals")
class RowsFlipped(ShadowVolumes):
    def rectangles(self):
        x0, y0, x1, y1 = super().rectangles().T
        height = self.light.camera.height
        return np.stack([x0, height - 1 - y1, x1, height - 1 - y0], axis=1).astype(np.int32)


@mutant("S", of=VOLUMES, caught_by="pedestals")
class LightCapMovedVertexByVertex(ShadowVolumes):
    """The paper's rule: what is farther than the plane stays, what is nearer is projected."""

    def load_extents(self):
        return compute("volume_extents.comp", ("if (range.y <= least)", "if (true)"))


@mutant("S", of=VOLUMES, caught_by="pedestals")
class DarkPlaneAtTheNearest(ShadowVolumes):
    """The volume ends where it begins to be needed."""

    def load_extents(self):
        return compute(
            "volume_extents.comp", ("vec2(-INFINITE, greatest)", "vec2(-INFINITE, least)")
        )


@mutant("S", of=VOLUMES, caught_by="pedestals")
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


@mutant("S", of=VOLUMES, caught_by="pedestals")
class NoDarkCap(EditedCasters):
    def changed(self, casters):
        dark = (casters.body.indices >= len(casters.caster)).all(axis=1)
        return replace(casters, body=_some(casters.body, ~dark))


@mutant("S", of=VOLUMES, caught_by="pedestals")
class NoLightCapOfBackFaces(EditedCasters):
    def changed(self, casters):
        none = np.zeros(len(casters.caps_back.indices), np.bool_)
        return replace(casters, caps_back=_some(casters.caps_back, none))


@mutant("S", of=VOLUMES, caught_by="pedestals")
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


class TakenForSolids(ShadowVolumes):
    """Other triangles than those of solids cast by their lit faces alone."""

    def __init__(self, scene, light):
        with pytest.MonkeyPatch.context() as patched:
            self.patch(patched)
            super().__init__(scene, light)

    def patch(self, patched):
        raise NotImplementedError


@mutant("S", of=VOLUMES, caught_by="no_solids")
class RimsAreNoRims(TakenForSolids):
    """A box without its top is a solid: what is lit through the hole casts nothing."""

    def patch(self, patched):
        connected = closed._connected

        def rimless(triangles, points):
            part, found = connected(triangles, points)
            return part, np.ones_like(found)

        patched.setattr(closed, "_connected", rimless)


@mutant("S", of=VOLUMES, caught_by="no_solids")
class SolidsInsideOut(TakenForSolids):
    """A solid whose triangles face inward is one: its far side casts, and the near one not."""

    def patch(self, patched):
        patched.setattr(closed, "_outward", lambda points, triangles, part, parts: True)


@mutant("S", of=VOLUMES, caught_by="no_solids")
class SolidsThatCrossThemselves(TakenForSolids):
    """Edges alone make a solid: where one is inside out it is left before it is entered."""

    def patch(self, patched):
        patched.setattr(closed, "_embedded", lambda *_: True)


@mutant("S", of=VOLUMES, caught_by="pedestals")
class UnlitSidesNeedNoShading(ShadowVolumes):
    """What is seen from its unlit side takes part in no litmap, and is left to the volumes."""

    def frame(self, camera, **how):
        found = super().frame(camera, **how)
        return replace(found, unlit=np.zeros_like(found.unlit))


@mutant("S", of=VOLUMES, caught_by="pedestals")
class LitSidesMarked(ShadowVolumes):
    """The sides are exchanged: what could receive a shadow is in no litmap."""

    def mark_unlit(self, view, target):
        self.lit_arrays.reverse()
        super().mark_unlit(view, target)
        self.lit_arrays.reverse()


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


@mutant("S", of=VOLUMES, caught_by="pedestals")
class CapsInFrontOfTheirSurface(OtherDepthTest):
    """A light cap at the visible surface's depth does not count as behind it: every lit surface
    shadows itself."""

    depth_funcs: ClassVar = {">=": ">"}


@mutant("S", of=VOLUMES, caught_by="eye_in_shadow")
class CountedInFront(OtherDepthTest):
    """Faces before the surface are counted ("z-pass"), as if the eye were never in a volume."""

    depth_funcs: ClassVar = {">=": "<", ">": "<="}

    def read(self, target):
        return -super().read(target)
