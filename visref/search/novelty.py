"""What is hard about a frame, read off its truth: the feedback that guides the search.

Where culling goes wrong, something is seen by little: by few samples, through a narrow gap, at the
image's border, just before something else, for the first time, or from inside its own box. Each of
these, by object, is a *feature*; a trial that shows one that no trial before it showed is kept.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.judging.asking import Job
from visref.judging.referee import JudgedFrame
from visref.scene import Scene
from visref.visibility import BACKGROUND, FrameTruth, ObjectVisibility

Feature = str
Bool = NDArray[np.bool_]

# Classes of counts: 1, 2, 3 to 4, 5 to 8, … and from here on all are many.
_MANY = 9


def count_class(count: int) -> str:
    """The class of a count of samples or objects: its power of two, rounded up."""
    return "many" if count > 1 << _MANY else str(1 << max(count - 1, 0).bit_length())


@dataclass(eq=False)
class Watching:
    """A run's listener that gathers the features of its truths, by trial. `trial_of`: by frame, the
    trial that it is of, several of which may come one after another; `called`: by object id, what
    an object counts as, so that things of a kind are one. `visible`: how many object-views each
    trial saw."""

    scene_at: Callable[[int], Scene]
    trial_of: Callable[[int], int]
    called: Callable[[int], str]
    features: dict[int, set[Feature]] = field(default_factory=dict)
    visible: Counter[int] = field(default_factory=Counter)
    _seen: dict[tuple[int, str], Bool] = field(default_factory=dict)

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        trial = self.trial_of(frame)
        before = self._seen.get((trial, truth.camera.view))
        shown = features_of(truth, seen, self.scene_at(frame), before, self.called)
        self.features.setdefault(trial, set()).update(shown)
        self.visible[trial] += int(np.count_nonzero(seen.visible))
        self._seen[trial, truth.camera.view] = seen.visible

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        pass

    def on_frame_done(self, frame: int) -> None:
        pass


def features_of(
    truth: FrameTruth,
    seen: ObjectVisibility,
    scene: Scene,
    before: Bool | None,
    called: Callable[[int], str],
) -> Iterable[Feature]:
    """What is hard about a view. `before`: (n,) bool, who was seen in this view's frame before,
    None of the first; `called` as of `Watching`."""
    camera = truth.camera
    owner = truth.buffer.triangle
    objects = np.full(owner.shape, BACKGROUND, np.int64)
    hit = owner >= 0
    objects[hit] = scene.object_of_triangle[owner[hit]]
    visible, count = np.flatnonzero(seen.visible), len(seen.samples)
    flags: dict[str, Bool] = {
        "at the border": _owners(objects, _border(objects.shape), count),
        "in a gap": _owners(objects, _in_a_gap(truth.buffer.depth, objects, 1), count),
        "in a slit": _owners(objects, _in_a_gap(truth.buffer.depth, objects, 2), count),
        "shares all": seen.samples > seen.alone,
        "just before": _just_before(truth.buffer.depth, objects, count),
        **_by_box(camera, scene),
    }
    if len(truth.blend.sample):
        flags["behind glass"] = _owners(
            objects, np.isin(np.arange(owner.size), truth.blend.sample).reshape(owner.shape), count
        )
    if before is not None:
        flags["comes into view"] = seen.visible & ~before
    kind = _kind_of(camera)
    for index in visible.tolist():
        name, samples = called(index), count_class(int(seen.samples[index]))
        yield f"{name}: {samples} samples"
        for flag, of in flags.items():
            if of[index]:
                yield f"{name}: {flag}"
                yield f"{flag}: {samples} samples"
                yield f"{kind}: {flag}"
    if before is not None:
        yield f"comes into view: {count_class(int(np.count_nonzero(flags['comes into view'])))}"
    yield f"objects in view: {count_class(len(visible))}"


def _kind_of(camera: Camera) -> str:
    """What is uncommon about a camera, in words."""
    found = {
        "orthographic": not camera.is_perspective,
        "shifted lens": bool(camera.shift_x_px or camera.shift_y_px),
        "clip plane": camera.clip_plane is not None,
        "cut": camera.cut,
        "far out": any(camera.origin),
    }
    return ", ".join(name for name, here in found.items() if here) or "plain camera"


def _owners(objects: NDArray[np.int64], where: Bool, count: int) -> Bool:
    """(n,) bool, the objects that own one of the samples `where`."""
    result = np.zeros(count, np.bool_)
    found = objects[where]
    result[found[found >= 0]] = True
    return result


def _border(shape: tuple[int, ...]) -> Bool:
    result = np.zeros(shape, np.bool_)
    result[[0, -1]] = result[:, [0, -1]] = True
    return result


def _in_a_gap(depth: NDArray[np.float64], objects: NDArray[np.int64], width: int) -> Bool:
    """(height, width) bool: samples with something nearer on both sides, across or down, so many
    samples apart at most."""
    result = np.zeros(depth.shape, np.bool_)
    for axis in (0, 1):
        d, o = (np.moveaxis(one, axis, 0) for one in (depth, objects))
        if len(d) < width + 2:
            continue
        gap = np.moveaxis(result, axis, 0)
        inner = slice(1, len(d) - width)
        first, last = d[: -width - 1], d[width + 1 :]
        nearer = (first < d[inner]) & (o[: -width - 1] != o[inner])
        nearer &= (last < d[inner]) & (o[width + 1 :] != o[inner])
        gap[inner] |= nearer & np.isfinite(d[inner])
    return result


def _just_before(depth: NDArray[np.float64], objects: NDArray[np.int64], count: int) -> Bool:
    """(n,) bool: objects with a sample beside another object's that lies behind by little: a
    hundredth of the depth."""
    result = np.zeros(count, np.bool_)
    for axis in (0, 1):
        d, o = (np.moveaxis(one, axis, 0) for one in (depth, objects))
        for a, b in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
            with np.errstate(invalid="ignore"):
                close = (o[a] >= 0) & (o[a] != o[b]) & (d[b] >= d[a]) & (d[b] < d[a] * 1.01)
            result[o[a][close]] = True
    return result


def _by_box(camera: Camera, scene: Scene) -> dict[str, Bool]:
    """(n,) bool each, by the boxes of the objects: the eye is in it, it reaches across the near
    plane, or the middle of it is not in the image."""
    boxes = scene.object_bounds
    there: Bool = np.all(boxes[:, 0] <= boxes[:, 1], axis=1)
    boxes = np.where(there[:, None, None], boxes, 0.0)
    around = (boxes[:, 0] <= camera.eye) & (camera.eye <= boxes[:, 1])
    inside: Bool = there & np.all(around, axis=1)
    middle, half = boxes.mean(axis=1), (boxes[:, 1] - boxes[:, 0]) / 2
    depth = (middle - camera.eye) @ camera.forward
    reach = half @ np.abs(camera.forward)
    across = there & (depth - reach < camera.near) & (depth + reach > camera.near)
    place, at = camera.pixel_of(middle)
    size = np.array([camera.width, camera.height])
    with np.errstate(invalid="ignore"):
        outside = ((place < -0.5) | (place > size - 0.5)).any(axis=1) | (at <= 0.0)
    # The eye is all but in the box, or on its side.
    apart = np.maximum(boxes[:, 0] - camera.eye, camera.eye - boxes[:, 1])
    gap = np.linalg.norm(np.maximum(apart, 0.0), axis=1)
    diagonal = float(np.linalg.norm(scene.bounds[1] - scene.bounds[0]))
    close = there & ~inside & (gap < max(2.0 * camera.near, 1e-3 * diagonal))
    return {
        "around the eye": inside,
        "across the near plane": across,
        "middle outside": there & outside,
        "close by": close,
    }


def rarity(features: Iterable[Feature], hits: dict[Feature, int]) -> float:
    """How rare what a trial shows is: the sum of each feature's share, of all that showed it."""
    return math.fsum(1.0 / hits[feature] for feature in features if hits.get(feature))
