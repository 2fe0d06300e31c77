"""A dataset in BOP's format (docs/bop_datasets_format.md of the BOP toolkit): poses of rigid
objects, what shows of them, and their models, in millimetres and OpenCV's camera axes.

A view is a scene, a frame an image, an object a model of its own. A scene's unit is taken as a
metre, as glTF has it. `scene_gt_info.json` follows the toolkit's `calc_gt_info`: the silhouette
counts beyond the image's edges too (`px_count_all`, `bbox_obj`), a box's width is its last column
less its first, and all four numbers are -1 where nothing shows. Departures: the toolkit's canvas
is three times the image, ours is as large as it takes, and its test of visibility allows 15 mm,
ours nothing. Its renderers have pixel centres at halves, `cam_K` here at whole numbers, as its
arithmetic and OpenCV's have. An object that bends, or is scaled in a frame, has no pose there, and
is left out of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from visref.camera import Camera
from visref.errors import InputError
from visref.files import FolderKind
from visref.labels.frame import FrameLabels
from visref.labels.models import Model, pose_between
from visref.labels.plain import write_json
from visref.labels.rle import by_object, mask_of
from visref.labels.tally import UNDECIDED, visible_runs
from visref.scene import Float64, Scene
from visref.timeline import Timeline
from visref.visibility import FrameTruth

MM = 1000.0
MARKER, FORMAT, VERSION = "dataset_info.json", "visref-bop", 1
SPLIT = "test"
# OpenCV's camera looks along +Z with +Y down.
CV_FROM_GL = np.diag([1.0, -1.0, -1.0])
# Depth images have 16 bits; the finest unit that they are given in.
_MOST, _FINEST_MM = (1 << 16) - 1, 0.1
_NO_BOX = [-1, -1, -1, -1]


def _wrote(said: Any) -> Sequence[str] | None:
    if not isinstance(said, dict) or said.get("format") != FORMAT:
        return None
    scene = rf"{SPLIT}/\d{{6}}"
    return [
        rf"{MARKER.replace('.', '[.]')}",
        r"models/(obj_\d{6}\.ply|models_info\.json)",
        rf"{scene}/scene_(gt|camera|gt_info)\.json",
        rf"{scene}/depth/\d{{6}}\.png",
        rf"{scene}/mask(_visib)?/\d{{6}}_\d{{6}}\.png",
    ]


BOP_FOLDER = FolderKind(MARKER, _wrote)


@dataclass
class _SceneFiles:
    """What is said of one view of all frames, by image."""

    folder: Path
    camera: dict[str, Any]
    truth: dict[str, Any]
    info: dict[str, Any]


class BopFolder:
    """Writes a dataset into a folder that is there and empty. `left_out`: the names of objects that
    had no pose in some frame."""

    def __init__(self, folder: Path, timeline: Timeline) -> None:
        self._folder, self._timeline = folder, timeline
        self._views: dict[str, _SceneFiles] = {}
        self._models: dict[int, Model] = {}
        self.left_out: set[str] = set()

    def add(self, frame: int, scene: Scene, truth: FrameTruth, labels: FrameLabels) -> None:
        """Add one view of a frame. Raises InputError for an orthographic camera."""
        camera = labels.camera
        files = self._view(camera.view)
        image = str(frame)
        rotation = CV_FROM_GL @ camera.world_from_camera[:3, :3].T
        scale = self._write_depth(files.folder / "depth" / f"{frame:06d}.png", truth, labels)
        files.camera[image] = {
            "cam_K": intrinsics(camera).reshape(-1).tolist(),
            "depth_scale": scale,
            "cam_R_w2c": rotation.reshape(-1).tolist(),
            "cam_t_w2c": (-rotation @ (camera.eye + scene.origin) * MM).tolist(),
        }
        files.truth[image], files.info[image] = [], []
        visible = dict(by_object(visible_runs(labels.alone.runs, camera.width, labels.owners)))
        for each, runs in by_object(labels.alone.runs):
            pose = self._pose(each, scene)
            if pose is None:
                self.left_out.add(scene.names[each])
                continue
            world_from_model, at = pose
            number = len(files.truth[image])
            files.truth[image].append(
                {
                    "cam_R_m2c": (rotation @ world_from_model).reshape(-1).tolist(),
                    "cam_t_m2c": (rotation @ (at - camera.eye) * MM).tolist(),
                    "obj_id": each + 1,
                }
            )
            files.info[image].append(info_of(labels, each))
            for name, own in (("mask", runs), ("mask_visib", visible.get(each, runs[:0]))):
                mask = mask_of(own, camera.width, camera.height).astype(np.uint8) * 255
                file = files.folder / name / f"{frame:06d}_{number:06d}.png"
                Image.fromarray(mask).save(file, compress_level=1)

    def _view(self, view: str) -> _SceneFiles:
        if view not in self._views:
            folder = self._folder / SPLIT / f"{len(self._views):06d}"
            for name in ("depth", "mask", "mask_visib"):
                (folder / name).mkdir(parents=True)
            self._views[view] = _SceneFiles(folder, {}, {}, {})
        return self._views[view]

    def _pose(self, object_id: int, scene: Scene) -> tuple[Float64, Float64] | None:
        """world_from_model, (3, 3), and where the model's origin is, (3,), relative to the scene's
        origin; None where the object is no rigid image of its model."""
        if object_id not in self._models:
            self._models[object_id] = Model.of(scene, object_id)
        model = self._models[object_id]
        if scene is model.scene:
            return np.eye(3), model.centre
        return pose_between(model, scene)

    def _write_depth(self, file: Path, truth: FrameTruth, labels: FrameLabels) -> float:
        """The depth image, 0 where there is none; returns millimetres per unit."""
        depth = truth.buffer.depth.copy()
        camera = labels.camera
        nothing = labels.owners.at.reshape(camera.height, camera.width) == UNDECIDED
        depth[nothing | ~np.isfinite(depth)] = 0.0
        most = float(depth.max(initial=0.0)) * MM
        steps = math.ceil(math.log10(max(1.0, most / (_FINEST_MM * _MOST))))
        scale = _FINEST_MM * 10.0**steps
        units = np.rint(depth * (MM / scale))
        # What is met is not 0.
        units[(depth > 0.0) & (units < 1.0)] = 1.0
        Image.fromarray(np.minimum(units, _MOST).astype(np.uint16)).save(file)
        return scale

    def finish(self) -> None:
        """Write the scenes' files, the models, and what says whose folder it is."""
        for files in self._views.values():
            for name, value in (
                ("scene_camera", files.camera),
                ("scene_gt", files.truth),
                ("scene_gt_info", files.info),
            ):
                write_json(files.folder / f"{name}.json", value, indent=1)
        models = self._folder / "models"
        models.mkdir()
        info = {}
        for object_id, model in sorted(self._models.items()):
            model.write(models / f"obj_{object_id + 1:06d}.ply")
            info[str(object_id + 1)] = model.info()
        write_json(models / "models_info.json", info, indent=1)
        names = self._timeline.still.names
        said = {
            "format": FORMAT,
            "version": VERSION,
            "scenes": {f"{number:06d}": view for number, view in enumerate(self._views)},
            "objects": {str(one + 1): names[one] for one in sorted(self._models)},
        }
        write_json(self._folder / MARKER, said, indent=1)


