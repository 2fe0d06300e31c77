"""What is visible: the visibility buffer, a frame's truth, and the witness behind a claim."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.scene import Float64, Int32, Int64, Scene

BACKGROUND = -1
NO_SAMPLE = -1


class DepthOf(Protocol):
    """Says at what view depth owners are seen."""

    def __call__(self, triangle: Int32, samples: Int64 | None) -> Float64:
        """(k,) float64 view depths of the owners `triangle`, (k,) int32, at the flat `samples`,
        (k,) int64, or at all of the image's where that is None; inf for `BACKGROUND`."""
        ...


class VisibilityBuffer:
    """Per sample the triangle that owns it, and its depth.

    `triangle`: (height, width) int32, `BACKGROUND` where nothing is hit.
    `depth`: (height, width) float64, view depth, inf where nothing is hit. An engine that finds
    owners without it gives a `DepthOf` instead, and depths are computed where somebody looks.
    """

    def __init__(self, triangle: Int32, depth: Float64 | DepthOf) -> None:
        self.triangle = triangle
        self._later = None if isinstance(depth, np.ndarray) else depth
        if isinstance(depth, np.ndarray):
            self.depth = depth

    @cached_property
    def depth(self) -> Float64:
        assert self._later is not None
        return self._later(self.triangle.reshape(-1), None).reshape(self.triangle.shape)

    def depth_at(self, samples: Int64) -> Float64:
        """(k,) float64, the view depth at some flat samples, (k,) int64."""
        if self._later is None or "depth" in self.__dict__:
            return self.depth.reshape(-1)[samples]
        return self._later(self.triangle.reshape(-1)[samples], samples)

    def copy(self) -> VisibilityBuffer:
        """The same in arrays of its own."""
        depth = self._later
        if depth is None or "depth" in self.__dict__:
            return VisibilityBuffer(self.triangle.copy(), self.depth.copy())
        return VisibilityBuffer(self.triangle.copy(), depth)

    def __getstate__(self) -> dict[str, Any]:
        # A process that gets it has no scene to compute depths from.
        return {"triangle": self.triangle, "depth": self.depth, "_later": None}


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
class Doubt:
    """Samples whose owner hangs on an alpha mask that is neither solid nor a hole there.

    `sample`: (k,) int64 flat indices, ascending. Before the sample's owner in the visibility
    buffer, which is its first certain hit (or the background), or level with it lie the
    triangles `triangle[offsets[i]:offsets[i + 1]]`, int32, at least one and front to back: any
    of them may be the one that is seen. `offsets`: (k + 1,) int64.
    """

    sample: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    offsets: Int64 = field(default_factory=lambda: np.zeros(1, np.int64))
    triangle: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))

    @classmethod
    def of(cls, sample: Int64, triangle: Int32) -> Doubt:
        """From hits, (h,) arrays sorted by sample, front to back within one."""
        samples, first = np.unique(sample, return_index=True)
        offsets = np.append(first, len(sample)).astype(np.int64)
        return cls(samples.astype(np.int64), offsets, triangle.astype(np.int32))

    def at(self) -> Int64:
        """(h,) int64, the sample of each of `triangle`."""
        return np.repeat(self.sample, np.diff(self.offsets))

    def __len__(self) -> int:
        return len(self.sample)


@dataclass(frozen=True, eq=False)
class BlendVisibility:
    """Where BLEND triangles are seen before the nearest opaque hit, at decided samples.

    (h,) arrays, a hit each, sorted by object, sample, depth, then triangle: `object` int32,
    `sample` int64 (flat index), `triangle` int32, `depth` float64 (view depth).
    """

    object: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))
    sample: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))
    triangle: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))
    depth: Float64 = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, scene: Scene, sample: Int64, triangle: Int32, depth: Float64) -> BlendVisibility:
        """From hits in any order: (h,) arrays, one entry per hit, as of the class."""
        objects = scene.object_of_triangle[triangle]
        order = np.lexsort((triangle, depth, sample, objects))
        return cls(objects[order], sample[order], triangle[order], depth[order])

    def where(self, kept: NDArray[np.bool_]) -> BlendVisibility:
        """Some of the hits, `kept` (h,) bool."""
        return BlendVisibility(
            self.object[kept], self.sample[kept], self.triangle[kept], self.depth[kept]
        )


