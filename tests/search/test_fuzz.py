"""`visref fuzz` finds a planted fault, finds nothing in what is sound, writes the same bytes for
the same trials, and goes on where it stopped."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from visref.cli.main import main
from visref.culler import Culler, DrawnSet
from visref.schemas import schema
from visref.search.folder import read_summary
from visref.search.fuzz import fuzz
from visref.search.trying import Asked

PLANTED = "tests.wrong_cullers.frustum:CornersOnly"
HERE = "tests.search.test_fuzz:"


class Sound(Culler):
    name = "sound"

    def update(self, scene):
        pass

    def cull(self, camera):
        return DrawnSet(np.arange(self.count, dtype=np.int32))

    def prepare(self, scene):
        units = super().prepare(scene)
        self.count = units.count
        return units


class Breaks(Sound):
    """Breaks down where there are more than two objects, and is sound elsewhere."""

    name = "breaks"

    def cull(self, camera):
        if self.count > 2:
            raise ValueError("more than two")
        return super().cull(camera)


class Nothing(Sound):
    """Draws nothing, and promises nothing."""

    name = "nothing"
    promise = "approximate"

    def cull(self, camera):
        return DrawnSet(np.zeros(0, np.int32))


def run(out: Path, *arguments: str) -> int:
    return main(["fuzz", "--workers", "1", "--in-process", *arguments, "--out", str(out)])


def bytes_of(folder: Path) -> dict[str, bytes]:
    files = (file for file in folder.rglob("*") if file.is_file())
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


def summary(out: Path) -> dict:
    value = json.loads((out / "summary.json").read_text())
    jsonschema.validate(value, schema("fuzz"))
    return read_summary(value)


def test_a_planted_fault_is_found_in_few_trials(tmp_path, capsys):
    out = tmp_path / "found"
    assert run(out, "--culler", PLANTED, "--trials", "16") == 1
    found = summary(out)
    assert (found["trials"], found["exit_status"]) == (16, 1)
    assert found["violating"] > 0
    assert found["violations"] >= found["violating"]
    assert found["faults"]
    assert "distinct fault" in capsys.readouterr().out


def test_nothing_is_found_in_what_draws_everything(tmp_path, capsys):
    out = tmp_path / "none"
    assert run(out, "--culler", HERE + "Sound", "--trials", "16") == 0
    found = summary(out)
    assert (found["violations"], found["faults"], found["exit_status"]) == (0, [], 0)
    assert found["judged"] > 10
    assert "No violation was found" in capsys.readouterr().out


def test_the_same_trials_write_the_same_bytes(tmp_path):
    """Once more, by two workers, and in parts that end within a round."""
    once, again, by_two, parts = (tmp_path / name for name in ("a", "b", "c", "d"))
    run(once, "--culler", PLANTED, "--trials", "40")
    run(again, "--culler", PLANTED, "--trials", "40")
    fuzz(Asked(culler=PLANTED), by_two, trials=40, workers=2)
    for trials in ("7", "33", "40"):
        run(parts, "--culler", PLANTED, "--trials", trials)
    first = bytes_of(once)
    assert len(first) > 10
    assert bytes_of(again) == bytes_of(by_two) == bytes_of(parts) == first


def test_other_seeds_try_other_scenes(tmp_path):
    for seed in ("0", "1"):
        run(tmp_path / seed, "--culler", HERE + "Sound", "--trials", "8", "--seed", seed)
    first, second = (bytes_of(tmp_path / seed / "corpus") for seed in ("0", "1"))
    assert first["000000.json"] != second["000000.json"]


def test_who_breaks_down_is_not_called_sound(tmp_path, capsys):
    assert run(tmp_path / "out", "--culler", HERE + "Breaks", "--trials", "16") == 3
    found = summary(tmp_path / "out")
    assert found["broke_down"] > 0
    assert found["failed"] == "ValueError: more than two"
    assert "It broke down first in trial" in capsys.readouterr().out


def test_who_promises_nothing_breaks_no_promise(tmp_path):
    assert run(tmp_path / "out", "--culler", HERE + "Nothing", "--trials", "8") == 0
    assert summary(tmp_path / "out")["faults"] == []


def test_scenes_that_a_culler_is_not_for_are_skipped(tmp_path):
    run(tmp_path / "out", "--culler", HERE + "Sound", "--trials", "24", "--can", "plain")
    found = summary(tmp_path / "out")
    assert 0 < found["skipped"] < 24
    assert found["judged"] + found["skipped"] <= 24


def test_views_of_a_scene_find_what_is_missed_there(tmp_path):
    out = tmp_path / "views"
    scene = "terrain_towers"
    assert run(out, "--culler", PLANTED, "--scene", scene, "--trials", "16") == 1
    assert summary(out)["asked"]["scene"] == scene
    assert run(tmp_path / "sound", "--culler", HERE + "Sound", "--scene", scene,
               "--trials", "8") == 0  # fmt: skip


def test_views_write_the_same_bytes_in_parts(tmp_path):
    """What stands before a trial in its run of several is the same wherever a search stopped."""
    late = "tests.wrong_cullers.memory:LastAnswer"
    for name, parts in (("whole", ("16",)), ("parts", ("3", "16"))):
        for trials in parts:
            run(tmp_path / name, "--culler", late, "--scene", "terrain_towers", "--trials", trials)
    assert bytes_of(tmp_path / "whole") == bytes_of(tmp_path / "parts")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--trials", "1"), "--culler or --command"),
        (("--culler", "none", "--command", "true {visible}"), "--culler or --command"),
        (("--culler", "no-such", "--trials", "1"), "no culler is named 'no-such'"),
        (("--culler", "none", "--trials", "0"), "--trials is 0"),
        (("--culler", "none", "--time", "-1"), "--time is -1"),
        (("--culler", "none", "--trials", "1", "--can", "flying"), "no class 'flying'"),
        (("--culler", "none", "--trials", "1", "--engine", "no-such"), "no-such"),
        (("--culler", "none", "--trials", "1", "--scene", "nowhere.glb"), "nowhere.glb"),
        (("--culler", "none", "--trials", "1", "--lenient"), "name a scene"),
    ],
)
def test_wrong_input_is_one_line(arguments, said, tmp_path, capsys):
    assert run(tmp_path / "out", *arguments) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert said in lines[0]
    assert not (tmp_path / "out").exists()


def test_what_stands_in_the_folder_is_never_replaced(tmp_path, capsys):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    assert run(tmp_path / "mine", "--culler", "none", "--trials", "1") == 2
    assert "no search" in capsys.readouterr().err
    assert bytes_of(tmp_path / "mine") == {"notes.txt": b"mine"}


def test_another_search_is_not_gone_on_with(tmp_path, capsys):
    out = tmp_path / "out"
    run(out, "--culler", HERE + "Sound", "--trials", "4")
    before = bytes_of(out)
    assert run(out, "--culler", PLANTED, "--trials", "8") == 2
    assert run(out, "--culler", HERE + "Sound", "--trials", "8", "--seed", "1") == 2
    assert capsys.readouterr().err.count("another search") == 2
    assert bytes_of(out) == before


@pytest.mark.parametrize("name", ["corpus/state.json", "corpus/000000.json"])
@pytest.mark.parametrize("text", ["", "{}", "[]", "{", '{"format": "visref-fuzz-state"}'])
def test_a_spoilt_corpus_is_refused_in_one_line(name, text, tmp_path, capsys):
    out = tmp_path / "out"
    run(out, "--culler", HERE + "Sound", "--trials", "2")
    (out / name).write_text(text)
    assert run(out, "--culler", HERE + "Sound", "--trials", "4") == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert name in lines[0]


def test_a_culler_in_a_process_of_its_own_is_tried_too(tmp_path):
    out = tmp_path / "apart"
    asked = ["fuzz", "--workers", "1", "--culler", HERE + "Breaks", "--trials", "6"]
    assert main([*asked, "--out", str(out)]) == 3
    run(tmp_path / "here", "--culler", HERE + "Breaks", "--trials", "6")
    assert bytes_of(out) == bytes_of(tmp_path / "here")
