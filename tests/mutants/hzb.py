"""Culling by a pyramid of depth with one step of its shaders, or of its two passes, broken."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from tests.mutants.common import COMMON, common
from tests.mutants.harness import Suite, Trace, equivalent, mutant, not_here
from tests.mutants.n_buffer.contract import SLACK_DEPTH, rectangle_and_depth, window_depth
from tests.support.shader_edits import edited
from visref.camera_path import CameraPath, Frame
from visref.conformance.building import Mesh, panel, together
from visref.conformance.moving import about, moved
from visref.conformance.scenes import Case, case, pixel_panel
from visref.conformance.scenes import camera as camera_at
from visref_culling.hzb.cones import AXIS, COSINE, REACH, SINE
from visref_culling.hzb.cull import BY_THIS, SHADER, PyramidCull
from visref_culling.hzb.method import LastFrameHZB, TwoPassHZB
from visref_culling.hzb.pyramid import BASE, LEVEL, DepthPyramid

SUITE = Suite(
    {
        "U1": "the last row or column of an odd level left out",
        "U2": "depth fetched with bilinear filtering",
        "U3": "the last frame's matrix with this frame's pyramid",
        "U4": "a level too fine",
        "U5": "a sphere's rectangle about its centre, off to the side",
        "U6": "a box across the near plane clamped to it",
        "U7": "the reduction of reversed depth",
        "U8": "the second pass left out after a cut",
        "U9": "the second pass asks what was drawn, not what is in view",
        "W10": "a level too coarse",
        "W11": "what was drawn is remembered, not what was seen",
        "U12": "what the first pass finds hidden is not asked again",
        "U13": "the cone of the pose at rest",
        "U14": "a cone posed like a point, where what it belongs to is stretched",
        "U15": "a cone's planes all through its centre",
        "U16": "a cone no wider than its axis",
    },
    watched=("revealed_by_a_pierced_wall", "crowd", "peeking_by_a_pixel"),
    # Each camera stands for three frames: all is drawn, all is an occluder, what passed is drawn.
    cameras=lambda path: [camera for camera in path.cameras[:2] for _ in range(3)],
)

BOX = SUITE.method("two-pass-hzb", TwoPassHZB)
ONE = SUITE.method("two-pass-hzb-one", TwoPassHZB, texels=1)
SPHERE = SUITE.method("two-pass-hzb-sphere", TwoPassHZB, projection="sphere")
BY_PYRAMID = SUITE.method("two-pass-hzb-pyramid", TwoPassHZB, first="pyramid")
MESHLETS = SUITE.method("two-pass-hzb-meshlets", TwoPassHZB, units="meshlets")
LAST = SUITE.method("last-frame-hzb", LastFrameHZB)

BOXES = (BOX, ONE, BY_PYRAMID)
TWICE = (*BOXES, SPHERE)
BY_SET = (BOX, ONE, SPHERE)
PIERCED = "revealed_by_a_pierced_wall"
STRIP = "last_pixel_of_a_strip"

SUITE.kept_by(BOX)


@SUITE.scene("shows what faced away once it turns about")
def turnstile(rng: np.random.Generator) -> Case:
    """A one-sided panel with its back to the camera, which turns about and back again."""
    points, faces = panel((-1.0, 1.0), (-1.0, 1.0), -6.0)
    objects = [("panel", (points, faces[:, ::-1])), ("wall", panel((-4.0, 4.0), (-3.0, 3.0), -9.0))]
    angles = (0.0, 0.0, 0.6 * np.pi, np.pi, np.pi, 0.0)
    where = [{"panel": about((0.0, 0.0, -6.0), angle, axis=1)} for angle in angles]
    return _one_sided(objects, where)


@SUITE.scene("shows what is stretched across its normal")
def stretched(rng: np.random.Generator) -> Case:
    """A one-sided roof that leans at 45 degrees lies nearly flat once it is six times as wide."""
    middle = np.array([2.0, 0.0, -6.0])
    corners = [[0.5, -1, -0.5], [0.5, 1, -0.5], [-0.5, 1, 0.5], [-0.5, -1, 0.5]]
    roof = np.array([*corners, [0.05, 0, 0.05]])
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    wide = moved(*middle) @ np.diag([6.0, 1.0, 1.0, 1.0]) @ moved(*-middle)
    where = [{"roof": pose} for pose in (np.eye(4), np.eye(4), wide, wide)]
    return _one_sided([("roof", (roof + middle, faces))], where)


@SUITE.scene("shows the one of two parallel panels that it faces")
def treads(rng: np.random.Generator) -> Case:
    """One object of two panels that face up, one above the camera and one below it."""
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    tread = np.array([[-2.0, 0, -4], [2, 0, -4], [2, 0, -8], [-2, 0, -8]])
    up = np.array([0.0, 1.0, 0.0])
    both = together((tread + up, faces), (tread - up, faces))
    return case([("treads", both)], [camera_at((0.0, -0.2, 0.0))] * 2, one_sided=("treads",))


@SUITE.scene("shows the side of a roof that it faces, from behind the ridge")
def steep_roof(rng: np.random.Generator) -> Case:
    """A one-sided roof whose ridge points away from the camera, which stands far to its side."""
    points = np.array(
        [[-1.0, -1, 0], [-1, 1, 0], [0, -1, -1.7], [0, 1, -1.7], [1, -1, 0], [1, 1, 0]]
    )
    faces = np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
    view = camera_at((10.0, 0.0, 0.0), (0.0, 0.0, -6.0))
    return case([("roof", (points - [0, 0, 6], faces))], [view] * 2, one_sided=("roof",))


def _one_sided(objects: list[tuple[str, Mesh]], where: list[dict[str, Any]]) -> Case:
    """Objects of which the first is one-sided, posed in each frame."""
    frames = [Frame((camera_at(),), world_from_object=poses) for poses in where]
    scene = case(objects, [camera_at()], one_sided=(objects[0][0],)).scene
    return Case(scene, CameraPath(frames, "conformance"))


@SUITE.contract
def what_the_pyramid_hides_is_not_drawn(trace: Trace) -> Iterator[str]:
    """A box nearer than which all pixels of the 2 x 2 texels around its rectangle are is not drawn,
    in the finest level where these hold it, unless the frame before saw it: then it is drawn once,
    and forgotten."""
    drawn, before = set(trace.drawn), trace.before
    hidden_before = hidden_units(before) if before else set()
    drawn_before = set(before.drawn) if before else set()
    in_vain = drawn & hidden_units(trace) & (hidden_before | (drawn - drawn_before))
    yield from (f"unit {unit} is drawn" for unit in sorted(in_vain))


@lru_cache(maxsize=2)
def hidden_units(trace: Trace) -> set[int]:
    """The units that must be hidden by a frame's pyramid: called while it is there. Rectangles,
    depths and blocks of pixels are computed here, by hand."""
    scene, camera = trace.scene, trace.camera
    culler: Any = trace.culler
    depth = culler.gpu.past_of_view[camera.view].pyramid.read()[0]
    found = set()
    for unit in range(scene.object_count):
        at = rectangle_and_depth(scene, camera, unit)
        if at is None:
            continue
        nearest = float(window_depth(camera, np.array([at[1]]))[0])
        if nearest > _farthest_around(depth, at[0]) + SLACK_DEPTH:
            found.add(unit)
    return found


def _farthest_around(depth: np.ndarray, rectangle: list[int]) -> float:
    """Over blocks of pixels whose sides are powers of two, 2 x 2 of them at most; what an odd
    number leaves belongs to the last."""
    height, width = depth.shape
    low = np.maximum(rectangle[:2], 0)
    high = np.minimum(rectangle[2:], [width - 1, height - 1])
    if (low > high).any():
        return -1.0
    side = 1
    while True:
        blocks = np.maximum(np.array([width, height]) // side, 1)
        first, last = np.minimum(low // side, blocks - 1), np.minimum(high // side, blocks - 1)
        if (last - first < 2).all():
            break
        side *= 2
    end = np.where(last == blocks - 1, [width, height], (last + 1) * side)
    return float(depth[first[1] * side : end[1], first[0] * side : end[0]].max())


def shaders(name: str, about: str, *edits: tuple[str, str], of: str = SHADER) -> type:
    """A culler's step that edits the shader that tests boxes, or another `of` the pyramid's."""

    class Edited(DepthPyramid):
        def shader(self, name: str) -> Any:
            if name != of:
                return super().shader(name)
            return self.device.context.compute_shader(edited(of, *edits))

    class Cull(PyramidCull):
        def load(self) -> Any:
            if of != SHADER:
                return super().load()
            return self.device.context.compute_shader(edited(SHADER, *edits))

        pyramid_of = Edited

    return type(name, (), {"__doc__": about, "pyramid_cull": Cull})


_NEAR = "if (nearest <= growth.w) {\n        return true;\n    }"
_SHOWN = "return window_depth(nearest) <= double(hzb_farthest(r, side));"
_LEVEL_FOUND = "float depth = texelFetch(pyramid, first, level).x;"

mutant("G1", of=(BOX, ONE), caught_by="revealed_across_the_near_plane")(
    shaders(
        "CornersBehindTheEye",
        "Corners are projected whatever their sign, and depth is taken from the farthest.",
        (_NEAR, "nearest = nearest > growth.w ? nearest : most(depth_row.xyz);"),
    )
)
mutant("G4", of=BY_SET, caught_by=STRIP)(
    shaders(
        "LastColumnLeftOut",
        "The rectangle ends before its last column and row.",
        (
            "return ivec4(ivec2(first), ivec2(last));",
            "return ivec4(ivec2(first), max(ivec2(last) - 1, min(ivec2(first), ivec2(last))));",
        ),
    )
)
mutant("G5", of=(BOX, ONE), caught_by=PIERCED)(
    shaders(
        "EuclideanDistance",
        "The distance of the nearest point is compared.",
        (
            _SHOWN,
            f"nearest = length(max(max(low, -high), dvec3(0.0lf)));\n    {_SHOWN}",
        ),
    )
)
mutant("G6", of=BY_SET, caught_by="revealed_leaning_panels")(
    shaders(
        "DepthOfTheCentre",
        "The box's centre stands for its nearest point.",
        (_SHOWN, f"nearest = dot(depth_row.xyz, centre);\n    {_SHOWN}"),
    )
)
mutant("G7", of=(BOX,), caught_by=PIERCED)(
    shaders(
        "SixteenBits",
        "Depth enters the pyramid in 16 bits, rounded to nearest.",
        ("vec4(depth)", "vec4(round(depth * 65535.0) / 65535.0)"),
        of=BASE,
    )
)
mutant("G8", of=BOXES, caught_by="huge_depth_range")(
    shaders(
        "StrictAndUnshifted",
        "A box at its own object's depth is hidden.",
        ("0.5lf * (ndc - to_window.z) + 0.5lf", "0.5lf * ndc + 0.5lf"),
        ("window_depth(nearest) <= double(hzb_farthest(r, side))",
         "float(window_depth(nearest)) < hzb_farthest(r, side)"),
    )
)  # fmt: skip


@mutant("G11", of=(BY_PYRAMID,), caught_by="sliding_door")
@mutant("G11", of=BY_SET, caught_by=PIERCED)
class PyramidOfTheLastFrame:
    """The second pass looks into the pyramid of the frame before, with this frame's camera."""

    class pyramid_cull(PyramidCull):
        class pyramid_of(DepthPyramid):
            before = None

            def build(self, target):
                super().build(target)
                made = [level.tobytes() for level in self.read()]
                if self.before is not None:
                    for level, data in enumerate(self.before):
                        self.texture.write(data, level=level)
                self.before = made