def intrinsics(camera: Camera) -> Float64:
    """K, (3, 3) float64: pixel centres are at whole numbers, as OpenCV has them. Raises InputError
    for an orthographic camera."""
    if camera.yfov is None:
        raise InputError(
            "BOP has no orthographic cameras", place="ymag", fix="give 'yfov', or leave out --bop"
        )
    # Half a pixel is `step` wide at depth 1.
    focal = camera.height / (2.0 * math.tan(camera.yfov / 2))
    cx = (camera.width - 1) / 2 - camera.shift_x_px
    cy = (camera.height - 1) / 2 - camera.shift_y_px
    return np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])


def info_of(labels: FrameLabels, object_id: int) -> dict[str, Any]:
    """What `scene_gt_info.json` says of an object that has samples in the image."""
    visible = int(labels.visible_samples[object_id])
    whole = int(labels.whole_samples[object_id])
    every = whole if whole >= 0 else int(labels.silhouette_samples[object_id])
    return {
        "px_count_all": every,
        "px_count_valid": int(labels.hit_samples[object_id]),
        "px_count_visib": visible,
        "visib_fract": visible / every,
        "bbox_obj": _box(labels.amodal_box[object_id]) if visible else _NO_BOX,
        "bbox_visib": _box(labels.visible_box[object_id]) if visible else _NO_BOX,
    }


def _box(box: np.ndarray[Any, Any]) -> list[int]:
    """The toolkit's box: first column and row, and how far the last ones are from those."""
    x0, y0, x1, y1 = box.tolist()
    return [x0, y0, x1 - 1 - x0, y1 - 1 - y0]
