"""The reader of compiled maps, and what their PVS draws: on a map of three rooms that is written by
hand, on spoilt ones, and on those of OpenArena where `make engines` has brought them."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.examples.engines.recorded import ENGINES, rows_of_a_rerun
from tests.examples.engines.small_bsp import written
from visref.camera import Camera, look_at
from visref.cli.main import main
from visref.errors import InputError
from visref.memory import Budget

FOLDER = ENGINES / "bsp"
RECORD = FOLDER / "record.py"
ALL = [0, 1, 2, 3, 4, 5]
BLIND = np.array([[1, 1, 0], [1, 1, 1], [0, 1, 1]], bool)


@pytest.fixture(autouse=True)
def reader(tmp_path, monkeypatch):
    """The package as pip would have installed it."""
    info = tmp_path / "site" / "visref_bsp-1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: visref-bsp\nVersion: 1\n")
    told = (FOLDER / "pyproject.toml").read_text(encoding="utf-8")
    (line,) = (line for line in told.splitlines() if line.startswith("bsp = "))
    (info / "entry_points.txt").write_text(f"[visref.scene_formats]\n{line.replace(chr(34), '')}\n")
    monkeypatch.syspath_prepend(str(FOLDER))
    monkeypatch.syspath_prepend(str(info.parent))


def parsed(data: bytes):
    from visref_bsp.lumps import parse

    return parse(data)


def geometry(data: bytes):
    from visref_bsp.scene import placed

    return placed(parsed(data), Budget.of(None))


def record(*words: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, RECORD, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def drawn_from(bsp, x: float, towards: float, *, with_frustum: bool = False) -> list[int]:
    """`x`: of an eye in the middle of the rooms; it looks along x."""
    from visref_bsp.pvs import drawn

    pose = look_at((x, 0, 0), (x + towards, 0, 0))
    camera = Camera(world_from_camera=pose, width=16, height=16, near=4.0, far=1000.0, yfov=1.0)
    return drawn(bsp, camera, with_frustum=with_frustum)


def test_faces_stand_upright_and_look_to_where_they_are_seen_from():
    """z up becomes y up, and clockwise counterclockwise."""
    scene = geometry(written())
    assert scene.names == ["face0", "face1", "face2", "face3", "face4", "face5"]
    assert scene.paths[0] == "textures/wall/face0"
    wall = scene.meshes[0]
    expected = [[-50, -10, -10], [-50, 10, -10], [-50, 10, 10], [-50, -10, 10]]
    assert wall.positions.tolist() == expected
    for a, b, c in wall.positions[wall.triangles].astype(float):
        assert (np.cross(b - a, c - a)[0] < 0).all()  # seen from lesser x


def test_flares_and_what_is_not_drawn_keep_their_ids_and_doors_are_told_of():
    scene = geometry(written())
    assert scene.mesh_of_object == [0, 1, 2, 3, -1, -1]
    assert [text for _, text in scene.notes] == [
        "1 faces of doors, lifts and other entities are left out"
    ]


def test_a_patch_is_the_parabola_of_its_control_points():
    """At t the curve is (1 - t²) x + (1 - (1 - t)²) y, straight along z: the axis y here."""
    tube = geometry(written()).meshes[3]
    x, height, y = (tube.positions - [50, 0, -20]).T
    y = -y
    assert len(tube.triangles) == 2 * 8 * 8
    assert {*height.tolist()} == {step / 4 for step in range(9)}
    t = np.round(8 * (1 - np.sqrt(np.maximum(0, 1 - y)))) / 8
    assert np.allclose(x, 1 - t**2, rtol=0, atol=1e-12)
    assert np.allclose(y, 1 - (1 - t) ** 2, rtol=0, atol=1e-12)
    assert {*t.tolist()} == {step / 8 for step in range(9)}
    a, b, c = tube.positions[tube.triangles].transpose(1, 0, 2)
    chords = np.hypot(*np.diff([[1 - s**2, 1 - (1 - s) ** 2] for s in np.arange(9) / 8], axis=0).T)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(2 * chords.sum(), rel=1e-12)


@pytest.mark.parametrize(
    ("x", "leaf"), [(-1, 0), (0, 0), (1, 1), (100, 1), (101, 2), (1e9, 2), (-1e9, 0)]
)
def test_a_point_on_a_plane_is_behind_it(x, leaf):
    from visref_bsp.pvs import leaf_at

    assert leaf_at(parsed(written()), np.array([x, 3.0, 4.0])) == leaf


def test_a_leaf_draws_the_faces_of_the_leaves_that_its_cluster_sees():
    """Face 1 is in two leaves, and is drawn where one of them is seen."""
    only_itself = parsed(written(np.eye(3, dtype=bool)))
    assert drawn_from(only_itself, -25, 1) == [0]
    assert drawn_from(only_itself, 50, 1) == [1, 3, 4, 5]
    assert drawn_from(only_itself, 150, 1) == [1, 2]
    assert drawn_from(parsed(written(BLIND)), -25, 1) == [0, 1, 3, 4, 5]


def test_an_eye_in_the_solid_and_a_map_without_pvs_draw_all():
    solid = parsed(written(np.eye(3, dtype=bool), clusters=(-1, 1, 2)))
    assert drawn_from(solid, -25, 1) == [1, 2, 3, 4, 5]  # but what lies in the solid itself
    assert drawn_from(solid, 50, 1) == [1, 3, 4, 5]
    for nothing in (b"", bytes(8)):
        assert drawn_from(parsed(written(lumps={16: nothing})), -25, 1) == ALL


def test_the_frustum_leaves_out_the_leaves_behind_it_and_no_more():
    """A side that rises by tan(0.5) passes 100, the rooms' half width, 183 before the eye; behind
    it, the engine has no plane, so nearer rooms are drawn."""
    bsp = parsed(written())
    assert drawn_from(bsp, 282, 1, with_frustum=True) == [1, 2, 3, 4, 5]
    assert drawn_from(bsp, 284, 1, with_frustum=True) == [1, 2]
    assert drawn_from(bsp, 182, 1, with_frustum=True) == ALL
    assert drawn_from(bsp, 284, -1, with_frustum=True) == ALL


def test_a_way_through_the_rooms_is_cut_at_their_planes():
    from visref_bsp.pvs import way

    bsp = parsed(written())
    there = way(bsp, np.array([-100.0, 0, 0]), np.array([300.0, 0, 0]))
    assert there == [(0.0, 0.25, 0), (0.25, 0.5, 1), (0.5, 1.0, 2)]
    back = way(bsp, np.array([300.0, 0, 0]), np.array([-100.0, 0, 0]))
    assert back == [(0.0, 0.5, 2), (0.5, 0.75, 1), (0.75, 1.0, 0)]


def judged(data: bytes, folder: Path) -> tuple[int, dict, str]:
    """Exit status, sums and the ways, from one frame in the first room."""
    file, path = folder / "rooms.bsp", folder / "path.json"
    file.write_bytes(data)
    assert record("path", file, path, "--frames", "1", "--size", "32").returncode == 0
    done = record("draw", file, path, folder / "r.jsonl")
    assert done.returncode == 0, done.stderr
    words = ["check", str(file), "--recording", str(folder / "r.jsonl"), "--pictures", "0"]
    status = main([*words, "--out", str(folder / "run")])
    (sums,) = json.loads((folder / "run" / "verdict.json").read_text())["cullers"].values()
    return status, sums, record("ways", file, folder / "run").stdout


def test_a_right_pvs_is_clean(tmp_path):
    status, sums, ways = judged(written(), tmp_path)
    assert (status, sums["visible"], sums["missed"], ways.strip()) == (0, 3, 0, "")


def test_a_pvs_that_lacks_a_room_is_convicted_and_the_way_to_it_is_open(tmp_path):
    """From (-25, 0, 0) the far wall, 60 high at 175, shows beside the near one, 10 high at 75."""
    status, sums, ways = judged(written(BLIND), tmp_path)
    assert (status, sums["visible"], sums["missed"]) == (1, 3, 1)
    told = "through open clusters, the last not in the PVS of the first"
    lines = ways.splitlines()
    assert lines[0].startswith("frame 0, face2 (")
    assert lines[0].endswith(f"samples): {told}; clusters 0 1 2")
    assert lines[1:] == [f"1 {told}"]


def test_a_hole_in_what_the_pvs_counts_on_is_told_from_that(tmp_path):
    """The room between is solid for the PVS, so that neither wall beyond its plane is drawn."""
    status, _, ways = judged(written(BLIND, clusters=(0, -1, 2)), tmp_path)
    assert status == 1
    assert ways.splitlines()[-1] == "2 through what is solid"


def test_a_brush_that_the_author_has_put_in_the_way_is_told_from_that_too(tmp_path):
    names = (b"common/antiportal", b"textures/nodraw")
    shaders = b"".join(struct.pack("<64sII", name, 0x80 * at, 1) for at, name in enumerate(names))
    status, _, ways = judged(written(BLIND, lumps={1: shaders}), tmp_path)
    assert status == 1
    assert ways.splitlines()[-1] == "1 through an antiportal of the map's author"


def test_eyes_stand_where_players_do(tmp_path):
    file, path = tmp_path / "rooms.bsp", tmp_path / "path.json"
    file.write_bytes(written())
    assert record("path", file, path).returncode == 0
    frames = json.loads(path.read_text())["frames"]
    eyes = [frame["views"]["north"]["eye"] for frame in frames]
    assert eyes == [[-25, 0, 0], [50, 0, -5]]
    assert len(frames[0]["views"]) == 6


@pytest.mark.parametrize(
    ("lumps", "told"),
    [
        ({2: bytes(15)}, "planes: 15 bytes are no records of 16"),
        ({3: struct.pack("<9i", 0, 0, -1, *[0] * 6)}, "nodes[0]: there is no child 0 for it"),
        ({3: struct.pack("<9i", 0, -1, -9, *[0] * 6)}, "nodes[0]: there is no child -9 for it"),
        ({3: struct.pack("<9i", 2, -1, -2, *[0] * 6)}, "nodes[0]: it names plane 2 of 2"),
        ({4: b"", 3: b""}, "leaves: there is no leaf"),
        ({5: struct.pack("<7i", 0, 1, 3, 4, 5, 2, 7)}, "leaf_faces[6]: it names face 7 of 7"),
        ({6: struct.pack("<i", 1)}, "leaf_brushes[0]: it names brush 1 of 1"),
        ({6: b""}, "leaves[1]: it names brushes of leaves 0 to 1 of 0"),
        ({8: struct.pack("<3i", 0, 0, 2)}, "brushes[0]: it names shader 2 of 2"),
        ({7: b""}, "models: there is no world"),
        (
            {7: struct.pack("<6f4i", *[0.0] * 6, 0, 8, 0, 0)},
            "models[0]: it names faces 0 to 8 of 7",
        ),
        ({10: bytes(44)}, "faces[0]: it names vertices 0 to 4 of 1"),
        ({11: struct.pack("<6i", 0, 1, 2, 0, 2, 4)}, "faces[0]: a mesh vertex is none of its 4"),
        ({16: struct.pack("<2i", 3, 1)}, "visibility: 3 clusters of 1 bytes do not fit its 8"),
        ({16: struct.pack("<2i", 2**31 - 1, 2**31 - 1)}, "visibility: 2147483647 clusters"),
        ({16: struct.pack("<2i", 1, 1) + b"\1"}, "leaves[1]: it names cluster 1 of 1"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(lumps, told):
    with pytest.raises(InputError) as caught:
        geometry(written(lumps=lumps))
    assert str(caught.value).startswith(told)


def test_a_spoilt_file_is_refused_and_never_a_crash():
    data = written()
    for length in range(0, len(data), 7):
        with pytest.raises(InputError):
            parsed(data[:length])
    rng = np.random.default_rng(5)
    refused = 0
    for _ in range(300):
        spoilt = bytearray(data)
        for at in rng.integers(0, len(data), 4):
            spoilt[at] = rng.integers(256)
        try:
            geometry(bytes(spoilt))
        except InputError:
            refused += 1
    assert 50 < refused < 300


def test_both_programs_end_with_status_2_and_a_line(tmp_path, capsys):
    file = tmp_path / "cut.bsp"
    file.write_bytes(written()[:200])
    assert main(["objects", str(file)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "cut.bsp: entities: it lies at bytes 144 to " in line
    done = record("path", file, tmp_path / "path.json")
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert not (tmp_path / "path.json").exists()


@pytest.mark.slow
@pytest.mark.needs("openarena-081-maps")
def test_the_page_has_the_figures_of_a_rerun_on_real_maps(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", f"{FOLDER}{os.pathsep}{tmp_path / 'site'}")
    rows, unknown = rows_of_a_rerun("bsp", tmp_path)
    assert (len(rows), unknown) == (7, [])
