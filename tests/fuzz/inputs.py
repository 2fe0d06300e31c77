"""What comes with a scene: paths, recorded visible sets, truth files, command lines, names."""

from __future__ import annotations

import io
import json
import re
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.fuzz import rewrite, spoil
from tests.fuzz.draws import Draws
from tests.fuzz.limits import MEMORY, Folders, WrongAnswer
from tests.fuzz.target import Target, command
from tests.support import report_runs
from tests.support.gltf_everything import everything
from tests.support.gltf_files import SQUARE, TWO, Gltf
from tests.support.hand_made import camera, scene_of_squares
from tests.support.hand_made import truth as truth_of
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.conformance.declared import read_declared
from visref.formats import load_path
from visref.recordings import truth_file
from visref.recordings.truth_file import TruthTable
from visref.recordings.truth_reading import read_truth
from visref.recordings.visible_sets import read_visible_sets
from visref.report.writing import write_report
from visref.scene import Scene
from visref.visibility import objects_seen

# A scene and a path of three frames, as files, for whatever stands beside a case.
SCENE_OBJECTS, FRAMES = 3, 3


def _gltf() -> Gltf:
    gltf = Gltf()
    for index in range(SCENE_OBJECTS):
        square = SQUARE + np.array([-0.5, -0.5, -2.0 - index], "f4")
        gltf.node(mesh=gltf.mesh(gltf.primitive(square, TWO)), name=f"square{index}")
    return gltf


def _path() -> CameraPath:
    pose = look_at((0.0, 0.0, 1.0), (0.0, 0.0, -5.0))
    first = Camera(pose, 16, 12, near=0.1, far=50.0, yfov=1.0, shift_x_px=0.5, cut=True)
    second = Camera(pose, 16, 12, near=0.1, far=float("inf"), ymag=2.0, shift_y_px=-0.25)
    return CameraPath((first, second, Camera(pose, 8, 6, near=0.1, far=9.0, yfov=0.5)))


PATH_TEXT = spoil.json_bytes(_path().to_json())
BESIDE = {"scene.glb": _gltf().glb(), "scene.path.json": PATH_TEXT}


def _posed() -> dict[str, Any]:
    """Two views of three moments, in which objects are moved, absent, and at a time."""
    pose = np.eye(4).tolist()
    moved = np.eye(4)
    moved[0, 3] = 0.25
    eyes = {"left": {"world_from_camera": pose}, "right": {"world_from_camera": moved.tolist()}}
    return {
        "format": "visref-path",
        "version": 1,
        "width": 8,
        "height": 6,
        "near": 0.1,
        "far": 10.0,
        "yfov": 1.0,
        "clip_plane": [0.0, 0.0, -1.0, 0.0],
        "frames": [
            {"time_s": 0.5, "views": eyes},
            {"absent": ["square1"], "views": eyes, "cut": True},
            {"world_from_object": {"square0": moved.tolist()}, "world_from_camera": pose},
        ],
    }


POSED_TEXT = spoil.json_bytes(_posed())


def _formed() -> dict[str, Any]:
    """A frame for each form in which a camera may be given."""
    pose = look_at((0.0, 0.0, 1.0), (0.0, 0.0, -5.0))
    one = Camera(pose, 8, 6, near=0.1, far=10.0, yfov=1.0)
    inverse = {"column_major": one.camera_from_world.T.reshape(-1).tolist()}
    clip = {"row_major": one.clip_from_world().reshape(-1).tolist()}
    return {
        "format": "visref-path",
        "version": 1,
        "width": 8,
        "height": 6,
        "eye": [0.0, 0.0, 1.0],
        "target": [0.0, 0.0, 0.0],
        "frames": [
            {"near": 0.1, "yfov": 1.0},
            {"near": 0.1, "yfov": 1.0, "up": [1.0, 0.0, 0.0]},
            {"near": 0.1, "yfov": 1.0, "camera_from_world": inverse},
            {"near": 0.1, "ymag": 1.0, "position": [0, 0, 1], "rotation": [0.0, 0.6, 0.0, 0.8]},
            {"clip_from_world": clip, "clip_depth": "-1..1", "clip_y": "up"},
        ],
    }


