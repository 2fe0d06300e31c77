"""Schema, writer and reader agree: what is written fits, and reader and schema refuse the same.

That run folders fit is checked wherever a test writes one (`tests/conftest.py`).
"""

from __future__ import annotations

import copy
import json
import math
import tempfile
from collections.abc import Iterator
from dataclasses import fields, replace
from datetime import date
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.labels.test_closed_forms import CAMERA
from tests.labels.test_silhouettes import labelled
from tests.search.test_shrinking import once, suspect_of
from tests.support import report_runs
from tests.support.hand_made import still_path
from tests.support.truth_scenes import build, quad
from visref.batch.plan import jobs_of
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath, Frame
from visref.conformance.contest import Row, results_json, run_rows
from visref.conformance.declared import Declared
from visref.conformance.files import manifest_of, written_cases
from visref.conformance.suite import Judged
from visref.culler import QueryStats
from visref.errors import InputError
from visref.judging.policy_file import policy_of
from visref.labels.table import SCHEMA as LABEL_COLUMNS
from visref.labels.table import LabelTable
from visref.recordings import read_recording, read_visible_sets
from visref.run_folder.claims import read_witness
from visref.run_folder.facts import read_manifest, read_verdict
from visref.run_folder.json_fields import Fields
from visref.run_folder.layout import COUNTS
from visref.schemas import NAMES, schema
from visref.search.fault_folder import write_fault
from visref.search.folder import Fault, Key, SearchFolder, Tally, read_summary
from visref.search.judging import Kind, Violation

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with a miss, findings and pictures."""
    return report_runs.write_runs(tmp_path_factory.mktemp("runs"))["violation"]


def path_json() -> dict[str, Any]:
    """A path whose frames are of both projections, one with every field, one with several views
    that stand still and one with all that may move."""
    pose = look_at((0.0, 0.0, 3.0), (0.0, 0.0, -5.0))
    first = Camera(pose, 64, 48, near=0.1, far=50.0, yfov=1.0, shift_x_px=0.5, cut=True)
    second = Camera(pose, 64, 48, near=0.1, far=math.inf, ymag=2.0, shift_y_px=-0.25)
    views = (replace(first, view="left"), replace(second, view="right", cut=True))
    moved = Frame(
        (replace(first, cut=False, clip_plane=(0.0, 1.0, 0.0, 0.5)),),
        time_s=0.25,
        clip="walk",
        world_from_object={"lift": np.diag([1.0, 2.0, 1.0, 1.0])},
        absent=("door",),
        levels={"tree": 1},
    )
    path = CameraPath((first, second, Frame(views), moved)).to_json()
    frames = [*path["frames"], *given_otherwise(first)]
    return {**path, "frames": frames, "fps": 24}


def given_otherwise(camera: Camera) -> list[dict[str, Any]]:
    """Frames that give a camera in other forms, with the fields that each needs."""
    flat = camera.camera_from_world.reshape(-1).tolist()
    clip = {"clip_depth": "-1..1", "clip_y": "up"}
    clip_matrix = {"column_major": camera.clip_from_world().T.reshape(-1).tolist()}
    return [
        {"yfov": 1.0, "camera_from_world": {"row_major": flat}},
        {"clip_from_world": clip_matrix, **clip},
        {"yfov": 1.0, "eye": [0.0, 0.0, 3.0], "target": [0.0, 0.0, -5.0], "up": [0.0, 2.0, 0.0]},
        {"ymag": 1.0, "position": [0.0, 0.0, 3.0], "rotation": [0.0, 0.0, 0.0, 1.0]},
    ]


LINE = {
    "frame": 1,
    "visible": {"left": [0, "wall"], "right": []},
    "stats": {"queries": 7, "ms": {"cull": 1.5}},
    "note": "whatever",
}


# The other kind of line that a recording has.
HEADER = "recording header"


def recorded_header() -> dict[str, Any]:
    top = {name: value for name, value in path_json().items() if name != "frames"}
    return {**top, "format": "visref-recording", "groups": {"pair": [0, "pillar"]}, "units": None}


# What a frame may say, and is the header's where it does not.
SHARED = {"width": 8, "height": 6, "near": 0.1, "far": None, "yfov": 1.0}


def recorded_frame(shared: dict[str, Any] = SHARED) -> dict[str, Any]:
    """The frame of the path with all that may move, and what was drawn."""
    drawn = {"visible": [0, "wall"], "bounds": {"wall": [[0, 0, 0], [1, 2.5, 3]]}}
    return {**shared, **path_json()["frames"][3], **drawn, "frame": 3, "stats": LINE["stats"]}


def two_frames() -> CameraPath:
    """Of which the second has two views."""
    (camera,) = still_path(1).cameras
    eyes = tuple(replace(camera, view=view) for view in ("left", "right"))
    return CameraPath([camera, Frame(eyes)])


POLICY = {
    "latency_frames": 2,
    "min_samples": 8,
    "max_undecided": 0.25,
    "severities": {"IMAGE_DIFFERS": "error"},
    "waive": [
        {"object": "house/*", "frames": [3, "5:9:2"], "reason": "moved by #12", "culler": "*",
         "expires": "2030-01-31"},
        {"object": "door", "frames": "7:", "reason": "known"},
    ],
}  # fmt: skip


BATCH = {
    "options": {"engine": "embree", "pictures": 2, "lenient": True, "time_limit": 2.5},
    "job": [{"name": "one", "scene": "s.glb", "cullers": ["none"], "truth": "t.parquet"}],
    "matrix": [{"scenes": ["a.glb"], "paths": ["p.json"], "cullers": ["none"], "frames": "0:9"}],
}


def label_row() -> Any:
    """A row of a label file, of an object that is hidden in part."""
    scene = build(quad(CAMERA, (4, 4, 12, 12), 5.0), quad(CAMERA, (8, 4, 16, 12), 3.0))
    table = LabelTable(scene)
    table.add(0, labelled(scene, CAMERA))
    path = CameraPath((CAMERA,))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "labels.parquet"
        table.write(file, engine="exact", exact=True, scene=scene.digest, path=path)
        return pq.read_table(file).to_pylist()[0]


def valid(run, name: str) -> Any:
    if name == "batch":
        return BATCH
    if name == "policy":
        return POLICY
    if name == "labels":
        return label_row()
    if name == "manifest":
        policy = replace(policy_of(POLICY), today=date(2029, 12, 1), source="visref.toml")
        return {**json.loads((run / "manifest.json").read_text()), "policy": policy.to_json()}
    if name == "path":
        return path_json()
    if name == "visible_sets":
        return LINE
    if name == HEADER:
        return recorded_header()
    if name == "recording":
        return recorded_frame()
    if name == "conformance":
        return manifest_of(written_cases(), 0)
    if name == "conformance_results":
        row = Row("glass", "what is right", "what is wrong", ("masks",), lambda: Judged(()))
        declared = Declared(None, {"glass": "windows are drawn apart"})
        return results_json("engine", 0, list(run_rows([row], declared)))
    if name == "fault":
        with tempfile.TemporaryDirectory() as folder:
            write_fault(Path(folder), once("last-answer").shrunk, suspect_of("last-answer"))
            return json.loads((Path(folder) / "expected.json").read_text())
    if name == "fuzz":
        return searched()
    if name == "witness":
        (file,) = (run / "witnesses").glob("module_Forgets-*.jsonl")
        return json.loads(file.read_text().splitlines()[0])
    return json.loads((run / f"{name}.json").read_text())


def searched() -> dict[str, Any]:
    """The summary of a search that found something, of which one fault has no smallest scene."""
    miss = Violation(Kind.MISSED, 2, "", 1, "post", 3, 3, 7, 0, 5, 4.5, cause="one-frame-late")
    hidden = Violation(Kind.SUPERFLUOUS, 0, "left", 0, "wall", 9, 0, 1, 1, 2, math.nan, "left", 4)
    faults = [Fault(Key.of(one), 11, {}, [], one) for one in (miss, hidden)]
    faults[0].folder, faults[0].structure, faults[0].objects = "faults/001", "2 objects", 2
    faults[1].note = "trial 11 does not show it by itself"
    tally = Tally(32, 30, 1, 1, 2, 5, "it raised", 4)
    return SearchFolder(Path("found"), {"culler": "x", "seed": 0}, tally, faults).summary()


def read(name: str, value: Any, folder) -> None:
    """Read a value with the reader of that name."""
    if name == "verdict":
        read_verdict(value, "verdict.json", 2)
    elif name == "manifest":
        read_manifest(value, "manifest.json")
    elif name == "witness":
        read_witness(Fields(value, "witness", ""))
    elif name == "policy":
        policy_of(value)
    elif name == "batch":
        jobs_of(value)
    elif name == "fuzz":
        read_summary(value)
    elif name == "path":
        CameraPath.from_json(value)
    elif name.startswith("recording"):
        lines = [value, recorded_frame({})] if name == HEADER else [recorded_header(), value]
        file = folder / "run.jsonl"
        file.write_text("\n".join(map(json.dumps, lines)) + "\n")
        read_recording(file, report_runs.scene())
    else:
        file = folder / "sets.jsonl"
        file.write_text("\n".join(map(json.dumps, [{"frame": 0, "visible": []}, value])))
        read_visible_sets(file, report_runs.scene(), range(2), two_frames())


def places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where a value stands, of all values in parsed JSON; of long lists the first ones."""
    yield at
    inner = value.items() if isinstance(value, dict) else ()
    if isinstance(value, list):
        inner = enumerate(value[:2])
    for key, part in inner:
        yield from places(part, (*at, key))