mutant("U1", of=(BOX,), caught_by=PIERCED)(
    shaders(
        "OddRestLeftOut",
        "A level's texel holds 2 x 2 texels below, and the third of an odd number is lost.",
        ("last.x = at.x == size.x - 1 ? source.x - 1 : last.x;", ""),
        ("last.y = at.y == size.y - 1 ? source.y - 1 : last.y;", ""),
        of=LEVEL,
    )
)
mutant("U2", of=(BOX,), caught_by=PIERCED)(
    shaders(
        "BilinearDepth",
        "A level holds the mean of the texels below, as a filter gives it.",
        ("depth = max(depth, imageLoad(below, ivec2(x, y)).x);",
         "depth += imageLoad(below, ivec2(x, y)).x"
         " / float((last.x - first.x + 1) * (last.y - first.y + 1));"),
        of=LEVEL,
    )
)  # fmt: skip


@mutant("U3", of=BY_SET, caught_by="fast_turn")
class MatrixOfTheLastFrame:
    """The second pass asks from where the last frame's camera stood."""

    class pyramid_cull(PyramidCull):
        last = None

        def look_from(self, views):
            self.now, before = views[0], self.last or views[0]
            self.last = self.now
            super().look_from([views[0], *views[1:]])
            self.older = before

        def decide(self, step, past, camera):
            if step == BY_THIS:
                super().look_from([self.older, self.older])
            super().decide(step, past, camera)


