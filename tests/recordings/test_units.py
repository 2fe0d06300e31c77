"""Units beside a recording: which triangles they have, what is refused, what a verdict tells."""

from __future__ import annotations

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.recordings.test_recording import HEADER, POSE, line, write
from tests.support.gltf_files import TRIANGLE, Gltf
from tests.support.hand_made import soup
from visref.cli.main import main
from visref.errors import InputError
from visref.recordings import read_recording, read_units

# Objects of 2, 3 and 1 triangles.
SCENE = soup([2, 3, 1])
HEAD = "unit,object,first_triangle,triangle_count\n"


def table(folder, text: str):
    file = folder / "u.csv"
    file.write_text(HEAD + text)
    return file


def test_units_are_the_triangles_of_their_rows(tmp_path):
    file = table(tmp_path, "1,1,0,2\n0,0,0,2\n1,2,0,1\n2,1,1,2\n")
    units = read_units(file, SCENE)
    assert [units.gather(np.array([i])).tolist() for i in range(3)] == [[0, 1], [2, 3, 5], [3, 4]]
    assert units.kind == "unit"


def test_parquet_and_names_say_the_same(tmp_path):
    rows = {
        "unit": [1, 0, 1, 2],
        "object": [SCENE.names[i] for i in (1, 0, 2, 1)],
        "first_triangle": [0, 0, 0, 1],
        "triangle_count": [2, 2, 1, 2],
    }
    pq.write_table(pa.table(rows), tmp_path / "u.parquet")
    by_name = read_units(tmp_path / "u.parquet", SCENE)
    by_id = read_units(table(tmp_path, "1,1,0,2\n0,0,0,2\n1,2,0,1\n2,1,1,2\n"), SCENE)
    assert by_name.offsets.tolist() == by_id.offsets.tolist()
    assert by_name.triangles.tolist() == by_id.triangles.tolist()


