"""Three-pass culling with one step broken: the conservative mode, which the verdict convicts, and
the published one, which promises nothing and keeps contracts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.mutants.common import COMMON, GlassOccludes, common
from tests.mutants.harness import equivalent, mutant, not_here
from tests.mutants.three_pass.contract import SUITE
from visref_culling.gl.changes import taken
from visref_culling.gl.geometry import Geometry
from visref_culling.queries.mesh_query import ask_meshes
from visref_culling.three_pass import ThreePassCulling
from visref_culling.three_pass.method import PrePass
from visref_culling.three_pass.parts import parts_of
from visref_culling.three_pass.stand_ins import stand_ins


def conservative(name: str, **options):
    return SUITE.method(
        f"three-pass-{name}", ThreePassCulling, mode="conservative", reduction=1, **options
    )


# Objects that are asked themselves; boxes of their parts; the same in an image of a 4th the side.
WHOLE = conservative("whole")
BOXES = conservative("boxes", extra=0)
SMALL = conservative("small", extra=0, scale=4)
SAFE = (WHOLE, BOXES, SMALL)

# Tiles instead of objects.
TILED = conservative("tiles", extra=0, tile=8)

# The published mode, on meshes that it simplifies.
PUBLISHED = SUITE.method("three-pass-published", ThreePassCulling, reduction=4, extra=0)
SUITE.kept_by(PUBLISHED)
SUITE.kept_by(PUBLISHED, scale=4)
SUITE.kept_by(PUBLISHED, threshold=5)
SUITE.kept_by(PUBLISHED, reduction=10)

common("G2", of=(BOXES, SMALL))
common("G10", of=(BOXES, SMALL))
common("G12", of=(WHOLE, BOXES))
common("G13 G14 G15 M1 M2 M3 M4 M5", of=SAFE)
not_here("G2 G10", (WHOLE,), "no box is asked: an object is, with the faces that it is drawn with")
not_here("G12", (SMALL,), "its depth is the window's, read a pixel at a time")
not_here("G1 G5 G6", SAFE, "the rasteriser projects the boxes and compares the depths")
not_here("G3 G4 G7", (WHOLE, BOXES), "no rectangle is rounded, no depth copied or read back")
not_here("G11", SAFE, "nothing is kept from one frame to the next")
UNSAFE = [id for id in (*COMMON, *SUITE.ids) if not id.startswith("W") and id != "U3"]
not_here(" ".join(UNSAFE), (PUBLISHED,), "it promises nothing: what it leaves out is measured")
not_here(
    " ".join(id for id in (*COMMON, *SUITE.ids) if id not in ("U9", "W9", "W10", "W11", "W12")),
    (TILED,),
    "it is three-pass-boxes, with other units",
)
not_here("U9", SAFE, "objects are not divided")
not_here("W9 W10 W11 W12", (*SAFE, TILED), "the contracts are those of the published mode")


not_here("M6", (WHOLE,), "no box is asked: an object is, where it is")
not_here("M6", (SMALL,), "the boxes are those of three-pass-boxes, grown by a texel")


@mutant("M6", of=(BOXES,), caught_by="bending_reeds")
class BoxesOfJoints:
    """Boxes of the parts of what moves hold their middles, and not what is around them."""

    def follow(self, changes):
        super().follow(changes)
        parts = changes.units(self.parts)
        middle = self.part_bounds[parts].mean(axis=1, keepdims=True)
        self.part_bounds[parts] = middle + 0.25 * (self.part_bounds[parts] - middle)


@mutant("U1", of=(WHOLE,), caught_by="crowd")
@mutant("G8", of=(WHOLE,), caught_by="crowd")
class StrictlyNearer:
    """Pass two asks for less, and every object lies at its own depth."""

    def query_state(self, state):
        return super().query_state(state)._replace(depth_func="<")


equivalent(
    "U1 G8",
    (BOXES, SMALL),
    "an inflated box lies strictly before what it contains, by more than depth rounds",
)


@mutant("U2", of=(BOXES, SMALL), caught_by="stacks_of_sheets")
@mutant("U2", of=(WHOLE,), caught_by="torn_layers")
class DepthMaskLeftOn:
    """What is asked in pass two writes its depth, the boxes and the transparent slices too."""

    def query_state(self, state):
        return super().query_state(state)._replace(depth_write=True)


@mutant("U3", of=(PUBLISHED,), contract="third_pass_draws_on_empty_buffers")
class NotCleared:
    """Pass three finds the depth of the first."""

    def clear_again(self, frame):
        pass


equivalent(
    "U3",
    SAFE,
    "the first pass drew triangles of the scene itself, each of which is drawn again or lies "
    "behind what is: the picture is the same, bit for bit. The published mode's is not, and a "
    "contract sees that",
)


@mutant("U4", of=SAFE, caught_by="crowd")
class IndicesShifted:
    """Each object is decided by the stand-in of the next."""

    def answering(self, ids):
        return (super().answering(ids) + 1) % self.units.count


@mutant("U5", of=SAFE, caught_by="objects_of_one_sample")
@mutant("G9", of=SAFE, caught_by="objects_of_one_sample")
class ThresholdOffByOne:
    """A single sample is not enough."""

    def passes(self, samples):
        return samples > self.threshold + 1


mutant("U6", of=SAFE, caught_by="torn_layers")(GlassOccludes)


@mutant("U7", of=(SMALL,), caught_by="hole_of_a_pixel")
class AnotherAspect:
    """The small image has the window's field of view, and sides rounded to whole texels."""

    def small_camera(self, camera):
        small = super().small_camera(camera)
        return replace(
            camera,
            width=small.width,
            height=small.height,
            shift_x_px=camera.shift_x_px / self.scale,
            shift_y_px=camera.shift_y_px / self.scale,
        )