mutant("U4", of=BY_SET, caught_by=PIERCED)(
    shaders(
        "LevelTooFine",
        "Four texels of the level below are looked up, which hold a part of the rectangle.",
        (_LEVEL_FOUND,
         "level = max(level - 1, 0);\n"
         "    first = min(r.xy >> level, max(size >> level, 1) - 1);\n"
         "    last = min(first + side - 1, max(size >> level, 1) - 1);\n"
         f"    {_LEVEL_FOUND}"),
    )
)  # fmt: skip
mutant("U5", of=(SPHERE,), caught_by="sides_of_a_cube")(
    shaders(
        "SphereAboutItsCentre",
        "The rectangle is the centre's projection, and the radius over the depth each way.",
        ("(q - root) / p", "(x - radius * length(a)) / w"),
        ("(q + root) / p", "(x + radius * length(a)) / w"),
    )
)
mutant("U6", of=(BOX, ONE), caught_by="revealed_across_the_near_plane")(
    shaders(
        "CornersBeforeNearLeftOut",
        "Of a box across the near plane the corners beyond it stand for all.",
        (_NEAR,
         "nearest = 1e300lf;\n"
         "    for (int corner = 0; corner < 8; corner++) {\n"
         "        double depth = corner_depth(corner);\n"
         "        nearest = depth > growth.w ? min(nearest, depth) : nearest;\n"
         "    }"),
        ("dvec2 at = corner_window(corner);",
         "if (corner_depth(corner) <= growth.w) {\n            continue;\n        }\n"
         "        dvec2 at = corner_window(corner);"),
        ("dvec4 box_window() {",
         "double corner_depth(int corner) {\n"
         "    return dot(depth_row.xyz, dvec3((corner & 1) == 0 ? low.x : high.x,\n"
         "        (corner & 2) == 0 ? low.y : high.y, (corner & 4) == 0 ? low.z : high.z));\n"
         "}\n\ndvec4 box_window() {"),
    )
)  # fmt: skip
mutant("U7", of=(BOX,), caught_by=PIERCED)(
    shaders(
        "NearestForFarthest",
        "A level holds the nearest depth, which is the farthest of a reversed one.",
        ("float depth = 0.0;", "float depth = 1.0;"),
        ("depth = max(depth, imageLoad", "depth = min(depth, imageLoad"),
        of=LEVEL,
    )
)


