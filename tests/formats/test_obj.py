"""OBJ files: objects in file order, indices as their line means them, any chunking."""

from __future__ import annotations

import numpy as np
import pytest

import visref.formats.obj
from visref.errors import InputError
from visref.formats import load_scene
from visref.scene import Alpha, Scene


def load(folder, text: str, **options) -> Scene:
    (folder / "scene.obj").write_text(text)
    return load_scene(folder / "scene.obj", **options)


def points(scene: Scene) -> list[list[list[float]]]:
    return scene.vertices[scene.triangles].tolist()


CORNERS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def test_objects_come_in_file_order_and_repeated_names_are_told_apart(tmp_path):
    text = CORNERS + "o z\nf 1 2 3\no a\nf 1 3 4\no empty\no z\nf 2 3 4\nf 1 2 4\n"
    scene = load(tmp_path, text)
    assert scene.names == ("z", "a", "empty", "z#2")
    assert np.diff(scene.object_offsets).tolist() == [1, 1, 0, 2]


def test_faces_before_the_first_object_are_one_too(tmp_path):
    scene = load(tmp_path, CORNERS + "f 1 2 3\no a\nf 1 3 4\n")
    assert scene.names == ("object", "a")


def test_groups_are_objects_where_no_o_line_stands(tmp_path):
    text = "g default\n" + CORNERS + "g wall 1\nf 1 2 3\ng door\nf 1 3 4\ng wall 1\nf 2 3 4\n"
    scene = load(tmp_path, text)
    assert scene.names == ("wall 1", "door")
    # The second piece of the wall joins the first, before the door.
    assert points(scene)[1] == [[1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert load(tmp_path, "o all\n" + text).names == ("all",)


def test_relative_indices_count_back_from_their_own_line(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3/1 -2/-9 -1\n"
    assert points(load(tmp_path, text)) == [
        [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
        [[5, 0, 0], [6, 0, 0], [5, 1, 0]],
    ]


def test_polygons_become_fans_and_two_corners_nothing(tmp_path):
    scene = load(tmp_path, CORNERS + "v 0 .5 0\nf 1 2 3 4 5\nf 1 2\nf 1 2 3\n")
    assert scene.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 1, 2]]


def test_what_is_not_geometry_is_passed_over(tmp_path):
    text = (
        "# a comment v 1 2 3\n\n  \t\nvn 0 0 1\nvt 0 0\nvp 1\ns off\nl 1 2\np 1\r\n"
        "v 0 0 0 1.0 # weight\nv\t1  0 0 .5 .5 .5\r\n v 1e0 1.0E+0 -0 \\\n 7\n"
        "f 1//1 2/1/1 3/1 # last 9 9\n"
    )
    assert points(load(tmp_path, text)) == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]]]


def test_error_names_the_line_in_any_chunk(tmp_path, monkeypatch):
    monkeypatch.setattr(visref.formats.obj, "_CHUNK_BYTES", 64)
    text = CORNERS * 50 + "f 1 2 x\n"
    with pytest.raises(InputError, match="line 201: 'x' is not a number"):
        load(tmp_path, text)


@pytest.mark.parametrize("size", [48, 61, 100, 1000])
def test_chunks_change_nothing(tmp_path, monkeypatch, size):
    rng = np.random.default_rng(0)
    lines = []
    for k in range(60):
        # Any three points, and a fourth that makes a flat convex quad of them.
        a, b, c = rng.normal(size=(3, 3)).round(6)
        lines += ["v {} {} {}".format(*point.round(6)) for point in (a, b, a + (c - b) / 2, c)]
        lines += [f"o part{k}"] if k % 7 == 0 else []
        lines += ["usemtl glass" if k % 2 else "usemtl stone", "f -4 \\", " -3 -1", "f -4 -3 -1 -2"]
    (tmp_path / "m.mtl").write_text("newmtl glass\nd 0.5\n")
    text = "mtllib m.mtl\n" + "\n".join(lines)
    whole = load(tmp_path, text)
    monkeypatch.setattr(visref.formats.obj, "_CHUNK_BYTES", size)
    assert load(tmp_path, text).digest == whole.digest


def test_materials_say_what_is_transparent(tmp_path):
    (tmp_path / "a b.mtl").write_text(
        "newmtl stone\nd 1.0\nKd 1 1 1\nnewmtl tinted glass\nd 0.3\nnewmtl leaf\nmap_d leaf.png\n"
    )
    text = CORNERS + (
        "mtllib a b.mtl\nf 1 2 3\nusemtl stone\nf 1 2 3\nusemtl tinted glass\nf 1 2 3\n"
        "usemtl leaf\nf 1 2 3 4\nusemtl unheard of\nf 1 2 3\n"
    )
    scene = load(tmp_path, text, cull_backfaces=True)
    names = [Alpha(a).name for a in scene.alpha]
    assert names == ["OPAQUE", "OPAQUE", "BLEND", "MASK", "MASK", "OPAQUE"]
    assert scene.one_sided.all()
    assert scene.notes == ()


def test_missing_material_file_is_a_finding(tmp_path):
    scene = load(tmp_path, CORNERS + "mtllib absent.mtl\nf 1 2 3\n")
    assert [code for code, _ in scene.notes] == ["PARTLY_READ"]


def test_numbers_are_read_as_exactly_as_python_reads_them(tmp_path):
    rng = np.random.default_rng(3)
    values = np.concatenate([rng.normal(size=300), rng.normal(size=300) * 1e-20]).reshape(-1, 3)
    lines = [f"v {a!r} {b:.17e} {c!r}" for a, b, c in values.tolist()]
    faces = [f"f {i} {i + 1} {i + 2}" for i in range(1, len(values) - 1)]
    scene = load(tmp_path, "\n".join(lines + faces))
    assert np.array_equal(scene.vertices, values.astype(np.float32))


@pytest.mark.parametrize(
    "last", ["f 1 2 3 \\", "f 1 2 3 # \\", "f 1 2 \\\n3\\", "o a\\", "mtllib\\"]
)
def test_backslash_at_the_end_of_the_file_continues_nothing(tmp_path, last):
    triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    faces = "" if last.startswith("f") else "f 1 2 3\n"
    scene = load(tmp_path, triangle + faces + last)
    assert scene.triangle_count == 1