FORMED_TEXT = spoil.json_bytes(_formed())


def _read_path(file: Path, folders: Folders) -> Any:
    del folders
    path = load_path(file, max_memory=MEMORY)
    found = []
    for frame in path.frames:
        moved = {name: matrix.tolist() for name, matrix in frame.world_from_object.items()}
        # Views are by name, and so in any order.
        cameras = sorted(str(camera.definition()) for camera in frame.cameras)
        found.append((frame.time_s, frame.clip, moved, frame.absent, dict(frame.levels), cameras))
    return found


def _cast(file: Path, folders: Folders) -> Sequence[str]:
    out = str(folders.out / "truth.parquet")
    return ["truth", "scene.glb", "--path", str(file), "--out", out, "--threads", "1"]


# --- recorded visible sets

JSONL = b"""{"frame": 0, "visible": [0, 2], "stats": {"queries": 7, "ms": {"cull": 1.5}}}
{"frame": 1, "visible": ["square1", "square2"], "note": "whatever"}
{"frame": 2, "visible": []}
"""
CSV = b"frame,object\n0,square0\n0,square2\n1,square1\n2,\n"
CSV_IDS = b"object_id,frame\n0,0\n2,0\n1,1\n,2\n"


@cache
def parquets() -> dict[str, bytes]:
    frame = pa.array([0, 0, 1, 2], pa.int32())
    ids = pa.array([0, 2, 1, None], pa.int32())
    names = pa.array(["square0", "square2", "square1", None], pa.string())
    return {
        "ids": spoil.parquet_bytes(pa.table({"frame": frame, "object_id": ids})),
        "names": spoil.parquet_bytes(pa.table({"frame": frame, "object": names})),
    }


@cache
def _scene() -> Scene:
    return scene_of_squares(*range(SCENE_OBJECTS))


def _read_sets(file: Path, folders: Folders) -> Any:
    del folders
    sets = read_visible_sets(file, _scene(), range(FRAMES), _TRUTH_PATH, max_memory=MEMORY)
    return {frame: ids.tolist() for frame, ids in sets.frames.items()}, sets.stats


def _check(file: Path, folders: Folders) -> Sequence[str]:
    return ["check", "scene.glb", "--path", "scene.path.json", "--visible", str(file),
            "--out", str(folders.out / "run"), "--pictures", "0", "--threads", "1"]  # fmt: skip


# --- truth files

_TRUTH_PATH = CameraPath((camera(), camera(), camera()))


@cache
def truths() -> dict[str, bytes]:
    table = TruthTable(_scene())
    for frame, owners in ((2, [[0, 4]]), (0, [[2, 2]]), (1, [[-1, -1]])):
        table.add(frame, 2, objects_seen(truth_of(owners), _scene()))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "truth.parquet"
        table.write(out, engine="hand", path=_TRUTH_PATH, ties_complete=True, exact=True)
        return {"truth": out.read_bytes()}


def _spoilt_truth(data: bytes, draws: Draws) -> bytes:
    """As any Parquet file; half of them are sealed again, so that more than the seal is tried."""
    spoilt = spoil.parquet(data, draws)
    if draws.below(2):
        return spoilt
    try:
        table = pq.read_table(io.BytesIO(spoilt))
        metadata = dict(table.schema.metadata or {})
        facts = json.loads(metadata[b"visref"])
        with np.errstate(all="ignore"):
            facts["digest"] = truth_file.digest_of([table], facts)
        metadata[b"visref"] = json.dumps(facts).encode()
        return spoil.parquet_bytes(table.replace_schema_metadata(metadata))
    except Exception:  # What is too far gone to be sealed stays as it is.
        return spoilt


def _read_truth(file: Path, folders: Folders) -> Any:
    del folders
    found = read_truth(file, _scene(), _TRUTH_PATH, range(FRAMES))
    rows = {
        cell: (rows.objects.tolist(), rows.samples.tolist(), rows.owned)
        for cell, rows in found.views.items()
    }
    return found.engine, found.exact, rows


# --- command lines: a JSON list of words