@mutant("U8", of=BY_SET, caught_by="jump_cuts")
class NoSecondPassAfterACut:
    """In a frame after a cut only what the last frame saw is drawn."""

    class pyramid_cull(PyramidCull):
        def frame(self, view, target, stats):
            self.twice = not view.camera.cut
            try:
                return super().frame(view, target, stats)
            finally:
                self.twice = True


mutant("U9", of=BY_SET, caught_by=PIERCED)(
    shaders(
        "OnlyWhatWasDrawn",
        "The second pass asks about what the first drew, to forget it.",
        ("bool visible = draw && shows();",
         "bool visible = draw && (drawn[unit] != 0u || (seen[unit] & 4u) == 0u) && shows();"),
        ("seen[unit] = uint(visible) | uint(looked_up) << 1;",
         "seen[unit] = uint(visible) | uint(looked_up) << 1 | 4u;"),
        ("seen[unit] & 1u) | uint(looked_up) << 1;", "seen[unit] & 5u) | uint(looked_up) << 1;"),
    )
)  # fmt: skip
mutant("U12", of=(BY_PYRAMID,), caught_by="sliding_door")(
    shaders(
        "FirstAnswerIsFinal",
        "What the last frame's pyramid hides is not asked about again.",
        ("draw = visible && drawn[unit] == 0u;", "draw = false;"),
    )
)
mutant("W10", of=(BOX,), contract="what_the_pyramid_hides_is_not_drawn")(
    shaders(
        "LevelTooCoarse",
        "The texels of three levels above are looked up.",
        (_LEVEL_FOUND,
         "level = min(level + 3, findMSB(max(size.x, size.y)));\n"
         "    first = min(r.xy >> level, max(size >> level, 1) - 1);\n"
         "    last = min(r.zw >> level, max(size >> level, 1) - 1);\n"
         f"    {_LEVEL_FOUND}"),
    )
)  # fmt: skip
mutant("W11", of=(BOX,), contract="what_the_pyramid_hides_is_not_drawn")(
    shaders(
        "DrawnIsRemembered",
        "What was drawn is drawn first in the next frame, whether it was seen or not.",
        ("seen[unit] = uint(visible) | uint(looked_up) << 1;",
         "seen[unit] = uint(visible || drawn[unit] != 0u) | uint(looked_up) << 1;"),
    )
)  # fmt: skip


