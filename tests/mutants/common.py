"""The mistakes that any method can make, broken once for the steps that methods on GL share.

`common("G2 G9", of=METHODS)` tries them on more methods; see `tests/mutants/harness.py`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from tests.mutants.harness import Method, Step, mutant
from visref_culling.gl.device import Target

# What can go wrong in any method; U is unsafe, W wasteful.
COMMON = {
    "G1": "U projects corners behind the eye (w <= 0)",
    "G2": "U back-face-culls the query box with the eye inside",
    "G3": "U rectangle rounded to nearest",
    "G4": "U last row or column left out, or y flipped",
    "G5": "U nearest corner by Euclidean distance, compared with depth",
    "G6": "U centre or far corner as nearest depth",
    "G7": "U depth read back at 8 or 16 bits, or rounded to nearest",
    "G8": "U strict depth test where the object's own depth is present",
    "G9": "U threshold above one sample",
    "G10": "U only two corners transformed (rotation, negative scale)",
    "G11": "U last frame's depth with this frame's camera",
    "G12": "U single-sample query against a multisampled image",
    "G13": "U transparent or alpha-cut surface as occluder",
    "G14": "U unfinished query read as zero",
    "G15": "U what a clip plane cuts off hides still",
    "M1": "U boxes of the pose at rest",
    "M2": "U boxes of the frame before",
    "M3": "U occluder depth at its old place",
    "M4": "U a removed object's depth kept",
    "M5": "U an object that appears has no entry",
    "M6": "U a box around joints, without the mesh's reach",
}


# Per id the steps that break it, each with a check that convicts it on most methods.
STEPS: dict[str, list[tuple[type, str]]] = {}


def common_step(id: str, *, caught_by: str) -> Step:
    """Register the class below as a mutant for `common`."""

    def register(step: type) -> type:
        STEPS.setdefault(id, []).append((step, caught_by))
        return step

    return register


def common(ids: str, of: Iterable[Method], *, caught_by: str = "", **options: Any) -> None:
    """Try these of COMMON's mutants on some methods; `caught_by` where it is another check."""
    for id in ids.split():
        for step, check in STEPS[id]:
            mutant(id, of=of, caught_by=caught_by or check, **options)(step)


@common_step("G2", caught_by="eye_inside_an_object")
class QueryWithTheEyeInside:
    """The box is asked even where the eye is in it; its front faces lie behind the eye."""

    def needs_no_query(self, view, boxes):
        return np.zeros(len(boxes), bool)


@common_step("G9", caught_by="objects_of_one_sample")
class ThresholdAboveOneSample:
    """A box of a single passing sample counts as hidden."""

    def passes(self, samples):
        return samples > 1


@common_step("G10", caught_by="rotated_and_mirrored_plates")
class TwoCornersTransformed:
    """The world box is spanned by two corners of a box in a frame turned by 45 degrees."""

    def unit_bounds(self, scene, units):
        half = math.sqrt(0.5)
        world_from_local = np.array([[half, -half, 0.0], [half, half, 0.0], [0.0, 0.0, 1.0]])
        result = super().unit_bounds(scene, units)
        for unit in np.flatnonzero(units.sizes):
            triangles = units.gather(np.array([unit]))
            local = scene.vertices[scene.triangles[triangles]].reshape(-1, 3) @ world_from_local
            corners = np.stack([local.min(axis=0), local.max(axis=0)]) @ world_from_local.T
            result[unit] = corners.min(axis=0), corners.max(axis=0)
        return result


@common_step("G10", caught_by="walk_through_a_city")
class MirroredCornersUnsorted:
    """A negative scale swaps least and greatest corner, and nobody puts them in order."""

    def unit_bounds(self, scene, units):
        bounds = super().unit_bounds(scene, units)
        bounds[::2, :, 0] = bounds[::2, ::-1, 0]
        return bounds


@common_step("G12", caught_by="peeking_by_a_pixel")
class ResolvedMultisamples:
    """The image has four samples a pixel; queries see one of them, resolved beforehand."""

    def target_for(self, camera):
        self.single = super().target_for(camera)
        context, size = self.device.context, (camera.width, camera.height)
        parts = [context.renderbuffer(size, 1, samples=4, dtype="f1")]
        parts.append(context.depth_renderbuffer(size, samples=4))
        framebuffer = context.framebuffer(parts[0], parts[1])
        return Target(framebuffer, framebuffer, self.depth_bits, self.single.depth)

    def query_state(self, state):
        self.device.context.copy_framebuffer(self.single.framebuffer, state.framebuffer)
        counting = state.colour_write
        single = self.single.scratch if counting else self.single.framebuffer
        return super().query_state(state)._replace(framebuffer=single)


@common_step("G13", caught_by="glass")
class GlassOccludes:
    """Every triangle writes depth, the transparent ones too."""

    def occluders(self, scene):
        return np.ones(scene.triangle_count, bool)


@common_step("G14", caught_by="stacks_of_sheets")
class UnfinishedQueryReadAsZero:
    """The last query sent has no answer yet, and is taken to say zero."""

    def passes(self, samples):
        ready = samples.copy()
        ready[-1:] = 0
        return super().passes(ready)


@common_step("G15", caught_by="cut_by_a_plane")
class ClipPlaneIgnored:
    """What is drawn is drawn whole, whatever the clip plane."""

    def view_of(self, camera):
        return super().view_of(replace(camera, clip_plane=None))


# What is not brought up to date in a scene that moves.


@common_step("M1", caught_by="carried_about")
class BoxesAtRest:
    """Boxes are those that things had when the scene was met."""

    def moved_bounds(self, units):
        return self.unit_boxes


@common_step("M2", caught_by="carried_about")
class BoxesOfTheFrameBefore:
    """Boxes are brought up to date a change late."""

    coming = None

    def moved_bounds(self, units):
        now = self.unit_bounds(self.scene, self.units)
        last, self.coming = self.coming, now
        return self.unit_boxes if last is None else last


@common_step("M3", caught_by="sliding_door")
class DepthAtItsOldPlace:
    """What is drawn, and so what hides, is moved a change late."""

    coming = None

    def move_geometry(self, changes):
        last, self.coming = self.coming, (self.scene, changes)
        if last is not None:
            self.geometry.update(*last)


@common_step("M4", caught_by="appearing_and_vanishing")
class RemovedObjectsDrawn:
    """What is absent keeps its triangles and its box, and hides others."""

    def follow(self, changes):
        there = self.scene.present
        stale = replace(
            changes, indices=changes.indices & there, triangles=changes.triangles & there
        )
        super().follow(stale)
        if self.raster is not None:
            self.raster.update(self.scene, changes)


@common_step("M5", caught_by="appearing_and_vanishing")
class NoEntryForWhatAppears:
    """What was absent when the scene was met has no box, then or later."""

    def moved_bounds(self, units):
        first = vars(self).setdefault("first_boxes", self.unit_boxes)
        now = super().moved_bounds(units)
        none = (first[:, 0] > first[:, 1]).any(axis=1)
        now[none] = first[none]
        return now


@common_step("M6", caught_by="bending_reeds")
class BoxesOfJoints:
    """Boxes of what moves hold its middle, where its joints are, and not what they carry."""

    def moved_bounds(self, units):
        now = super().moved_bounds(units)
        there = units[(now[units, 0] <= now[units, 1]).all(axis=1)]
        middle = now[there].mean(axis=1, keepdims=True)
        now[there] = middle + 0.25 * (now[there] - middle)
        return now