@dataclass(frozen=True, eq=False)
class ObjectVisibility:
    """A frame by object: (n,) arrays over all objects of the scene.

    `samples` int64: samples owned, a tied sample counted for every object tied there.
    `alone` int64: samples owned with no other object tied. `sample` int64: one owned sample
    (flat index; owned alone if there is such), `NO_SAMPLE` if none. `depth` float64: view
    depth at that sample. `nearest` float64: the least depth of all its samples, inf if none.
    `owned`: how many decided samples anything owns, each counted once.
    """

    samples: Int64
    alone: Int64
    sample: Int64
    depth: Float64
    least: Float64 | Callable[[], Float64]
    owned: int

    @cached_property
    def nearest(self) -> Float64:
        """(n,) float64: the least view depth of all its samples, inf if none."""
        return self.least if isinstance(self.least, np.ndarray) else self.least()

    @property
    def pixels(self) -> Int64:
        """(n,) int64: `samples`, as it was called before."""
        return self.samples

    @property
    def visible(self) -> NDArray[np.bool_]:
        """(n,) bool, one per object: whether it has any sample."""
        return self.samples > 0


@dataclass(frozen=True, eq=False)
class FrameTruth:
    """Who owns which samples of one frame, as one engine sees it.

    `ties_complete` says that `ties` lists every tie (an exact engine's promise; a ray
    engine lists none). `doubt`: the samples that hang on an alpha mask. `veiled`: (k,) int32,
    further blended triangles that may be seen, because a mask leaves it open or the engine cannot
    tell; in any order.
    The arrays may belong to the engine and change with its next frame; `copy` them to keep.
    """

    camera: Camera
    engine: str
    buffer: VisibilityBuffer
    ties: Ties = field(default_factory=Ties)
    ties_complete: bool = False
    doubt: Doubt = field(default_factory=Doubt)
    blend: BlendVisibility = field(default_factory=BlendVisibility)
    veiled: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))

    def copy(self) -> FrameTruth:
        """A truth that owns its arrays."""
        return replace(self, buffer=self.buffer.copy())

    @property
    def undecided(self) -> Int64:
        """(k,) int64, ascending flat indices of the samples that hang on an alpha mask."""
        return self.doubt.sample

    @cached_property
    def decided(self) -> NDArray[np.bool_]:
        """(height * width,) bool, False at the undecided samples."""
        result = np.ones(self.camera.samples, np.bool_)
        result[self.undecided] = False
        return result


@dataclass(frozen=True)
class Witness:
    """The sample that proves a claim; with the run folder alone anyone can replay it.

    `depth` is view depth in world units. `margin_px` is how far (in pixels, told up to 16) and
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
    in `samples` too, by `truth.blend`, at samples that they do not own besides."""
    from visref import kernels

    count = scene.object_count
    samples, alone = np.zeros(count, np.int64), np.zeros(count, np.int64)
    sample, tied_sample = np.full((2, count), NO_SAMPLE, np.int64)
    owned = kernels.gather_objects(
        truth.buffer.triangle.reshape(-1),
        truth.undecided,
        truth.ties.sample,
        truth.ties.triangle,
        scene.object_of_triangle,
        scene.object_offsets,
        samples,
        alone,
        sample,
        tied_sample,
    )
    never_alone = sample < 0
    sample[never_alone] = tied_sample[never_alone]
    seen = sample >= 0
    at = np.full(count, np.inf)
    at[seen] = truth.buffer.depth_at(sample[seen])
    beside = blended_beside(truth, scene)
    _add_blended(beside, samples, alone, sample, at)

    def least() -> Float64:
        nearest = np.full(count, np.inf)
        kernels.nearest_of_objects(
            truth.buffer.triangle.reshape(-1),
            truth.buffer.depth.reshape(-1),
            truth.undecided,
            truth.ties.sample,
            truth.ties.triangle,
            scene.object_of_triangle,
            nearest,
        )
        np.minimum.at(nearest, beside.object, beside.depth)
        return nearest

    return ObjectVisibility(samples, alone, sample, at, least, int(owned))


