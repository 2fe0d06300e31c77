"""Scenes by name: a generator states its options by its keyword arguments."""

from __future__ import annotations

import json
from importlib.metadata import EntryPoint, EntryPoints, entry_points

import numpy as np
import pytest

import visref.registry
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.generators import find_generator, options_of
from visref.inputs import generated_with, open_scene
from visref.registry import SCENES, available

MADE = []


class Squares:
    """What a generator from outside returns: any two files that visref reads."""

    def __init__(self, name, count, frames):
        self.name, self.count, self.frames = name, count, frames

    def write(self, directory):
        lines = []
        for k in range(self.count):
            lines += [f"o square{k}", f"v {k} 0 0", f"v {k + 1} 0 0", f"v {k} 1 0", "f -3 -2 -1"]
        scene = directory / "squares.obj"
        directory.mkdir(exist_ok=True)
        scene.write_text("\n".join(lines))
        camera = Camera(look_at((0, 0, 5), (0, 0, 0)), 8, 8, near=0.1, yfov=1.0)
        path = CameraPath((camera,) * self.frames, "")
        (directory / "walk.json").write_text(json.dumps(path.to_json()))
        return scene, directory / "walk.json"


def squares(*, count: int = 2, frames: int = 3, gap: float = 0.5, open: bool = True, by: str = "x"):
    if count < 1:
        raise InputError(f"the count is {count}", place="count", fix="give 1 or more")
    MADE.append((count, gap, open, by))
    return Squares("squares", count, frames)


def several(*, seed: int = 0, frames: int | None = None):
    return [Squares("one", 1, 1), Squares("two", 1, 1)]


@pytest.fixture(autouse=True)
def outside(monkeypatch):
    points = [EntryPoint(name, f"{__name__}:{name}", SCENES) for name in ("squares", "several")]
    installed = entry_points(group=SCENES)
    monkeypatch.setattr(
        visref.registry, "entry_points", lambda group: EntryPoints([*installed, *points])
    )
    MADE.clear()


def test_a_generator_from_outside_is_opened_by_name_with_its_own_options(tmp_path):
    spec = "squares:count=4,gap=2,open=no,by=y"
    scene, path, notes = open_scene(spec)
    assert MADE == [(4, 2.0, False, "y")]
    assert scene.names == ("square0", "square1", "square2", "square3")
    assert (scene.source, path.source, len(path), notes) == (spec, spec, 3, ())


def test_what_was_made_is_recorded_defaults_included():
    assert generated_with("squares:gap=2") == {
        "count": 2,
        "frames": 3,
        "gap": 2.0,
        "open": True,
        "by": "x",
    }


def test_kept_files_are_read_again_and_not_made_again(tmp_path):
    first, _, _ = open_scene("squares:count=3", kept_in=tmp_path / "kept")
    again, path, _ = open_scene("squares:count=3", kept_in=tmp_path / "kept")
    assert len(MADE) == 1
    assert np.array_equal(first.vertices, again.vertices)
    assert len(path) == 3


@pytest.mark.parametrize(
    ("spec", "problem"),
    [
        ("squares:cuont=3", r"no option 'cuont'; did you mean 'count'\?"),
        ("squares:zzz=3", "no option 'zzz'; known are count, frames, gap, open, by"),
        ("squares:count=many", "'count=many' in 'squares:count=many' is not a int"),
        ("squares:count=0", "count: the count is 0"),
        ("squares:open=perhaps", "is not a bool"),
        ("squares:count", "is not option=value"),
        ("several", r"a set of 2 scenes \(one, …\), not one"),
        ("several:frames=2", "no option 'frames'"),
        ("squaers", "no generated scene of that name; did you mean 'squares'"),
        ("circles:count=2", "no generated scene of that name"),
        ("xyzzy", "`visref scenes` lists them"),
        ("squares.glb", "there is no such file; check the name"),
    ],
)
def test_a_wrong_option_is_one_clear_line(spec, problem):
    with pytest.raises(InputError, match=problem):
        open_scene(spec)


def test_a_file_of_a_generators_name_is_the_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "squares").mkdir()
    with pytest.raises(InputError, match="this is not a file"):
        open_scene("squares")
    assert generated_with("squares") == {}


def test_every_installed_generator_states_its_options():
    for name in available(SCENES).keys() - {"squares"}:
        generator = find_generator(name)
        assert generator is not None
        assert "seed" in options_of(generator.make)