LINES = {
    "check": ["check", "scene.glb", "--path", "scene.path.json", "--visible", "sets.jsonl",
              "--engine", "embree", "--frames", "0:3:1", "--raster", "snap=0.004,depth=24",
              "--promise", "conservative", "--threads", "1", "--pictures", "0",
              "--out", "../out/run"],
    "run": ["run", "scene.glb", "--path", "scene.path.json", "--culler", "none",
            "--engine", "exact", "--frames", "1", "--pictures", "0", "--out", "../out/run"],
    "truth": ["truth", "scene.glb", "--path", "scene.path.json", "--engine", "exact",
              "--frames", ":2", "--out", "../out/truth.parquet"],
    "objects": ["objects", "scene.glb"],
    "cullers": ["cullers"],
}  # fmt: skip
# No word makes a large scene or a long run, and none is code that would be run.
WORD_PARTS = (
    "", ":", "::", "=", ",", ":::=", ":tile=", ":tile=0", ":tile=-1", ":tile=1e9", ":tile=nan",
    ":tile=64,tile=64", ":x=1", "0", "-1", "1", "999999999999999999999", "nan", "1:2:3:4", "::0",
    "-3:", "5:1", "a", "snap=nan,depth=24", "snap=1,depth=24", "snap=0.5", "snap=0,depth=99",
    "snap=0,depth=float,depth=8", "embree", "exact", "open3d", "frustum", "none", "no such",
    "nosuchmodule:Class", "visref:__file__", "visref.errors:InputError", "scene.glb", "sets.jsonl",
    "scene.path.json", "a\nb", "\x1b[31m", "\u202e", "\udcff", "é", "x" * 300, "../out/other", ".",
    "--frames", "--engine", "--help", "--lenient", "--cull-backfaces", "--out",
)  # fmt: skip


def _spoilt_line(data: bytes, draws: Draws) -> bytes:
    """A command line with a word changed, left out, put in or exchanged."""
    words: list[str] = json.loads(data)
    at, kind = draws.below(len(words)), draws.below(5)
    part = draws.pick(WORD_PARTS)
    if kind == 0:
        words[at] = part
    elif kind == 1:
        words[at] += part
    elif kind == 2:
        words.insert(at + 1, part)
    elif kind == 3 and len(words) > 2:
        del words[at]
    else:
        other = draws.below(len(words))
        words[at], words[other] = words[other], words[at]
    return spoil.json_bytes(words)


def _run_line(file: Path, folders: Folders) -> Any:
    del folders
    words = json.loads(file.read_bytes())
    if any("\0" in word for word in words):
        return None  # No system hands these over.
    status, _ = command(words)
    return None if status in (2, 3) else status


# --- names, from a scene to what is written of it: a JSON list of names

NAMES = {"names": spoil.json_bytes(["wall", "pillar", "a culler", "a/scene.glb"])}
LETTERS = (
    "a", " ", "\n", "\r", "\t", "\0", "\x07", "\x1b[31m", "\x85", "\u2028", "\u202e", "\u2066",
    "\u200f", "\ud800", "\udcff", "\ufffe", "\ufeff", "\U0001f600", "e\u0301", "<script>", "</td>",
    "]]>", "<!--", "|", "`", "*", "_", "[x](y)", "![", "&lt;", '"', "'", "\\", "/", "..",
    "::error::", "##[error]", "%0A", "{{", "[bold]", ":b:", "$(x)", "~", "-", "=1+1", "x" * 300,
)  # fmt: skip


def _spoilt_names(data: bytes, draws: Draws) -> bytes:
    names: list[str] = json.loads(data)
    at = draws.below(len(names))
    place = draws.span(len(names[at]))
    names[at] = names[at][: place.start] + draws.pick(LETTERS) + names[at][place.stop :]
    return spoil.json_bytes(names)