@mutant("U13", of=(MESHLETS,), caught_by="turnstile")
class ConesAtRest:
    """Cones are those of the scene as it was met."""

    def moved_cones(self, units):
        return self.cones


@mutant("U14", of=(MESHLETS,), caught_by="stretched")
class ConesPosedLikePoints:
    """What takes an object's points from rest to where they are takes its cone's axis too."""

    def prepare(self, scene):
        self.at_rest = scene.vertices
        return super().prepare(scene)

    def cones_of(self, scene, units):
        found = super().cones_of(scene, units)
        if scene.vertices is self.at_rest:
            self.first = found
        return found

    def moved_cones(self, units):
        cones = super().moved_cones(units)
        for unit in units:
            vertices = self.scene.triangles[self.units.gather(np.array([unit]))].reshape(-1)
            rest, now = (v[vertices].astype(float) for v in (self.at_rest, self.scene.vertices))
            now_from_rest, *_ = np.linalg.lstsq(rest - rest[0], now - now[0])
            axis = self.first[unit, AXIS : AXIS + 3] @ now_from_rest
            cones[unit, AXIS : AXIS + 3] = axis / np.linalg.norm(axis)
            cones[unit, COSINE], cones[unit, SINE] = self.first[unit, [COSINE, SINE]]
        return cones


@mutant("U15", of=(MESHLETS,), caught_by="treads")
class ConesWithoutReach:
    """All planes are taken to go through the middle of the meshlet."""

    def cones_of(self, scene, units):
        cones = super().cones_of(scene, units)
        cones[:, REACH] = np.maximum(cones[:, REACH], 0.0)
        return cones