def changed(value: Any, at: tuple[Any, ...], to: Any) -> Any:
    """The value with another in one place, or with nothing there where `to` is Ellipsis. What does
    not lie on the way there is the same object, which no reader writes into."""
    if not at:
        return to
    spoilt = copy.copy(value)
    if len(at) == 1 and to is ...:
        del spoilt[at[0]]
    else:
        spoilt[at[0]] = changed(value[at[0]], at[1:], to)
    return spoilt


OTHERS: tuple[Any, ...] = (
    None, True, -1, 0, 1.5, "x", [], {}, [None], ..., 1 << 63, 10**400, "inf", "0x1p+9999",
    "../x", "pictures/../../x.png",
)  # fmt: skip


def variants(value: Any) -> Iterator[tuple[str, Any]]:
    """Each value in it replaced by values of every kind, or left out."""
    for at in places(value):
        for to in OTHERS:
            if at or to is not ...:
                yield f"{at}: {to!r}", changed(value, at, to)


@pytest.mark.parametrize("name", [*NAMES, HEADER])
def test_schema_is_one_and_every_property_is_known_to_the_writer(name, run):
    of = schema(name.split()[0])
    jsonschema.Draft202012Validator.check_schema(of)
    jsonschema.validate(valid(run, name), of)


def test_the_schema_of_labels_has_the_columns_of_the_file():
    assert list(schema("labels")["properties"]) == LABEL_COLUMNS.names