# What turns text around, breaks a line or drives a terminal, in a text that a reader gets to see.
_ACTIVE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def _write_names(file: Path, folders: Folders) -> Any:
    """A run that loses an object, its report, and what the command line says of it."""
    first, second, culler, source = json.loads(file.read_bytes())
    found = report_runs.scene()
    parts = [(name, *_part(found, i)) for i, name in enumerate(found.names)]
    parts[report_runs.WALL] = (first, *parts[report_runs.WALL][1:])
    parts[report_runs.PILLAR] = (second, *parts[report_runs.PILLAR][1:])
    scene = Scene.from_objects(parts, source=source)
    run = folders.out / "run"
    culls = report_runs.Scripted((report_runs.NASTY_ID,))
    with mock.patch.object(report_runs, "scene", return_value=scene):
        report_runs.write_run(run, [(culler, culls)], frames=1, pictures=())
    page = write_report([run], folders.out / "page")
    texts = {name: page.with_name(name).read_text(encoding="utf-8")
             for name in ("report.html", "summary.md", "junit.xml")}  # fmt: skip
    root = ET.fromstring(texts["junit.xml"])
    # The culler's own, the two lost objects', and that of all others.
    if len(list(root.iter("testcase"))) != 4:
        raise WrongAnswer("JUnit has not its four test cases")
    for name, text in texts.items():
        if active := _ACTIVE.search(text):
            raise WrongAnswer(f"{name} holds {active[0]!a}")
        for line in text.splitlines():
            if line.lstrip().startswith(("::", "##[")):
                raise WrongAnswer(f"{name} gives CI an order")
    if "<script>x" in texts["report.html"] or "</td>a" in texts["report.html"]:
        raise WrongAnswer("report.html holds a name as it is")
    for line in (["report", str(run), "--out", str(folders.out / "again")],
                 ["explain", str(run), "--frame", "0", "--object", "0"]):  # fmt: skip
        _, said = command(line)
        for row in said.splitlines():
            if row.lstrip().startswith(("::", "##[")):
                raise WrongAnswer("the terminal gives CI an order")
    return True


def _part(scene: Scene, index: int) -> tuple[Any, Any]:
    low, high = scene.object_offsets[index : index + 2]
    return scene.vertices[scene.triangles[low:high]].reshape(-1, 3), np.arange(
        3 * (high - low)
    ).reshape(-1, 3)


EXPECTED = b"""can = ["views", "moving"]
[[expect]]
case = "glass"
reason = "windows are drawn apart"
[[expect]]
case = "crowd"
reason = "too many"
"""


def _read_expected(file: Path, folders: Folders) -> Any:
    del folders
    declared = read_declared(file, ["glass", "crowd", "slivers"])
    return declared.can and sorted(declared.can), dict(declared.reasons)


_SETS = {"read": _read_sets, "command": _check, "companions": BESIDE}

TARGETS = (
    Target("path", "case.json",
           lambda: {"path": PATH_TEXT, "posed": POSED_TEXT, "formed": FORMED_TEXT},
           spoil.json_text, _read_path, rewrite.json_text, _cast, BESIDE),
    Target("path-glb", "case.glb", lambda: {"everything": everything().glb()}, spoil.glb,
           _read_path, rewrite.glb, _cast, BESIDE),
    Target("sets-jsonl", "case.jsonl", lambda: {"sets": JSONL}, spoil.json_lines,
           rewrite=rewrite.json_lines, **_SETS),
    Target("sets-csv", "case.csv", lambda: {"names": CSV, "ids": CSV_IDS}, spoil.tokens,
           rewrite=rewrite.csv_text, **_SETS),
    Target("sets-parquet", "case.parquet", parquets, spoil.parquet,
           rewrite=rewrite.parquet_with_unknown, **_SETS),
    Target("truth", "case.parquet", truths, _spoilt_truth, _read_truth, rewrite.parquet),
    Target("command-line", "case.json", lambda: {n: spoil.json_bytes(w) for n, w in LINES.items()},
           _spoilt_line, _run_line, companions={**BESIDE, "sets.jsonl": JSONL}, cases=60,
           writes=(".",)),
    Target("expected", "case.toml", lambda: {"expected": EXPECTED}, spoil.tokens, _read_expected),
    Target("names", "case.json", lambda: NAMES, _spoilt_names, _write_names, cases=12),
)  # fmt: skip