@mutant("U16", of=(MESHLETS,), caught_by="steep_roof")
class MeanNormalForAll:
    """The mean normal stands for all."""

    def cones_of(self, scene, units):
        cones = super().cones_of(scene, units)
        cones[:, COSINE], cones[:, SINE] = 1.0, 0.0
        return cones


common("G10", of=TWICE, caught_by="walk_through_a_city")
common("G13", of=BY_SET, caught_by="revealed_behind_glass")
common("G15 M1 M2 M3 M5 M6", of=(*TWICE, MESHLETS))
common("M4", of=(BOX, SPHERE))

not_here("G2", TWICE, "no box is rasterised, so no face of one is culled")
not_here("G9", TWICE, "no samples are counted")
not_here("G12", TWICE, "the depth that is looked up is the one of a single-sampled target")
not_here("G14", TWICE, "nothing is asked that could be unfinished")
not_here("G1 U6", (SPHERE,), "a sphere has no corners")
not_here("U5", BOXES, "there is no sphere")
not_here("U8 U9", (BY_PYRAMID,), "no set is remembered")
not_here("U12", BY_SET, "the first pass asks nothing")
not_here("G7 U1 U2 U7", (ONE, SPHERE, BY_PYRAMID), "the pyramid is two-pass-hzb's")
not_here("M4", (ONE, BY_PYRAMID), "what is drawn is the same as in two-pass-hzb")
not_here("G1 G4 G5 G6 G13 U3 U4 U6", (BY_PYRAMID,), "the second pass is the same as two-pass-hzb's")
not_here("W10 W11", (ONE, SPHERE, BY_PYRAMID), "the contract is two-pass-hzb's with four texels")
equivalent(
    "G3",
    TWICE,
    "in whole pixels, sides rounded to nearest hold exactly the pixels whose centres lie in the "
    "unrounded rectangle, and the box is inflated by more than a centre can be off",
)
equivalent(
    "G5",
    (SPHERE,),
    "the sphere's nearest point has no greater depth than distance, and its depth is compared: the "
    "distance of the box's nearest point exceeds that by less than the sphere's reach",
)
equivalent(
    "G8",
    (SPHERE,),
    "a sphere around a box lies before what is in the box by more than depth rounds",
)
CONES = "U13 U14 U15 U16"
not_here(CONES, TWICE, "objects have no cones")
tried = {made.id for made in SUITE.mutants if made.method is MESHLETS}
not_here(
    " ".join({*COMMON, *SUITE.ids} - tried),
    (MESHLETS,),
    "boxes of meshlets are looked up as two-pass-hzb's are",
)
UNSAFE = [id for id in (*COMMON, *SUITE.ids) if not id.startswith("W")]
not_here(" ".join(UNSAFE), (LAST,), "it promises nothing: what it leaves out is measured")
not_here("W10 W11", (LAST,), "nothing of it is tested again")


@SUITE.scene("shows a strip by its last pixel alone")
def last_pixel_of_a_strip(rng: np.random.Generator) -> Case:
    """Strips behind a wall with a hole of one pixel at the last pixel of each, where blocks of any
    side begin."""
    view = camera_at()
    objects = []
    holes = [(int(x), int(y)) for x, y in ((16, 12), (32, 20), (48, 36))]
    for k, (x, y) in enumerate(holes):
        objects.append((f"left{k}", pixel_panel(view, (-1.5, x - 0.5), (y - 0.5, y + 0.5), 5.0)))
        objects.append((f"right{k}", pixel_panel(view, (x + 0.5, 65.5), (y - 0.5, y + 0.5), 5.0)))
        objects.append(
            (f"strip{k}", pixel_panel(view, (x - 8.0, x + 0.05), (y - 0.1, y + 0.1), 60.0))
        )
    below = [-1.5, *(y + 0.5 for _, y in holes)]
    above = [*(y - 0.5 for _, y in holes), 49.5]
    for k, rows in enumerate(zip(below, above, strict=True)):
        objects.append((f"wall{k}", pixel_panel(view, (-1.5, 65.5), rows, 5.0)))
    return case(objects, [view] * 4)
