"""A folder of images that go with labels: instance ids, depth, and masks of whole objects.

`labels.json` lists them. By frame, and view where it has a name: `instances/` a PNG of 16 bits, or
of four bytes where there are more objects than those hold: object + 1, 0 for the background, and
the greatest number for an undecided sample; `depth/` float32 view depths as `depth` in an NPZ, inf
for the background, NaN where undecided; `amodal/` JSON with each object's whole silhouette in the
image as COCO's run lengths.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from visref.files import FolderKind
from visref.labels.frame import FrameLabels
from visref.labels.plain import write_json
from visref.labels.rle import by_object, segmentation
from visref.labels.tally import TIED, UNDECIDED
from visref.run_folder.layout import slug
from visref.scene import Int32, Scene
from visref.visibility import FrameTruth

MARKER, FORMAT, VERSION = "labels.json", "visref-label-images", 1
_FOLDERS = {"instances": "png", "depth": "npz", "amodal": "json"}
# 16 bits hold the background, this many objects, and what is undecided.
MOST_IN_16_BITS = (1 << 16) - 2


def _wrote(index: Any) -> Sequence[str] | None:
    if not isinstance(index, dict) or index.get("format") != FORMAT:
        return None
    named = [rf"{folder}/\d{{6,}}(-[\w.~-]+)?\.{end}" for folder, end in _FOLDERS.items()]
    return [re.escape(MARKER), *named]


IMAGE_FOLDER = FolderKind(MARKER, _wrote)


def image_name(frame: int, view: str) -> str:
    """The name, without an ending, of the files of a frame's view."""
    return f"{frame:06d}-{slug(view)}" if view else f"{frame:06d}"


class ImageFolder:
    """Writes the images of one frame after another into a folder that is there and empty."""

    def __init__(self, folder: Path, scene: Scene) -> None:
        self._folder, self._scene = folder, scene
        self._wide = scene.object_count > MOST_IN_16_BITS
        self._images: list[dict[str, Any]] = []
        for name in _FOLDERS:
            (folder / name).mkdir()

    def add(self, frame: int, truth: FrameTruth, labels: FrameLabels) -> None:
        """Write the images of one view of a frame."""
        camera = labels.camera
        name = image_name(frame, camera.view)
        files = {folder: f"{folder}/{name}.{end}" for folder, end in _FOLDERS.items()}
        owner = owner_ids(labels, self._scene, truth).reshape(camera.height, camera.width)
        ids = owner.astype(np.int64) + 1
        undecided = owner == UNDECIDED
        if self._wide:
            ids[undecided] = (1 << 32) - 1
            bands = ids.astype("<u4").view(np.uint8).reshape(*ids.shape, 4)
            Image.fromarray(bands, "RGBA").save(self._folder / files["instances"])
        else:
            ids[undecided] = (1 << 16) - 1
            Image.fromarray(ids.astype(np.uint16)).save(self._folder / files["instances"])
        depth = truth.buffer.depth.astype(np.float32)
        depth[undecided] = np.nan
        np.savez_compressed(self._folder / files["depth"], depth=depth)
        masks = [
            {
                "object": object_id,
                "name": self._scene.names[object_id],
                "segmentation": segmentation(runs, camera.width, camera.height),
            }
            for object_id, runs in by_object(labels.alone.runs)
        ]
        write_json(self._folder / files["amodal"], {"objects": masks})
        size = {"width": camera.width, "height": camera.height}
        self._images.append({"frame": frame, "view": camera.view, **size, **files})

    def finish(self) -> None:
        """Write what lists them all."""
        index = {
            "format": FORMAT,
            "version": VERSION,
            "bits": 32 if self._wide else 16,
            "objects": list(self._scene.names),
            "images": self._images,
        }
        write_json(self._folder / MARKER, index)


def owner_ids(labels: FrameLabels, scene: Scene, truth: FrameTruth) -> Int32:
    """(samples,) int32, the owner of each sample, of tied ones that with the least triangle;
    `BACKGROUND` or `UNDECIDED`."""
    at = labels.owners.at.copy()
    tied = np.flatnonzero(at <= TIED)
    at[tied] = scene.object_of_triangle[truth.buffer.triangle.reshape(-1)[tied]]
    return at
