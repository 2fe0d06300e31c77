"""Deliberately broken cullers: each breaks one step of a sound method, in a few lines.

    @mutant("G9", of=QUERIES, caught_by="objects_of_one_sample")
    class ThresholdAboveOneSample:
        "A box of a single passing sample counts as hidden."

        def passes(self, samples):
            return samples > 1

makes a mutant of each method in `QUERIES` by putting the class before the method's own. Which
oracle catches it:

- `caught_by` names a check of `visref.conformance`: the verdict convicts it there (unsafe, U).
- `contract` names a checker of `tests/mutants/contracts.py`: the picture stays right and the
  promised saving is lost (wasteful, W).
- an entry of `EQUIVALENT` says why a mutant changes nothing that can be observed, one of
  `NOT_HERE` why a method has no such step.

`tests/mutants/test_mutants.py` holds that each is caught, that the sound method passes the same,
and that every mutant of the lists below is accounted for, for every method.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.support.toy_culler import ToyCuller
from visref.culler import Culler
from visref_culling.baselines import SingleQueryCulling
from visref_culling.gl.device import Target
from visref_culling.method import GLCuller

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
}


@dataclass(frozen=True)
class Method:
    """A sound method that mutants are made of: its class and the options it runs with."""

    name: str
    culler: type[Culler]
    options: dict[str, Any] = field(default_factory=dict)

    def make(self) -> Culler:
        return self.culler(**self.options)

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Mutant:
    """A broken culler, the sound method it comes from, and what catches it."""

    id: str
    about: str
    method: Method
    culler: type[Culler]
    caught_by: str
    contract: str
    options: dict[str, Any]

    def make(self) -> Culler:
        return self.culler(**self.options)

    def __str__(self) -> str:
        return f"{self.id}-{self.culler.__name__}-{self.method.name}"


MUTANTS: list[Mutant] = []

# The steps broken in COMMON's mutants, for `common` to try on further methods.
_STEPS: dict[str, list[tuple[type, str, dict[str, Any]]]] = {}

# (id, method's name) -> the reason.
EQUIVALENT: dict[tuple[str, str], str] = {}
NOT_HERE: dict[tuple[str, str], str] = {}


Step = Callable[[type], type]


def registrar(mutants: list[Mutant]) -> Callable[..., Step]:
    """A decorator that puts mutants into a list, to be used as `mutant` is."""

    def mutant(
        id: str, *, of: tuple[Method, ...], caught_by: str = "", contract: str = "", **options: Any
    ) -> Step:
        """Register the class below as a mutant of these methods. `options` change the method's."""
        if bool(caught_by) == bool(contract):
            raise ValueError("a mutant is caught by the verdict or by a contract")

        def register(step: type) -> type:
            for method in of:
                broken = type(step.__name__, (step, method.culler), {"__doc__": step.__doc__})
                about = " ".join((step.__doc__ or "").split())
                values = {**method.options, **options}
                mutants.append(Mutant(id, about, method, broken, caught_by, contract, values))
            return step

        return register

    return mutant


def mutant(
    id: str, *, of: tuple[Method, ...], caught_by: str = "", contract: str = "", **options: Any
) -> Step:
    """Register a mutant in MUTANTS; a step of a GL method may serve `common` again."""
    enlist = registrar(MUTANTS)(id, of=of, caught_by=caught_by, contract=contract, **options)

    def register(step: type) -> type:
        gl = any(issubclass(method.culler, GLCuller) for method in of)
        if gl and step not in [known for known, _, _ in _STEPS.get(id, [])]:
            _STEPS.setdefault(id, []).append((step, caught_by, options))
        return enlist(step)

    return register


def common(ids: str, of: tuple[Method, ...]) -> None:
    """Try the steps broken for GL queries in these of COMMON's mutants on more methods."""
    for id in ids.split():
        for step, caught_by, options in _STEPS[id]:
            mutant(id, of=of, caught_by=caught_by, **options)(step)


def not_here(ids: str, of: tuple[Method, ...], reason: str) -> None:
    """Say why these methods have no such step."""
    NOT_HERE.update({(id, method.name): reason for id in ids.split() for method in of})


# Methods.

SINGLE = Method("occlusion-query", SingleQueryCulling)
BATCH = Method("occlusion-query-batch", SingleQueryCulling, {"query": "batch", "size": 8})
INSTANCED = Method(
    "occlusion-query-instanced", SingleQueryCulling, {"query": "instanced", "size": 8}
)
TOY = (Method("toy", ToyCuller),)
COARSE_TOY = (Method("toy-texel", ToyCuller, {"texel": 4}),)
QUERIES = (SINGLE, BATCH, INSTANCED)
COMMON_METHODS = (*QUERIES, *TOY)


# Any occlusion query on GL.


@mutant("G2", of=QUERIES, caught_by="eye_inside_an_object")
class QueryWithTheEyeInside:
    """The box is asked even where the eye is in it; its front faces lie behind the eye."""

    def needs_no_query(self, view, boxes):
        return np.zeros(len(boxes), bool)


@mutant("G9", of=QUERIES, caught_by="objects_of_one_sample")
class ThresholdAboveOneSample:
    """A box of a single passing sample counts as hidden."""

    def passes(self, samples):
        return samples > 1


@mutant("G10", of=QUERIES, caught_by="rotated_and_mirrored_plates")
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


@mutant("G10", of=QUERIES, caught_by="walk_through_a_city")
class MirroredCornersUnsorted:
    """A negative scale swaps least and greatest corner, and nobody puts them in order."""

    def unit_bounds(self, scene, units):
        bounds = super().unit_bounds(scene, units)
        bounds[::2, :, 0] = bounds[::2, ::-1, 0]
        return bounds


@mutant("G12", of=QUERIES, caught_by="peeking_by_a_pixel")
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


@mutant("G13", of=QUERIES, caught_by="glass")
class GlassOccludes:
    """Every triangle writes depth, the transparent ones too."""

    def occluders(self, scene):
        return np.ones(scene.triangle_count, bool)


@mutant("G14", of=QUERIES, caught_by="stacks_of_sheets")
class UnfinishedQueryReadAsZero:
    """The last query sent has no answer yet, and is taken to say zero."""

    def passes(self, samples):
        ready = samples.copy()
        ready[-1:] = 0
        return super().passes(ready)


not_here(
    "G1 G3 G4 G5 G6 G7",
    QUERIES,
    "the rasteriser projects and rounds the box and compares the depths: nothing is tested, "
    "and nothing read back, on the CPU",
)
not_here("G8", QUERIES, "an object's own depth is not there when its box is asked")
not_here("G11", QUERIES, "nothing is kept from one frame to the next")


# A rectangle and a depth tested on the CPU.


@mutant("G1", of=TOY, caught_by="object_crossing_the_near_plane")
class CornersBehindTheEye:
    """Corners are projected whatever their sign, and depth is taken from those in front."""

    def sure(self, camera, corners):
        return False

    def nearest(self, camera, corners):
        depth = camera.pixel_of(corners)[1]
        return depth[depth > 0.0].min(initial=np.inf)


@mutant("G3", of=COARSE_TOY, caught_by="crowd")
class RectangleRoundedToNearest:
    """The rectangle's sides are rounded to the nearest texel."""

    def texels(self, pixels):
        low, high = round(pixels.start / self.texel), round(pixels.stop / self.texel)
        return slice(low, max(high, low + 1))


EQUIVALENT["G3", "toy"] = (
    "with texels of one pixel the rounded rectangle holds exactly the pixels whose centres lie "
    "in the unrounded one, and no other sample can be the object's"
)


@mutant("low-resolution buffer", of=COARSE_TOY, caught_by="gap_narrower_than_a_texel")
class OneSampleForATexel:
    """A texel holds the depth of one of its pixels in place of the farthest."""

    def reduce(self, depth):
        return depth[:: self.texel, :: self.texel]


@mutant("G4", of=TOY, caught_by="rows_and_columns_at_the_border")
class LastColumnLeftOut:
    """The rectangle ends before its last row and column."""

    def rectangle(self, camera, corners):
        x, y = super().rectangle(camera, corners)
        return (
            slice(x.start, max(0, min(x.stop, camera.width) - 1)),
            slice(y.start, max(0, min(y.stop, camera.height) - 1)),
        )


@mutant("G4", of=TOY, caught_by="rolled_and_pitched_camera")
class RectangleUpsideDown:
    """y counts from the bottom in the rectangle and from the top in the depth buffer."""

    def rectangle(self, camera, corners):
        x, y = super().rectangle(camera, corners)
        return x, slice(max(0, camera.height - y.stop), max(0, camera.height - y.start))


@mutant("G5", of=TOY, caught_by="large_object_at_the_edge")
class EuclideanDistance:
    """The nearest corner's distance from the eye is compared with view depths."""

    def nearest(self, camera, corners):
        return np.linalg.norm(corners - camera.eye, axis=1).min()


@mutant("G6", of=TOY, caught_by="interpenetrating_objects")
class DepthOfTheCentre:
    """The box's centre stands for its nearest point."""

    def nearest(self, camera, corners):
        return camera.pixel_of(corners)[1].mean()


@mutant("G7", of=TOY, caught_by="posters_on_a_wall")
class DepthReadBackInBytes:
    """The depth buffer is read back as bytes of window depth, rounded to nearest."""

    steps = 255

    def read_back(self, camera, depth):
        far = min(camera.far, 1e6)
        window = (1.0 / camera.near - 1.0 / depth) / (1.0 / camera.near - 1.0 / far)
        read = np.rint(np.minimum(window, 1.0) * self.steps) / self.steps
        read = 1.0 / (1.0 / camera.near - read * (1.0 / camera.near - 1.0 / far))
        return np.where(np.isinf(depth), np.inf, read)


@mutant("G7", of=TOY, caught_by="posters_on_a_wall")
class DepthReadBackInSixteenBits(DepthReadBackInBytes):
    """The depth buffer is read back in 16 bits, rounded to nearest."""

    steps = 65535


@mutant("G9", of=TOY, caught_by="odd_viewports")
class ThresholdAboveOnePixel:
    """A rectangle that shows in a single pixel counts as hidden."""

    def passes(self, depth, nearest):
        return np.count_nonzero(depth >= nearest) > 1


@mutant("G10", of=TOY, caught_by="rolled_and_pitched_camera")
class TwoCornersProjected:
    """The rectangle is spanned by the projections of two opposite corners."""

    def rectangle(self, camera, corners):
        return super().rectangle(camera, corners[[0, 7]])


@mutant("G11", of=TOY, caught_by="fast_turn")
class DepthOfTheLastFrame:
    """The depth buffer of the frame before is tested with this frame's camera."""

    def empty_depth(self, camera):
        last = self.last_depth
        fits = last is not None and last.shape == (camera.height, camera.width)
        return last.copy() if fits else super().empty_depth(camera)


@mutant("G13", of=TOY, caught_by="glass")
class GlassWritesDepth:
    """Every triangle is rasterised into the depth buffer."""

    def occludes(self, triangles):
        return np.ones(len(triangles), bool)


not_here("G2", TOY, "no box is rasterised, so no face of one is culled")
not_here("G8", TOY, "an object's own depth is not there when its box is tested")
not_here("G12", TOY, "its depth buffer has one sample a pixel, the pixel's centre")
not_here("G14", TOY, "nothing is asked that could be unfinished")


def accounted_for(ids: dict[str, str], methods: tuple[Method, ...]) -> list[str]:
    """The (id, method) pairs that no mutant and no reason accounts for."""
    known = {(m.id, m.method.name) for m in MUTANTS} | set(EQUIVALENT) | set(NOT_HERE)
    pairs = itertools.product(ids, (method.name for method in methods))
    return [f"{id} of {name}" for id, name in pairs if (id, name) not in known]
