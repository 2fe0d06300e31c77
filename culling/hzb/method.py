"""Occlusion culling with a hierarchical z-buffer on the GPU.

N. Greene, M. Kass, G. Miller: Hierarchical Z-buffer Visibility. SIGGRAPH 1993: the pyramid.
U. Haar, S. Aaltonen: GPU-Driven Rendering Pipelines. SIGGRAPH 2015, Advances in Real-Time Rendering
in Games: in two passes on the GPU, which Bevy, niagara and Nanite do too.

In two passes, first what is likely to be visible is drawn: what the last frame saw
(`first=set`), or what the last frame's pyramid does not hide, looked up from where its camera
stood (`first=pyramid`). A pyramid is built of that depth; then all other units are looked up in
it, and what it does not hide is drawn. What is drawn first is a choice of occluders, drawn with
this frame's camera where they are in it: neither a cut nor anything that moves makes it unsafe.

`last-frame-hzb` ends after the first of the two, as many engines do: what the last frame's pyramid
hides is not drawn. What has come into view since is late by a frame: it is approximate, and says
so.

- `units=meshlets`: what is looked up and drawn is not objects but small parts of them
  (`hzb.meshlets`), and what faces away is left out before any lookup, by a cone around the normals
  of each (`hzb.cones`); `cones=false` does without.
- `texels=4`: the finest level where a rectangle meets 2 x 2 texels; `texels=1`: where it lies in
  one.
- `projection=sphere`: the rectangle and the depth of a sphere around the box (M. Mara, M. McGuire:
  2D Polyhedral Bounds of a Clipped, Perspective-Projected 3D Sphere. JCGT 2(2), 2013: their bounds
  in x and y), larger than the box's.

Departures:

- The units are the scene's objects unless meshlets are asked for.
- Depth is 0 at near and 1 at far, and the pyramid keeps the farthest; engines mostly reverse that.
- Level 0 has the image's size, each other half of it, rounded down; the last texel of an odd row
  holds three.
- A box's depth and rectangle come from the inflated box (`boxes.conservative`), in double
  precision, and depths that compare equal are visible. A box across the near plane is visible
  without a lookup, and so is one that reaches out of the image that the last frame saw.
- What a frame with nothing to look back to (the first, or after a cut) draws by the last frame's
  pyramid is all that is in the frustum.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from visref.camera import Camera
from visref.culler import Option, Promise
from visref.errors import InputError
from visref.scene import Float64, Int64, Scene, Units
from visref_culling.gl.changes import Changes, taken
from visref_culling.hzb.cones import cones_of
from visref_culling.hzb.cull import MOST_TEXELS, Lookup, PyramidCull
from visref_culling.hzb.meshlets import meshlets_of
from visref_culling.method import GL_OPTIONS, Frame, GLCuller

LOOKUP_OPTIONS: dict[str, Option] = {
    "texels": Option(MOST_TEXELS, "texels over a box's rectangle", (MOST_TEXELS, 1)),
    "projection": Option("box", "the box itself, or a sphere around it", ("box", "sphere")),
}


class TwoPassHZB(GLCuller):
    """Likely occluders first, and then what their pyramid of depth does not hide."""

    name = "two-pass-hzb"
    summary = (
        "Haar and Aaltonen 2015: a depth pyramid of what was visible, then the rest, on the GPU"
    )
    options: ClassVar[Mapping[str, Option]] = {
        "first": Option("set", "first, what was seen or what was not hidden", ("set", "pyramid")),
        "units": Option("objects", "decide about objects or meshlets", ("objects", "meshlets")),
        "cones": Option(True, "leave out meshlets all of whose triangles face away"),
        **LOOKUP_OPTIONS,
        **GL_OPTIONS,
    }

    notes_asked = True
    twice = True
    pyramid_cull: type[PyramidCull] = PyramidCull

    def __init__(
        self,
        *,
        first: str = "set",
        units: str = "objects",
        cones: bool = True,
        texels: int = MOST_TEXELS,
        projection: str = "box",
        depth: int = 24,
        fragments: bool = False,
    ) -> None:
        super().__init__(depth=depth, fragments=fragments)
        self.by_meshlets = units == "meshlets"
        if not self.by_meshlets and not cones:
            raise InputError("only meshlets have cones", place="cones", fix="leave cones out")
        self.with_cones = self.by_meshlets and cones
        self.cones: Float64 | None = None
        self.by_set = first == "set"
        self.lookup = Lookup(texels, projection == "sphere")
        self.gpu: PyramidCull | None = None

    def prepare(self, scene: Scene) -> Units:
        units = super().prepare(scene)
        assert self.geometry is not None
        self.cones = self.cones_of(scene, units) if self.with_cones else None
        self.gpu = self.pyramid_cull(
            self.device,
            self.geometry,
            self.unit_boxes,
            # Commands on the GPU draw no masked occluder.
            self.units_with(self.occluders(scene)),
            lookup=self.lookup,
            by_set=self.by_set,
            twice=self.twice,
            cones=self.cones,
        )
        return units

    def units_of(self, scene: Scene) -> Units:
        return meshlets_of(scene) if self.by_meshlets else super().units_of(scene)

    def cones_of(self, scene: Scene, units: Units) -> Float64:
        """(u, 9) float64: the units' cones (`hzb.cones`)."""
        return cones_of(scene, units)

    def moved_cones(self, units: Int64) -> Float64:
        """(u, 9) float64: all units' cones as the scene stands now; those of `units`, (k,) ids,
        alone have changed."""
        assert self.cones is not None
        cones = self.cones.copy()
        cones[units] = self.cones_of(self.scene, taken(self.units, units))
        return cones

    def follow(self, changes: Changes) -> None:
        super().follow(changes)
        if self.gpu is not None:
            units = changes.units(self.units)
            self.gpu.move(self.unit_boxes, units)
            if self.cones is not None:
                self.cones = self.moved_cones(units)
                self.gpu.move_cones(self.cones, units)

    def _release(self) -> None:
        super()._release()
        if self.gpu is not None:
            self.gpu.release()
            self.gpu = None

    def begin(self, camera: Camera) -> Frame:
        # Nothing is sorted or culled here.
        return self.open(camera)

    def decide(self, frame: Frame) -> None:
        assert self.gpu is not None
        decided = self.gpu.frame(frame.view, frame.target, frame.stats)
        if not self.twice:
            frame.note_asked(decided.asked)
        frame.drawn.append(decided.occluders)
        if self.twice:
            frame.note_asked(decided.asked)
        frame.drawn.append(decided.others)


class LastFrameHZB(TwoPassHZB):
    """What the last frame's pyramid of depth does not hide, and no more."""

    name = "last-frame-hzb"
    summary = "a depth pyramid of the last frame alone, as many engines have it, on the GPU"
    promise = Promise.APPROXIMATE
    options: ClassVar[Mapping[str, Option]] = {**LOOKUP_OPTIONS, **GL_OPTIONS}

    twice = False

    def __init__(
        self,
        *,
        texels: int = MOST_TEXELS,
        projection: str = "box",
        depth: int = 24,
        fragments: bool = False,
    ) -> None:
        super().__init__(
            first="pyramid", texels=texels, projection=projection, depth=depth, fragments=fragments
        )
