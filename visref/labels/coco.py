"""COCO's annotations: an image per frame and view, an annotation per visible object.

`segmentation` is the visible mask, as run lengths, with its `area` and `bbox` (x, y, width and
height). Beside COCO's own keys an annotation has `object`, `name`, `visibility_fraction`, and the
mask and box of the whole object as `amodal_segmentation` and `amodal_bbox`. A category is what
objects are called in the scene's file, before repeated names are told apart.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from visref.labels.frame import FrameLabels
from visref.labels.images import image_name
from visref.labels.plain import write_json
from visref.labels.rle import by_object, segmentation
from visref.labels.tally import visible_runs
from visref.scene import Scene

# How the file begins: what is none is no earlier one.
COCO_BEGINS = b'{"info": {"description": "visref'


class CocoFile:
    """Collects frames and makes the file."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        names = list(dict.fromkeys(scene.given_names))
        self._category = {name: number for number, name in enumerate(names, 1)}
        self._images: list[dict[str, Any]] = []
        self._annotations: list[dict[str, Any]] = []

    def add(self, frame: int, labels: FrameLabels) -> None:
        """Add one view of a frame."""
        camera, scene = labels.camera, self._scene
        width, height = camera.width, camera.height
        image = len(self._images) + 1
        name = f"{image_name(frame, camera.view)}.png"
        said = {"id": image, "file_name": name, "width": width, "height": height}
        self._images.append({**said, "frame": frame, "view": camera.view})
        runs = labels.alone.runs
        whole = dict(by_object(runs))
        for each, own in by_object(visible_runs(runs, width, labels.owners)):
            self._annotations.append(
                {
                    "id": len(self._annotations) + 1,
                    "image_id": image,
                    "category_id": self._category[scene.given_names[each]],
                    "iscrowd": 0,
                    "area": int(labels.visible_samples[each]),
                    "bbox": _corner_and_size(labels.visible_box[each]),
                    "segmentation": segmentation(own, width, height),
                    "object": each,
                    "name": scene.names[each],
                    "visibility_fraction": float(labels.visibility_fraction[each]),
                    "amodal_bbox": _corner_and_size(labels.amodal_box[each]),
                    "amodal_segmentation": segmentation(whole[each], width, height),
                }
            )

    def write(self, file: Path) -> None:
        """Write the file; the caller has made the place safe."""
        categories = [
            {"id": number, "name": name, "supercategory": ""}
            for name, number in self._category.items()
        ]
        value = {
            "info": {"description": f"visref labels of {Path(self._scene.source).name}"},
            "images": self._images,
            "annotations": self._annotations,
            "categories": categories,
        }
        write_json(file, value)


def _corner_and_size(box: np.ndarray[Any, Any]) -> list[int]:
    x0, y0, x1, y1 = box.tolist()
    return [x0, y0, x1 - x0, y1 - y0]
