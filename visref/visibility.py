"""What is visible: the visibility buffer, a frame's truth, and the witness behind a claim."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.scene import Float64, Int32, Int64, Scene

BACKGROUND = -1
NO_SAMPLE = -1


@dataclass(frozen=True, eq=False)
class VisibilityBuffer:
    """Per sample the triangle that owns it, and its depth.

    `triangle`: (height, width) int32, `BACKGROUND` where nothing is hit.
    `depth`: (height, width) float64, view depth, inf where nothing is hit.
    """

    triangle: Int32
    depth: Float64


@dataclass(frozen=True, eq=False)
class Ties:
    """Further triangles at exactly the owner's depth: (k,) arrays, sorted by sample, triangle.

    `sample` int64 (flat index y * width + x), `triangle` int32. The owner itself is in the
    visibility buffer and not repeated here; triangles of the owner's own object are listed
    too, because units may cut an object.
    """

    sample: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    triangle: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))


@dataclass(frozen=True, eq=False)
class BlendVisibility:
    """BLEND objects seen before the nearest opaque hit: (k,) arrays, sorted by object.

    `object` int32, `pixels` int64 (decided samples at which it is seen and owns nothing
    anyway), and its nearest witness: `sample` int64, `triangle` int32, `depth` float64.
    """

    object: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))
    pixels: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    sample: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    triangle: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))
    depth: Float64 = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, eq=False)
class ObjectVisibility:
    """A frame by object: (n,) arrays over all objects of the scene.

    `pixels` int64: samples owned, a tied sample counted for every object tied there.
    `alone` int64: samples owned with no other object tied. `sample` int64: one owned sample
    (flat index; owned alone if there is such), `NO_SAMPLE` if none. `depth` float64: view
    depth at that sample. `nearest` float64: the least depth of all its samples, inf if none.
    `owned`: how many decided samples anything owns, each counted once.
    """

    pixels: Int64
    alone: Int64
    sample: Int64
    depth: Float64
    nearest: Float64
    owned: int

    @property
    def visible(self) -> NDArray[np.bool_]:
        return self.pixels > 0


@dataclass(frozen=True, eq=False)
class FrameTruth:
    """Who owns which samples of one frame, as one engine sees it.

    `ties_complete` says that `ties` lists every tie (an exact engine's promise; a ray
    engine lists none). `undecided`: (k,) int64, sorted flat indices of samples where an
    alpha-masked triangle lies at or before the owner; they neither clear nor convict.
    `masked`: int32, ascending, the objects whose masked triangles those are.
    The arrays may belong to the engine and change with its next frame; `copy` them to keep.
    """

    camera: Camera
    engine: str
    buffer: VisibilityBuffer
    ties: Ties = field(default_factory=Ties)
    ties_complete: bool = False
    undecided: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    masked: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))
    blend: BlendVisibility = field(default_factory=BlendVisibility)

    def copy(self) -> FrameTruth:
        """A truth that owns its arrays."""
        buffer = VisibilityBuffer(self.buffer.triangle.copy(), self.buffer.depth.copy())
        return replace(self, buffer=buffer)

    @cached_property
    def decided(self) -> NDArray[np.bool_]:
        """(height * width,) bool, False at the undecided samples."""
        result = np.ones(self.camera.samples, np.bool_)
        result[self.undecided] = False
        return result


@dataclass(frozen=True)
class Witness:
    """The sample that proves a claim; with the run folder alone anyone can replay it.

    `depth` is view depth in world units. `margin_px` is how far (in pixels) and
    `margin_depth` how much (relative depth) the sample may move before the claim would fail;
    None where they were not computed.
    """

    frame: int
    x: int
    y: int
    object: int
    object_name: str
    triangle: int
    depth: float
    margin_px: float | None = None
    margin_depth: float | None = None


def objects_seen(truth: FrameTruth, scene: Scene) -> ObjectVisibility:
    """Gather a frame by object. Undecided samples are left out; BLEND objects are counted
    in `pixels` too, by `truth.blend`, since they never own a sample."""
    from visref import kernels

    count = scene.object_count
    depth = truth.buffer.depth.reshape(-1)
    pixels, alone = np.zeros(count, np.int64), np.zeros(count, np.int64)
    sample, tied_sample = np.full((2, count), NO_SAMPLE, np.int64)
    nearest = np.full(count, np.inf)
    kernels.gather_objects(
        truth.buffer.triangle.reshape(-1),
        depth,
        truth.decided,
        truth.ties.sample,
        truth.ties.triangle,
        scene.object_of_triangle,
        pixels,
        alone,
        sample,
        tied_sample,
        nearest,
    )
    never_alone = sample < 0
    sample[never_alone] = tied_sample[never_alone]
    seen = sample >= 0
    at = np.full(count, np.inf)
    at[seen] = depth[sample[seen]]
    blend = truth.blend
    fresh = ~seen[blend.object]
    pixels[blend.object] += blend.pixels
    alone[blend.object] += blend.pixels
    sample[blend.object[fresh]] = blend.sample[fresh]
    at[blend.object[fresh]] = blend.depth[fresh]
    np.minimum.at(nearest, blend.object, blend.depth)
    owner = truth.buffer.triangle.reshape(-1)
    owned = np.count_nonzero(owner >= 0) - np.count_nonzero(owner[truth.undecided] >= 0)
    return ObjectVisibility(pixels, alone, sample, at, nearest, int(owned))
