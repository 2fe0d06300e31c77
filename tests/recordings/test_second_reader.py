"""Two readers of recordings that do not know each other say the same of a hundred files.

`second_reader` was written from the documentation and the schemas alone, by somebody who had not
seen visref's own, and so was the generator of recordings, right ones and wrong ones.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.recordings.second_reader.generate import generate
from tests.recordings.second_reader.reader import Refused
from tests.recordings.second_reader.reader import read as read_by_the_second
from visref.errors import InputError
from visref.recordings import read_recording
from visref.scene import Group, Scene
from visref.timeline import Timeline

SEEDS = range(100)


def scene_of(objects: list[dict[str, Any]], groups: list[dict[str, Any]]) -> Scene:
    """A scene with these names, paths, nodes and numbers of triangles."""
    sizes = [one["triangles"] for one in objects]
    nodes = [-1 if one["node"] is None else one["node"] for one in objects]
    return Scene(
        np.eye(3, dtype=np.float32),
        np.tile(np.arange(3, dtype=np.int32), (sum(sizes), 1)),
        np.concatenate([[0], np.cumsum(sizes)]),
        tuple(one["name"] for one in objects),
        given_names=tuple(one["given_name"] for one in objects),
        paths=tuple(one["path"] for one in objects),
        # Each with one level of detail, so that `levels` may name it.
        groups=tuple(
            Group(one["name"], one["path"], ids, levels=(ids,))
            for one in groups
            for ids in (tuple(one["objects"]),)
        ),
        nodes=np.array(nodes, np.int32) if max(nodes, default=-1) >= 0 else None,
    )


def ours(file, scene: Scene) -> dict[str, Any]:
    """What visref reads, in the words of the second reader."""
    recording = read_recording(file, scene)
    # Whether its poses, absences and levels can be is known once they are brought to the scene.
    timeline = Timeline(recording.scene, recording.path)
    for number in recording.path.numbers:
        timeline.absent(number)
    frames = []
    for number, frame in zip(recording.path.numbers, recording.path.frames, strict=True):
        drawn = {}
        for view, units in recording.sets.sets[number].items():
            triangles = np.unique(recording.sets.units.gather(units))
            owner = scene.object_of_triangle[triangles]
            inside = triangles - scene.object_offsets[owner]
            drawn[view] = list(zip(owner.tolist(), inside.tolist(), strict=True))
        gap = bool(frames) and number != frames[-1]["number"] + 1
        frames.append({"number": number, "frame": frame, "drawn": drawn, "after a gap": gap})
    cut_off = any(code == "RECORDING_CUT_OFF" for code, _ in recording.path.remarks)
    return {"frames": frames, "cut_off": cut_off}


def differences(file, objects, groups) -> list[str]:
    scene = scene_of(objects, groups)
    try:
        theirs: Any = read_by_the_second(file, objects, groups)
    except Refused as error:
        theirs = f"refused: {error}"
    try:
        mine: Any = ours(file, scene)
    except InputError as error:
        mine = f"refused: {error}"
    if isinstance(mine, str) or isinstance(theirs, str):
        if isinstance(mine, str) and isinstance(theirs, str):
            return []
        return [f"visref: {shortened(mine)} | second: {shortened(theirs)}"]
    found = []
    printed = frames_printed_short(file)
    if mine["cut_off"] != theirs["cut_off"]:
        found.append("cut off or not")
    numbers = [one["number"] for one in mine["frames"]], [one["number"] for one in theirs["frames"]]
    if numbers[0] != numbers[1]:
        return [*found, f"frames {numbers}"]
    for my, other in zip(mine["frames"], theirs["frames"], strict=True):
        short = my["number"] in printed
        found += [f"frame {my['number']}: {line}" for line in of_frame(my, other, short=short)]
    return found


def shortened(value: Any) -> str:
    return value if isinstance(value, str) else f"read {len(value['frames'])} frames"


def frames_printed_short(file) -> set[int]:
    """The frames with a camera's matrix or rotation that is printed with six digits."""
    found = set()
    for line in Path(file).read_bytes().decode("utf-8-sig", "replace").splitlines():
        try:
            values = json.loads(line)
        except ValueError:
            continue
        if isinstance(values, dict) and isinstance(values.get("frame"), int):
            places = [values, *(values.get("views") or {}).values()]
            given = [place.get(name) for place in places for name in MATRICES]
            if any(printed_short(matrix) for matrix in given):
                found.add(values["frame"])
    return found