def own_besides(truth: FrameTruth, scene: Scene) -> NDArray[np.bool_]:
    """(h,) bool, one per blended hit: whether its object owns or shares the sample besides, be it
    that a mask leaves that open."""
    blend, objects = truth.blend, scene.object_of_triangle
    owner = truth.buffer.triangle.reshape(-1)[blend.sample]
    own = (owner >= 0) & (objects[owner] == blend.object)
    count = scene.object_count
    tied = truth.ties.sample * count + objects[truth.ties.triangle]
    result: NDArray[np.bool_] = own | np.isin(blend.sample * count + blend.object, tied)
    return result


def blended_beside(truth: FrameTruth, scene: Scene) -> BlendVisibility:
    """The frame's blended hits at samples that their object does not own or share besides for
    certain: before a mask that leaves it open, the glass is what is seen of it."""
    if not len(truth.blend.object):
        return truth.blend
    return truth.blend.where(~(own_besides(truth, scene) & truth.decided[truth.blend.sample]))


def _add_blended(
    blend: BlendVisibility, samples: Int64, alone: Int64, sample: Int64, at: Float64
) -> None:
    if not len(blend.object):
        return
    # Hits are sorted by object and sample: each such pair counts once.
    first = np.ones(len(blend.object), np.bool_)
    first[1:] = (np.diff(blend.object) != 0) | (np.diff(blend.sample) != 0)
    seen = np.bincount(blend.object[first], minlength=len(samples))
    samples += seen
    alone += seen
    order = np.lexsort((blend.sample, blend.triangle, blend.depth, blend.object))
    objects, where = np.unique(blend.object[order], return_index=True)
    fresh = sample[objects] < 0
    witness = order[where[fresh]]
    sample[objects[fresh]] = blend.sample[witness]
    at[objects[fresh]] = blend.depth[witness]


def hit_depths(scene: Scene, camera: Camera, sample: Int64, triangle: Int32) -> Float64:
    """(h,) float64 view depths of (sample, triangle) hits, for putting them in order."""
    corners = scene.vertices[scene.triangles[triangle]].astype(np.float64) - camera.eye
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    y, x = np.divmod(sample, camera.width)
    side = camera.column_a[x, None] * camera.right_step + camera.row_b[y, None] * camera.up_step
    if camera.is_perspective:
        start, direction = corners[:, 0], camera.forward + side
    else:
        start, direction = corners[:, 0] - side, np.broadcast_to(camera.forward, side.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth: Float64 = (normal * start).sum(axis=1) / (normal * direction).sum(axis=1)
    return np.nan_to_num(depth, nan=np.inf)


def mask_states(scene: Scene, camera: Camera, sample: Int64, triangle: Int32) -> NDArray[np.uint8]:
    """(h,) uint8, SOLID, HOLE or BETWEEN of hits of masked triangles; a triangle whose mask is
    not known is in between. The camera is in the coordinates of the scene's vertices."""
    from visref.masks.hits import states_at
    from visref.masks.lookup import BETWEEN

    state = np.full(len(sample), BETWEEN, np.uint8)
    if scene.masks is None or not len(sample):
        return state
    row = scene.masks.row[triangle]
    known = np.flatnonzero(row >= 0)
    y, x = np.divmod(sample[known], camera.width)
    axes = np.stack([camera.eye, camera.forward, camera.right_step, camera.up_step])
    corners = scene.vertices[scene.triangles[triangle[known]]].astype(np.float64)
    at = np.stack([camera.column_a[x], camera.row_b[y]], axis=1)
    state[known] = states_at(scene.masks, row[known], axes, at, camera.is_perspective, corners)
    return state