not_here("U7", (WHOLE, BOXES), "there is no smaller image")


@mutant("U8", of=(BOXES,), caught_by="torn_layers")
@mutant("U8", of=(SMALL,), caught_by="peeking_by_a_pixel")
class PartsOfCentroids:
    """A part's box holds its triangles' centroids."""

    def unit_bounds(self, scene, units):
        bounds = super().unit_bounds(scene, units)
        if units.kind == "part":
            centroids = scene.vertices[scene.triangles].mean(axis=1)
            for part in range(units.count):
                inside = centroids[units.gather([part])]
                bounds[part] = inside.min(axis=0), inside.max(axis=0)
        return bounds


@mutant("U8", of=(WHOLE,), caught_by="torn_layers")
class AskedAtLowResolution:
    """What is asked is the published stand-in, which shrinks."""

    def ask_objects(self, frame, places):
        low = stand_ins(self.scene, 10, 0)
        geometry = Geometry(self.device, low, low.object_units(), self.occluders(low))
        samples = ask_meshes(geometry, frame.view, frame.target, frame.ids[places], frame.stats)
        geometry.release()
        return self.passes(samples)


@mutant("U9", of=(TILED,), caught_by="torn_layers")
class TriangleIdsOfTheTiledScene:
    """The boxes are of what has these places in the scene as it came, and not in its tiles."""

    def parts_of(self, scene):
        return parts_of(self.tiled(scene), self.reduction)


@mutant("U9", of=(TILED,), caught_by="torn_layers")
class TilesInTheOrderOfTheirHalves:
    """Tiles are numbered from the last of each object, their proxies from the first."""

    def parts_of(self, scene):
        parts, first = super().parts_of(scene)
        order = np.arange(self.units.count)[::-1]
        kept = [np.arange(first[unit], first[unit + 1]) for unit in order]
        counts = np.diff(first)[order]
        return taken(parts, np.concatenate(kept)), np.concatenate([[0], np.cumsum(counts)])


# The smaller image.


@mutant("G3", of=(SMALL,), caught_by="crowd")
class BoxesNotGrown:
    """A box counts in the texels whose middles it covers."""

    def grown(self, view, boxes):
        return boxes


@mutant("G4", of=(SMALL,), caught_by="hole_of_a_pixel")
class LastTexelsLeftOut:
    """The small image has whole texels only."""

    def small_camera(self, camera):
        whole = replace(
            camera,
            width=max(camera.width - camera.width % self.scale, self.scale),
            height=max(camera.height - camera.height % self.scale, self.scale),
        )
        small = super().small_camera(camera)
        return replace(
            small,
            width=whole.width // self.scale,
            height=whole.height // self.scale,
            yfov=super().small_camera(whole).yfov,
        )


@mutant("G7", of=(SMALL,), caught_by="posters_on_a_wall")
class DepthCopiedInBytes:
    """The farthest depth is copied in 8 bits, and rounded to nearest."""

    def prepare(self, scene):
        self.farthest.copy_error = -0.5 / 255.0
        return super().prepare(scene)


@mutant("low-resolution buffer", of=(SMALL,), caught_by="gap_narrower_than_a_texel")
class SmallerViewport:
    """The occluders are drawn into the small image, a sample for a texel."""

    def fill_depth(self, frame, before):
        ids = frame.ids[self.inner_occluders(frame)]
        self.geometry.draw_depth(before.view, before.target, ids, frame.stats)


# Wasteful.


@mutant("W9", of=(PUBLISHED,), contract="stand_ins_have_the_reduction")
class HalfTheReduction:
    """Stand-ins have twice as many triangles as asked."""

    def stand_ins_of(self, scene):
        return stand_ins(scene, self.reduction // 2, self.extra)


@mutant("W10", of=(PUBLISHED,), contract="each_stand_in_is_drawn_once_and_asked_once")
class DrawnTwice:
    """Pass one draws all stand-ins twice."""

    def fill_depth(self, frame, before):
        super().fill_depth(frame, before)
        super().fill_depth(frame, before)


@mutant("W11", of=(PUBLISHED,), contract="pipeline_stalls_once")
class WaitsForEachQuery:
    """Each answer is waited for."""

    def ask(self, frame, before: PrePass):
        ids, frame_ids = frame.ids, frame.ids
        answers = []
        for unit in ids:
            frame.ids = np.array([unit])
            answers.append(super().ask(frame, before))
        frame.ids = frame_ids
        return np.concatenate([np.zeros(0, bool), *answers])


@mutant("W12", of=(PUBLISHED,), contract="only_what_shows_is_drawn")
class AnswersIgnored:
    """All is drawn in the third pass."""

    def ask(self, frame, before):
        return np.ones_like(super().ask(frame, before))
