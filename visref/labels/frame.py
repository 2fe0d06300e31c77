"""What is said of each object in one view of a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.exact.scene import ExactScene
from visref.labels.silhouettes import Silhouettes, silhouettes
from visref.labels.tally import Owners, Tally, owned_outside, owners_of, tally
from visref.labels.windows import Reach, Window, reach_of
from visref.scene import Float64, Int64, Scene
from visref.visibility import FrameTruth, ObjectVisibility

Bool = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class FrameLabels:
    """One view of a frame, an array over all objects of the scene each.

    `there`: (n,) bool, who is not absent; nothing is said of others. `visible_samples`,
    `silhouette_samples`: (n,) int64. `visibility_fraction`, `in_view_fraction`,
    `undecided_fraction`, `depth`: (n,) float64, NaN where there is none. `visible_box`,
    `amodal_box`: (n, 4) int64, x0, y0, x1, y1 with x1 and y1 beyond the last sample; zeros where
    there is none. `whole_samples`: (n,) int64, the samples of its silhouette on an image as large
    as it takes, -1 where there is no such image. `hit_samples`: (n,) int64, those of its
    silhouette in the image at which anything opaque is met for certain. `occluders`: (h, 3) int64,
    object, who hides it, at how many samples; ascending objects, then falling samples, then
    ascending ids. `alone`: the silhouettes in the image. `owners`: whose samples those are.
    """

    camera: Camera
    there: Bool
    visible_samples: Int64
    silhouette_samples: Int64
    whole_samples: Int64
    hit_samples: Int64
    visibility_fraction: Float64
    in_view_fraction: Float64
    undecided_fraction: Float64
    visible_box: Int64
    amodal_box: Int64
    depth: Float64
    occluders: Int64
    alone: Silhouettes
    owners: Owners


class Labeller:
    """Makes the labels of one frame after another.

    `exact`: of the scene, posed as `frame` is told. The answer is the same for any number of its
    threads. What an engine that rounds gives to an object beyond its silhouette is of its
    silhouette too, so that no object shows more than it has.
    """

    def __init__(self, exact: ExactScene) -> None:
        self._exact = exact

    def frame(self, scene: Scene, truth: FrameTruth, seen: ObjectVisibility) -> FrameLabels:
        """The labels of a view whose truth is known, of the scene as it stands then."""
        exact = self._exact
        if exact.scene is not scene:
            exact.pose(scene)
        camera = truth.camera.relative_to(scene.origin)
        there = np.ones(scene.object_count, np.bool_)
        if scene.absent is not None:
            there = ~scene.absent
        owners = owners_of(truth, scene)
        alone = silhouettes(exact, Window.of_image(camera), there, keep=True)
        added = _add_owned(alone, owners, truth, seen)
        counted = tally(alone.runs, camera.width, scene.object_count, owners)
        reach = reach_of(scene, camera, np.flatnonzero(there))
        return _labels(exact, camera, there, alone, added, owners, counted, reach)


def _add_owned(
    alone: Silhouettes, owners: Owners, truth: FrameTruth, seen: ObjectVisibility
) -> Int64:
    """Let silhouettes have what the engine gives to their objects; by object, (n,) int64, how many
    samples that is."""
    more = owned_outside(alone.runs, alone.window.width, owners)
    added = np.bincount(more[:, 0], minlength=len(alone.samples))
    if not len(more):
        return added
    objects, samples = more.T
    alone.add(objects, samples)
    # Glass is not in the buffer: its witness stands for it.
    own = owners.at[samples] == objects
    depth = np.where(own, truth.buffer.depth_at(samples), seen.depth[objects])
    np.minimum.at(alone.depth, objects, depth)
    if len(alone.undecided):
        size = alone.window.width * alone.window.height
        keys = alone.undecided[:, 0] * size + alone.undecided[:, 1]
        alone.undecided = alone.undecided[~np.isin(keys, objects * size + samples)]
    return added


def _labels(
    exact: ExactScene,
    camera: Camera,
    there: Bool,
    alone: Silhouettes,
    added: Int64,
    owners: Owners,
    counted: Tally,
    reach: Reach,
) -> FrameLabels:
    count = exact.scene.object_count
    shows = alone.samples > 0
    whole = np.where(reach.fits, alone.samples, -1)
    amodal = _half_open(alone.boxes, shows)
    wider = shows & reach.fits & ~reach.whole
    if wider.any():
        window = _around(camera, reach.boxes[wider])
        far = silhouettes(exact, window, wider, keep=False)
        whole[wider] = far.samples[wider] + added[wider]
        boxes = far.boxes + np.array([window.x0, window.x0, window.y0, window.y0])
        boxes[:, ::2] = np.minimum(boxes[:, ::2], alone.boxes[:, ::2])
        boxes[:, 1::2] = np.maximum(boxes[:, 1::2], alone.boxes[:, 1::2])
        amodal[wider] = _half_open(boxes, shows)[wider]
    own = np.bincount(alone.undecided[:, 0], minlength=count)
    undecided = counted.undecided + own
    with np.errstate(divide="ignore", invalid="ignore"):
        visibility = counted.visible / alone.samples
        in_view = np.where(shows, alone.samples / whole, 0.0)
        share = undecided / (alone.samples + own)
    in_view[~reach.fits] = np.nan
    order = np.lexsort((counted.hidden[:, 1], -counted.hidden[:, 2], counted.hidden[:, 0]))
    return FrameLabels(
        camera=camera,
        there=there,
        visible_samples=counted.visible,
        silhouette_samples=alone.samples,
        whole_samples=whole,
        hit_samples=counted.hit,
        visibility_fraction=visibility,
        in_view_fraction=in_view,
        undecided_fraction=share,
        visible_box=_half_open(counted.boxes, counted.visible > 0),
        amodal_box=amodal,
        depth=np.where(shows, alone.depth, np.nan),
        occluders=counted.hidden[order],
        alone=alone,
        owners=owners,
    )


def _around(camera: Camera, boxes: Int64) -> Window:
    """The smallest window that holds the boxes, (k, 4), first and last column and row."""
    x0, y0 = boxes[:, 0].min(), boxes[:, 2].min()
    x1, y1 = boxes[:, 1].max(), boxes[:, 3].max()
    return Window(camera, int(x0), int(y0), int(x1 - x0 + 1), int(y1 - y0 + 1))


def _half_open(boxes: Int64, some: Bool) -> Int64:
    """x0, y0, x1, y1 of boxes that are first and last column and row; zeros but for `some`."""
    result = np.stack([boxes[:, 0], boxes[:, 2], boxes[:, 1] + 1, boxes[:, 3] + 1], axis=1)
    result[~some] = 0
    return result
