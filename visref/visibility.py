"""What is visible: the visibility buffer, a frame's truth, and the witness behind a claim."""

from __future__ import annotations

from dataclasses import dataclass, field
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

    `object` int32, `pixels` int64 (samples at which it is seen), and one witness of each:
    `sample` int64, `triangle` int32, `depth` float64.
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
    """

    pixels: Int64
    alone: Int64
    sample: Int64
    depth: Float64
    nearest: Float64

    @property
    def visible(self) -> NDArray[np.bool_]:
        return self.pixels > 0


@dataclass(frozen=True, eq=False)
class FrameTruth:
    """Who owns which samples of one frame, as one engine sees it.

    `ties_complete` says that `ties` lists every tie (the exact engine's promise; a ray
    engine lists none). `undecided`: (k,) int64, sorted flat indices of samples where an
    alpha-masked triangle lies at or before the owner; they neither clear nor convict.
    The arrays may belong to the engine and change with its next frame; `copy` them to keep.
    """

    camera: Camera
    engine: str
    buffer: VisibilityBuffer
    ties: Ties = field(default_factory=Ties)
    ties_complete: bool = False
    undecided: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    blend: BlendVisibility = field(default_factory=BlendVisibility)

    def copy(self) -> FrameTruth:
        """A truth that owns its arrays."""
        buffer = VisibilityBuffer(self.buffer.triangle.copy(), self.buffer.depth.copy())
        return FrameTruth(
            self.camera,
            self.engine,
            buffer,
            self.ties,
            self.ties_complete,
            self.undecided,
            self.blend,
        )

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
    triangle = truth.buffer.triangle.reshape(-1)
    depth = truth.buffer.depth.reshape(-1)
    pixels = np.zeros(count, np.int64)
    sample = np.full(count, NO_SAMPLE, np.int64)
    nearest = np.full(count, np.inf)
    owners = scene.object_of_triangle
    kernels.gather_objects(triangle, depth, truth.decided, owners, pixels, sample, nearest)
    alone = pixels.copy()
    if len(truth.ties.sample):
        sample = _add_ties(truth, owners, pixels, alone, sample, nearest)
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
    return ObjectVisibility(pixels, alone, sample, at, nearest)


def _add_ties(
    truth: FrameTruth,
    owners: Int32,
    pixels: Int64,
    alone: Int64,
    sample: Int64,
    nearest: Float64,
) -> Int64:
    """Count tied samples for every object tied there; returns the witnesses, preferring
    samples owned alone. Changes `pixels`, `alone` and `nearest` in place."""
    triangle = truth.buffer.triangle.reshape(-1)
    depth = truth.buffer.depth.reshape(-1)
    keep = truth.decided[truth.ties.sample]
    at, other = truth.ties.sample[keep], owners[truth.ties.triangle[keep]].astype(np.int64)
    first = owners[triangle[at]].astype(np.int64)
    foreign = other != first
    pairs = np.unique(np.stack([at[foreign], other[foreign]], axis=1), axis=0)
    if not len(pairs):
        return sample
    shared = np.unique(pairs[:, 0])
    shared_owner = owners[triangle[shared]]
    np.add.at(pixels, pairs[:, 1], 1)
    np.subtract.at(alone, shared_owner, 1)
    np.minimum.at(nearest, pairs[:, 1], depth[pairs[:, 0]])
    # Witnesses: a sample owned alone where there is one, else the first tied sample.
    sample = sample.copy()
    unshared = np.ones(len(triangle), np.bool_)
    unshared[shared] = False
    for object_id in np.unique(shared_owner):
        if alone[object_id] > 0 and not unshared[sample[object_id]]:
            mine = np.flatnonzero((triangle >= 0) & truth.decided & unshared)
            owned = mine[owners[triangle[mine]] == object_id]
            sample[object_id] = owned[0]
    by_object = pairs[np.lexsort((pairs[:, 0], pairs[:, 1]))]
    ids, starts = np.unique(by_object[:, 1], return_index=True)
    unseen = sample[ids] < 0
    sample[ids[unseen]] = by_object[starts[unseen], 0]
    return sample
