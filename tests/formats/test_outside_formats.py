"""Formats are found by extension, in an entry-point group that anybody may add to."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import EntryPoint, EntryPoints

import numpy as np
import pytest

import visref.formats.loading as loading
from tests.support.gltf_files import SQUARE, TWO
from visref.errors import InputError
from visref.findings import Code
from visref.formats import NO_MESH, Mesh, Placed, known_extensions, load_scene


def read_points(path):
    """A format of nobody's: a square for each line, moved along x by the number in it."""
    placed = Placed()
    placed.meshes.append(Mesh.plain(SQUARE, TWO.reshape(-1, 3)))
    for line in path.read_text().splitlines():
        world = np.eye(4)
        world[0, 3] = float(line)
        placed.add(f"at {line}", 0, world)
    placed.add("nothing", NO_MESH, np.eye(4))
    placed.notes.append((Code.PARTLY_READ, "a remark of the reader's"))
    return placed


def read_wrongly(path):
    return [path]


def read_out_of_range(path):
    placed = Placed()
    placed.meshes.append(Mesh.plain(SQUARE, TWO.reshape(-1, 3) + 1))
    placed.add("a", 0, np.eye(4))
    return placed


def refuses(path):
    raise InputError("it is not to my taste", place="line 3", fix="write another")


def register(monkeypatch, **readers):
    """The installed readers, and these."""
    ours = EntryPoints(
        EntryPoint(extension, f"{__name__}:{reader}", loading.FORMATS)
        for extension, reader in readers.items()
    )
    real = loading.entry_points

    def both(**chosen):
        assert chosen.pop("group") == loading.FORMATS
        return EntryPoints([*real(group=loading.FORMATS), *ours]).select(**chosen)

    monkeypatch.setattr(loading, "entry_points", both)


@pytest.fixture
def file(tmp_path):
    file = tmp_path / "squares.Pts"
    file.write_text("0\n10\n")
    return file


def test_a_format_from_outside_is_read_like_any_other(monkeypatch, file):
    register(monkeypatch, pts="read_points")
    scene = load_scene(file, cull_backfaces=True)
    assert scene.names == ("at 0", "at 10", "nothing")
    assert np.diff(scene.object_offsets).tolist() == [2, 2, 0]
    assert scene.bounds.tolist() == [[0, 0, 0], [11, 1, 0]]
    assert scene.one_sided.all()
    assert (Code.PARTLY_READ, "a remark of the reader's") in scene.notes
    assert "pts" in known_extensions()


def test_a_reader_from_outside_gets_an_extension_that_trimesh_would_read(monkeypatch, tmp_path):
    register(monkeypatch, xyz="read_points")
    (tmp_path / "a.xyz").write_text("5\n")
    assert load_scene(tmp_path / "a.xyz").names == ("at 5", "nothing")


@pytest.mark.parametrize(
    ("reader", "problem"),
    [
        ("read_wrongly", r"returned no visref\.formats\.Placed"),
        ("read_out_of_range", r"triangle 1 names vertex 4: index out of range 0…3"),
        ("refuses", "line 3: it is not to my taste; write another"),
    ],
)
def test_what_is_wrong_with_such_a_file_or_its_reader_is_one_line(
    monkeypatch, file, reader, problem
):
    register(monkeypatch, pts=reader)
    with pytest.raises(InputError, match=problem) as caught:
        load_scene(file)
    assert str(caught.value).startswith(str(file))


def test_two_readers_of_an_extension_are_refused_by_name(monkeypatch, tmp_path):
    register(monkeypatch, obj="read_points")
    (tmp_path / "a.obj").write_text("v 0 0 0\n")
    with pytest.raises(InputError, match=r"several readers: .*read_points.*formats\.obj:read_obj"):
        load_scene(tmp_path / "a.obj")


def test_a_reader_that_does_not_import_is_said(monkeypatch, file):
    point = EntryPoint("pts", "no_such_package:read", loading.FORMATS)
    monkeypatch.setattr(loading, "entry_points", lambda **_: EntryPoints([point]))
    with pytest.raises(InputError, match="does not import: No module named 'no_such_package'"):
        load_scene(file)


def test_an_unknown_extension_is_answered_by_those_that_are_read_and_no_archive(tmp_path):
    (tmp_path / "a.gtlf").write_text("x")
    with pytest.raises(InputError, match="did you mean 'gltf'") as caught:
        load_scene(tmp_path / "a.gtlf")
    known = str(caught.value).partition("known are ")[2].split(", ")
    assert {"glb", "gltf", "vrm", "obj", "ply", "off", "stl"} <= set(known)
    for archive in ("zip", "gz", "bz2", "tar.gz", "tar.bz2"):
        assert archive not in known
        (tmp_path / f"a.{archive}").write_bytes(b"x")
        with pytest.raises(InputError, match="this is an archive"):
            load_scene(tmp_path / f"a.{archive}")


def test_no_library_is_imported_before_a_file_needs_it(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    heavy = {"trimesh", "collada", "lxml", "DracoPy"}
    script = f"""
import sys
from visref.formats import load_scene
assert load_scene({str(tmp_path / "a.obj")!r}).triangle_count == 1
print(*({heavy} & set(sys.modules)))
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []
