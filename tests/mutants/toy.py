"""The toy of `tests/support/toy_culler.py` with one step broken: a rectangle and a depth that are
tested on the CPU."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.mutants.harness import Suite, equivalent, mutant, not_here
from tests.support.toy_culler import ToyCuller

SUITE = Suite({})
TOY = (SUITE.method("toy", ToyCuller),)
COARSE_TOY = (SUITE.method("toy-texel", ToyCuller, texel=4),)


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


equivalent(
    "G3",
    TOY,
    "with texels of one pixel the rounded rectangle holds exactly the pixels whose centres lie "
    "in the unrounded one, and no other sample can be the object's",
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
not_here(
    "G1 G2 G4 G5 G6 G7 G8 G9 G10 G11 G12 G13 G14 G15",
    COARSE_TOY,
    "it differs from the toy in its texels alone",
)


@mutant("G15", of=TOY, caught_by="cut_by_a_plane")
class ClipPlaneIgnored:
    """What is drawn fills the depth buffer whole, whatever the clip plane."""

    def rasterise(self, camera, unit, depth):
        super().rasterise(replace(camera, clip_plane=None), unit, depth)


not_here(
    "M1 M2 M3 M4 M5 M6",
    (*TOY, *COARSE_TOY),
    "it has no update(), so it is not asked about scenes that move",
)