def test_a_recordings_frames_are_a_paths_with_what_was_drawn():
    path, recording = schema("path"), schema("recording")
    sets = schema("visible_sets")
    for name, part in {**path["$defs"], **sets["$defs"]}.items():
        if name != "frame":
            assert recording["$defs"][name] == part
    frame = recording["$defs"]["frame"]["properties"]
    assert {**sets["properties"], **path["$defs"]["frame"]["properties"]} == {
        **frame, "frame": sets["properties"]["frame"]
    }  # fmt: skip
    top = recording["$defs"]["header"]["properties"]
    given = set(path["properties"]) - {"frames"}
    assert set(top) - given == {"groups", "units"}
    for name in given - {"format"}:
        assert top[name] == path["properties"][name]


def test_no_schema_has_another_name():
    with pytest.raises(KeyError):
        schema("../pyproject")


def test_counts_and_counters_are_those_of_the_code():
    culler = schema("verdict")["$defs"]["culler"]["properties"]
    assert set(COUNTS) <= set(culler)
    stats = schema("visible_sets")["properties"]["stats"]["properties"]
    assert set(stats) == {field.name for field in fields(QueryStats)}


# How many of the variants are refused, at least: a check that refuses nothing proves nothing.
@pytest.mark.parametrize(
    ("name", "least", "alone"),
    [
        ("batch", 150, False),
        ("fuzz", 200, False),
        ("manifest", 300, False),
        ("path", 300, True),
        ("policy", 100, False),
        ("verdict", 300, False),
        ("visible_sets", 40, True),
        ("witness", 300, False),
        ("recording", 200, True),
        (HEADER, 50, True),
    ],
)
def test_the_reader_refuses_what_the_schema_refuses_and_nothing_else(
    name, least, alone, run, tmp_path
):
    """`alone`: the reader refuses more, such as what lies in another file."""
    validator = jsonschema.Draft202012Validator(schema(name.split()[0]))
    refused = 0
    for what, value in variants(valid(run, name)):
        if validator.is_valid(value):
            if not alone:
                try:
                    read(name, value, tmp_path)
                except InputError as error:
                    pytest.fail(f"{what} fits the schema: {error}")
            continue
        refused += 1
        with pytest.raises(InputError) as caught:
            read(name, value, tmp_path)
            pytest.fail(f"{what} was read")
        assert "\n" not in str(caught.value)
    assert refused >= least


@pytest.mark.parametrize("name", ["fuzz", "manifest", "policy", "verdict", "witness"])
def test_keys_that_nobody_knows_are_ignored(name, run, tmp_path):
    value = valid(run, name)
    for at in places(value):
        inner = value
        for key in at:
            inner = inner[key]
        # Where names are anybody's, a further one is no unknown key.
        free = at and at[-1] in (
            "ages", "asked", "cullers", "files", "samples", "settings", "severities", "versions"
        )  # fmt: skip
        if isinstance(inner, dict) and not free and "samples" not in at[:1]:
            more = changed(value, at, {**inner, "someday": 1})
            jsonschema.validate(more, schema(name))
            read(name, more, tmp_path)


def test_a_set_for_all_views_fits_too(tmp_path):
    line = {**LINE, "visible": LINE["visible"]["left"]}
    jsonschema.validate(line, schema("visible_sets"))
    read("visible_sets", line, tmp_path)


def test_a_path_that_the_reader_takes_and_the_schema_too_may_say_all_in_its_frames():
    value = path_json()
    shared = {name: value.pop(name) for name in ("width", "height", "near")}
    for frame in value["frames"]:
        # A view may say it as well as its frame.
        for part in frame["views"].values() if "views" in frame else (frame,):
            part.update({**shared, **part})
    jsonschema.validate(value, schema("path"))
    CameraPath.from_json(value)
    del value["frames"][1]["near"]
    assert not jsonschema.Draft202012Validator(schema("path")).is_valid(value)
    with pytest.raises(InputError, match="near is missing"):
        CameraPath.from_json(value)
