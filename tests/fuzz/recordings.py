"""One-file recordings, and units beside them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from tests.fuzz import rewrite, spoil
from tests.fuzz.inputs import BESIDE, SCENE_OBJECTS
from tests.fuzz.limits import MEMORY, Folders
from tests.fuzz.target import Target
from tests.support.hand_made import scene_of_squares
from visref.camera import look_at
from visref.recordings import read_recording, read_units
from visref.scene import Scene

_POSE = look_at((0.0, 0.0, 1.0), (0.0, 0.0, -5.0)).tolist()
_HEADER = {
    "format": "visref-recording", "version": 1, "width": 8, "height": 6, "near": 0.1, "far": None,
    "yfov": 1.0, "fps": 30,
}  # fmt: skip
_VIEWS = {"left": {"world_from_camera": _POSE}, "right": {"world_from_camera": _POSE, "width": 4}}
_BOX = [[-1.0, -1.0, -3.0], [1.0, 1.0, 0.0]]

_PLAIN = [
    {**_HEADER, "groups": {"pair": [0, "square2"]}},
    {"frame": 0, "world_from_camera": _POSE, "visible": [0, "square1"], "cut": True},
    {"frame": 3, "world_from_camera": _POSE, "visible": ["pair"], "absent": ["square1"],
     "stats": {"queries": 7}, "bounds": {"square0": _BOX}},
    {"frame": 4, "views": _VIEWS, "visible": {"left": [], "right": ["group:pair", 1]},
     "world_from_object": {"square0": np.eye(4).tolist()}},
]  # fmt: skip
_NODES = [
    _HEADER,
    {"frame": 7, "eye": [0, 0, 1], "target": [0, 0, 0], "visible_nodes": [0, 2]},
    {"frame": 8, "position": [0, 0, 1], "rotation": [0, 0, 0, 1], "visible_nodes": []},
]
_OF_UNITS = [
    {**_HEADER, "units": "u.csv"},
    {"frame": 0, "world_from_camera": _POSE, "visible": [0, 2], "bounds": {"1": _BOX}},
]

UNITS = b"""unit,object,first_triangle,triangle_count
0,square0,0,2
1,1,0,2
2,square2,1,1
2,square2,0,1
"""


def _lines(*values: dict[str, Any]) -> bytes:
    return b"".join(json.dumps(value).encode() + b"\n" for value in values)


@cache
def _scene() -> Scene:
    found = scene_of_squares(*range(SCENE_OBJECTS))
    return Scene(
        found.vertices,
        found.triangles,
        found.object_offsets,
        found.names,
        nodes=np.arange(SCENE_OBJECTS, dtype=np.int32),
    )


def _read_recording(file: Path, folders: Folders) -> Any:
    del folders
    recording = read_recording(file, _scene(), max_memory=MEMORY)
    sets = recording.sets
    return (
        # Views are by name, and so in any order.
        [json.dumps(frame.definition(), sort_keys=True) for frame in recording.path.frames],
        list(recording.path.numbers),
        [
            (number, sorted((view, ids.tolist()) for view, ids in views.items()))
            for number, views in sets.sets.items()
        ],
        {n: boxes.tolist() for n, boxes in sets.boxes.items()},
        str(sets.stats),
    )


def _check(file: Path, folders: Folders) -> Sequence[str]:
    return ["check", "scene.glb", "--recording", str(file), "--pictures", "0", "--threads", "1",
            "--out", str(folders.out / "run")]  # fmt: skip


def _read_units(file: Path, folders: Folders) -> Any:
    del folders
    units = read_units(file, _scene(), max_memory=MEMORY)
    return [sorted(units.gather(np.array([unit])).tolist()) for unit in range(units.count)]


@cache
def _unit_tables() -> dict[str, bytes]:
    numbers = {"unit": [0, 1, 2], "first_triangle": [0, 0, 0], "triangle_count": [2, 2, 2]}
    columns = {name: pa.array(values, pa.int32()) for name, values in numbers.items()}
    names = pa.array([f"square{i}" for i in range(SCENE_OBJECTS)], pa.string())
    return {
        "ids": spoil.parquet_bytes(pa.table({**columns, "object": pa.array([0, 1, 2])})),
        "names": spoil.parquet_bytes(pa.table({**columns, "object": names})),
    }


TARGETS = (
    Target(
        "recording",
        "case.jsonl",
        lambda: {
            "plain": _lines(*_PLAIN), "nodes": _lines(*_NODES), "units": _lines(*_OF_UNITS)
        },
        spoil.json_lines,
        _read_recording,
        rewrite.json_lines,
        _check,
        {**BESIDE, "u.csv": UNITS},
    ),
    Target("units-csv", "case.csv", lambda: {"units": UNITS}, spoil.tokens, _read_units,
           rewrite.csv_text),
    Target("units-parquet", "case.parquet", _unit_tables, spoil.parquet, _read_units,
           rewrite.parquet_with_unknown),
)  # fmt: skip