MATRICES = ("world_from_camera", "camera_from_world", "clip_from_world", "rotation")


def printed_short(matrix: Any) -> bool:
    flat = np.ravel(list(matrix.values()) if isinstance(matrix, dict) else matrix)
    numbers = [float(value) for value in flat if value is not None]
    return any(value % 1.0 for value in numbers) and all(
        value == float(f"{value:.6g}") for value in numbers
    )


def of_frame(my: dict[str, Any], other: dict[str, Any], *, short: bool) -> list[str]:
    frame, found = my["frame"], []
    if frame.time_s != other["time_s"] or frame.clip != other["animation"]:
        found.append(f"time {frame.time_s, frame.clip} {other['time_s'], other['animation']}")
    if (frame.cameras[0].cut or my["after a gap"]) != other["cut"]:
        found.append("cut")
    if list(frame.absent) != other["absent"] or dict(frame.levels) != other["levels"]:
        found.append("absent or levels")
    if {n: m.tolist() for n, m in frame.world_from_object.items()} != other["world_from_object"]:
        found.append("poses")
    absent = other["absent"]
    if not absent and {v: sorted(map(tuple, s)) for v, s in other["drawn"].items()} != {
        v: sorted(s) for v, s in my["drawn"].items()
    }:
        found.append(f"drawn {my['drawn']} {other['drawn']}")
    if [camera.view for camera in frame.cameras] != [view["name"] for view in other["views"]]:
        return [*found, "views"]
    for camera, view in zip(frame.cameras, other["views"], strict=True):
        found += [f"view '{camera.view}': {line}" for line in of_view(camera, view, short=short)]
    return found


# What float64 loses in a matrix inverse or a polar decomposition, of numbers of moderate condition;
# near and far of a clip matrix come out of small differences. Where a matrix is printed with six
# digits it is not quite any camera's, and which is nearest the two take differently.
CLOSE, CLOSE_RANGE, CLOSE_PRINTED, CLOSE_RANGE_PRINTED = 1e-9, 1e-6, 1e-5, 0.05


def of_view(camera, view: dict[str, Any], *, short: bool) -> list[str]:
    found = []
    close, of_range = (CLOSE_PRINTED, CLOSE_RANGE_PRINTED) if short else (CLOSE, CLOSE_RANGE)
    if (camera.width, camera.height) != (view["width"], view["height"]):
        found.append("size")
    for name in ("near", "far", "yfov", "ymag", "shift_x_px", "shift_y_px"):
        mine, other = getattr(camera, name), view[name]
        if (mine is None) != (other is None):
            found.append(f"{name}: {mine} {other}")
            continue
        tolerance = of_range if name in ("near", "far") else close
        if mine is not None and not math.isclose(mine, other, rel_tol=tolerance, abs_tol=close):
            found.append(f"{name}: {mine!r} {other!r}")
    plane = None if camera.clip_plane is None else list(camera.clip_plane)
    if plane != view["clip_plane"]:
        found.append(f"clip_plane {plane} {view['clip_plane']}")
    pose, other = camera.world_from_camera, np.array(view["world_from_camera"])
    reach = max(1.0, float(np.abs(other[:3, 3]).max()))
    if not np.allclose(pose[:3, :3], other[:3, :3], rtol=0, atol=close) or not np.allclose(
        pose[:3, 3], other[:3, 3], rtol=0, atol=close * reach
    ):
        found.append(f"pose {pose.tolist()} {other.tolist()}")
    return found


@pytest.mark.parametrize("seed", SEEDS)
def test_both_read_the_same_or_refuse(seed, tmp_path):
    assert differences(*generate(seed, str(tmp_path))) == []