ALL = "0,0,0,2\n0,1,0,3\n0,2,0,1\n"
WRONG = {
    "a bare triangle": ("0,0,0,2\n0,1,0,2\n0,2,0,1\n", "first triangle 2 of object"),
    "beyond the object": ("0,0,1,2\n", "triangles 1 to 2 are not all of the 2 of object"),
    "before it": ("0,0,-1,2\n", "row 0: triangles -1 to 0"),
    "of none": ("0,0,0,0\n", "row 0"),
    "a number left out": (ALL + "2,0,0,1\n", "unit 2 comes after unit 0"),
    "not from zero": ("1,0,0,1\n", "the first unit is 1"),
    "unknown object": ("0,9,0,1\n", "row 0: object id 9 is not in the scene"),
    "unknown name": ("0,squid,0,1\n", "the scene has no object named 'squid'"),
    "no number": ("x,0,0,1\n", "row 0: unit is 'x'"),
    "a number without end": ("0,0,0," + "9" * 50 + "\n", "row 0: triangle_count is"),
    "nothing": ("", "there are no units in it"),
    "too few fields": ("0,0,0\n", "not as many fields"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_table_is_one_line(name, tmp_path):
    text, expected = WRONG[name]
    file = table(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_units(file, SCENE)
    assert str(caught.value).startswith(str(file))
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ({"unit": [0.5]}, "unit is of type double"),
        ({"object": [1.5]}, "object is of type double"),
        ({"unit": [None]}, "unit is of type null"),
        ({"object": [None]}, "a cell is empty"),
    ],
)
def test_parquet_of_other_types_is_refused(columns, expected, tmp_path):
    rows = {"unit": [0], "object": [0], "first_triangle": [0], "triangle_count": [1], **columns}
    pq.write_table(pa.table(rows), tmp_path / "u.parquet")
    with pytest.raises(InputError, match=expected):
        read_units(tmp_path / "u.parquet", SCENE)


def test_other_columns_other_endings_and_rubbish_are_refused(tmp_path):
    for name, data, expected in (
        ("u.csv", b"unit,object\n0,0\n", "columns are unit, object"),
        ("u.txt", b"", "units are .parquet or .csv"),
        ("u.parquet", b"PAR1", "not a Parquet file"),
        ("u.csv", b"\xff\xfe", "not UTF-8"),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(InputError, match=expected):
            read_units(tmp_path / name, SCENE)


def test_rows_that_expand_without_end_are_refused_before_they_do(tmp_path):
    file = table(tmp_path, ALL + "0,1,0,3\n" * 30_000)
    with pytest.raises(InputError, match="would need"):
        read_units(file, SCENE, max_memory=1 << 20)


def wall(folder) -> str:
    """A wall of two triangles before the camera, side by side: a square cut along its diagonal."""
    gltf = Gltf()
    corners = np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    indices = np.array([0, 1, 2, 0, 2, 3], "u2")
    gltf.node(mesh=gltf.mesh(gltf.primitive(corners, indices)), name="wall")
    file = folder / "wall.glb"
    file.write_bytes(gltf.glb())
    return str(file)


@pytest.mark.parametrize(("visible", "status"), [([0, 1], 0), ([0], 1), ([], 1)])
def test_half_of_a_walls_clusters_is_a_violation_though_the_wall_shows(tmp_path, visible, status):
    scene = wall(tmp_path)
    table(tmp_path, "0,wall,0,1\n1,wall,1,1\n")
    file = write(tmp_path, {**HEADER, "units": "u.csv"}, line(0, visible))
    out = tmp_path / "out"
    assert main(["check", scene, "--recording", str(file), "--out", str(out)]) == status
    (culler,) = json.loads((out / "verdict.json").read_text())["cullers"].values()
    assert culler["unit_kind"] == "unit"
    assert culler["partly_missed"] == (visible == [0])
    assert culler["missed_units"] == 2 - len(visible)


def test_units_are_listed_by_number_and_nothing_else(tmp_path):
    table(tmp_path, "0,0,0,2\n0,1,0,3\n1,2,0,1\n")
    header = {**HEADER, "units": "u.csv"}
    for drawn, expected in (
        (line(0, [2]), r"line 2: unit 2 is none of the units \(0…1\)"),
        (line(0, ["1"]), "line 2: '1' is a name, and the recording has units"),
        (line(0, ["squid"]), "line 2: 'squid' is a name, and the recording has units"),
        ({"frame": 0, "world_from_camera": POSE, "visible_nodes": [0]}, "visible_nodes, and"),
    ):
        with pytest.raises(InputError, match=expected):
            read_recording(write(tmp_path, header, drawn), SCENE)


def test_a_units_box_goes_by_its_number(tmp_path):
    table(tmp_path, "0,0,0,2\n0,1,0,3\n1,2,0,1\n")
    bounds = {"1": [[0, 0, 0], [1, 2, 3]]}
    file = write(tmp_path, {**HEADER, "units": "u.csv"}, line(0, [0], bounds=bounds))
    boxes = read_recording(file, SCENE).sets.boxes[0]
    assert boxes[1].tolist() == bounds["1"]
    assert np.isinf(boxes[0]).all()


def test_triangles_that_lenient_dropped_are_not_counted_past(tmp_path):
    gltf = Gltf()
    bad = np.concatenate([TRIANGLE * np.float32(np.nan), TRIANGLE])
    gltf.node(mesh=gltf.mesh(gltf.primitive(bad)), name="torn")
    scene = tmp_path / "torn.glb"
    scene.write_bytes(gltf.glb())
    table(tmp_path, "0,torn,0,1\n")
    file = write(tmp_path, {**HEADER, "units": "u.csv"}, line(0, [0]))
    command = ["check", str(scene), "--recording", str(file), "--lenient"]
    assert main([*command, "--out", str(tmp_path / "out")]) == 2
