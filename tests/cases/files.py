"""What the cases are made of: files written by hand, and the command line that judges them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from tests.support.gltf_files import TWO, Gltf
from visref.cli.main import main

BOX = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)], "f4")
BOX_FACES = np.array(
    [
        [0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5],
        [0, 4, 5, 0, 5, 1, 2, 3, 7, 2, 7, 6],
        [0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3],
    ],
    "u2",
).reshape(-1)


def rectangle(left: float, bottom: float, right: float, top: float, z: float) -> np.ndarray:
    """Corners of an upright rectangle that faces +Z, for `TWO`."""
    corners = [(left, bottom, z), (right, bottom, z), (right, top, z), (left, top, z)]
    return np.array(corners, "f4")


def add_rectangle(gltf: Gltf, name: str, *sides: float, **more: Any) -> int:
    """A node with a rectangle; `more` goes to its primitive."""
    return gltf.node(mesh=gltf.mesh(gltf.primitive(rectangle(*sides), TWO, **more)), name=name)


def add_box(gltf: Gltf, name: str, centre: Any, size: Any) -> int:
    mesh = gltf.mesh(gltf.primitive(BOX, BOX_FACES))
    return gltf.node(mesh=mesh, name=name, translation=list(centre), scale=list(size))


def write_path(folder: Path, *poses: np.ndarray, **values: Any) -> Path:
    """96 by 72, near 0.1, far 1000; orthographic with a pixel for a tenth of a unit unless `yfov`
    is given. Without poses the camera is at the origin and looks down -Z. `each`: what else is
    said of each frame, one dictionary per pose."""
    each = values.pop("each", [{}] * max(len(poses), 1))
    poses = poses or (np.eye(4),) * len(each)
    frames = [
        {"world_from_camera": pose.tolist(), **more} for pose, more in zip(poses, each, strict=True)
    ]
    frame_values = {k: values.pop(k) for k in ("shift_x_px", "shift_y_px") if k in values}
    document = {
        "format": "visref-path",
        "version": 1,
        "width": 96,
        "height": 72,
        "near": 0.1,
        "far": 1000.0,
        **({} if "yfov" in values else {"ymag": 3.6}),
        **values,
        "frames": [{**frame, **frame_values} for frame in frames],
    }
    file = folder / "path.json"
    file.write_text(json.dumps(document))
    return file


def check(scene: Path, *visible: str, engine: str = "embree") -> tuple[int, Any]:
    """Judge the recording of one frame: exit status, and what the verdict says of the culler
    (None where there is no verdict)."""
    file = scene.parent / "visible.jsonl"
    file.write_text(json.dumps({"frame": 0, "visible": list(visible)}) + "\n")
    return _judge("check", scene, "--visible", str(file), "--engine", engine)


@dataclass(frozen=True)
class Judged:
    """`sums`: what the verdict says of the culler; `findings`: code, object and frame of each;
    `lost`: samples lost per frame. Without a verdict only the exit status."""

    status: int
    sums: Any = None
    findings: tuple[tuple[str, str, int | None], ...] = ()
    lost: tuple[int, ...] = ()


def check_rows(scene: Path, *rows: dict[str, Any], engine: str, more: Any = ()) -> Judged:
    """Judge a recording, one row per frame in order. `more`: further arguments."""
    file = scene.parent / "visible.jsonl"
    file.write_text("".join(json.dumps({"frame": i, **row}) + "\n" for i, row in enumerate(rows)))
    given = ("--visible", str(file), "--engine", engine, *more)
    status, sums = _judge("check", scene, *given)
    if sums is None:
        return Judged(status)
    out = max(scene.parent.glob("run*"), key=lambda folder: int(folder.name[3:]))
    findings = json.loads((out / "verdict.json").read_text())["findings"]
    table = pq.read_table(out / "frames.parquet", columns=["frame", "missed_pixels"]).to_pylist()
    return Judged(
        status,
        sums,
        tuple((one["code"], one["object"], one["frame"]) for one in findings),
        tuple(row["missed_pixels"] for row in sorted(table, key=lambda row: row["frame"])),
    )


def run(scene: Path, culler: type, *, engine: str = "embree") -> tuple[int, Any]:
    """Judge a culler of `tests.wrong_cullers`, as a plug-in."""
    return _judge(
        *("run", scene, "--culler", f"{culler.__module__}:{culler.__name__}", "--engine", engine)
    )


def _judge(command: str, scene: Path, *arguments: str) -> tuple[int, Any]:
    taken = len(list(scene.parent.glob("run*")))
    out = scene.parent / f"run{taken}"
    path = str(scene.parent / "path.json")
    given = [command, str(scene), "--path", path, "--out", str(out), "--pictures", "0"]
    status = main([*given, *arguments])
    verdict = out / "verdict.json"
    if not verdict.exists():
        return status, None
    (sums,) = json.loads(verdict.read_text())["cullers"].values()
    return status, sums
