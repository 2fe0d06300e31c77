"""`visref fuzz` finds a planted fault, finds nothing in what is sound, writes the same bytes for
the same trials, and goes on where it stopped."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from tests.examples.test_c_culler import FILES, compiled
from tests.search.test_shrink import written
from tests.wrong_cullers import WRONG
from visref.cli.main import main
from visref.culler import Culler, DrawnSet
from visref.errors import InputError
from visref.plug_ins import Making
from visref.schemas import schema
from visref.search.case import Case
from visref.search.folder import read_summary
from visref.search.fuzz import fuzz
from visref.search.judging import verdict_of
from visref.search.suspects import Made
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


def search(out: Path, culler: str = PLANTED, trials: int = 16, **asked: Any) -> int:
    """A search in this process; returns its exit status."""
    workers = asked.pop("workers", 1)
    given = Asked(culler=culler, making=Making(in_process=True), **asked)
    return int(fuzz(given, out, trials=trials, workers=workers).exit)


def bytes_of(folder: Path) -> dict[str, bytes]:
    files = (file for file in folder.rglob("*") if file.is_file())
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


def summary(out: Path) -> dict:
    value = json.loads((out / "summary.json").read_text())
    jsonschema.validate(value, schema("fuzz"))
    return read_summary(value)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    out = tmp_path_factory.mktemp("found") / "out"
    assert search(out) == 1
    return out


def test_a_planted_fault_is_found_in_few_trials(found):
    told = summary(found)
    assert (told["trials"], told["exit_status"]) == (16, 1)
    assert 0 < told["violating"] <= told["judged"] <= 16
    assert told["violations"] >= told["violating"]


def test_each_distinct_fault_has_a_folder_of_its_own_that_shows_it(found):
    faults = summary(found)["faults"]
    folders = [one["folder"] for one in faults]
    assert folders == [f"faults/{number:03d}" for number in range(1, len(folders) + 1)]
    assert sorted(file.name for file in (found / "faults").iterdir()) == [
        folder.removeprefix("faults/") for folder in folders
    ]
    for one in faults:
        expected = json.loads((found / one["folder"] / "expected.json").read_text())
        assert expected["violation"] == one["violation"]
        assert (expected["objects"], expected["triangles"]) == (one["objects"], one["triangles"])
        made = Case.read(found / one["folder"])
        verdict = verdict_of(made, Made(PLANTED, WRONG["corners-only"].culler), engine="exact")
        lost = {(v.name, v.frame, v.samples) for v in verdict.violations}
        told = one["violation"]
        assert (told["object_name"], told["frame"], told["samples"]) in lost


def test_faults_whose_smallest_scenes_are_alike_are_one(found):
    faults = summary(found)["faults"]
    alike = [(one["kind"], one["cause"], one["structure"]) for one in faults]
    assert len(set(alike)) == len(alike)
    # More trials than one led to the first.
    assert faults[0]["trials"] > 1


def test_nothing_is_found_in_what_draws_everything(tmp_path):
    assert search(tmp_path / "none", HERE + "Sound") == 0
    told = summary(tmp_path / "none")
    assert (told["violations"], told["faults"], told["exit_status"]) == (0, [], 0)
    assert told["judged"] > 10
    assert not (tmp_path / "none" / "faults").exists()


def test_a_search_in_parts_writes_the_same_bytes(found, tmp_path):
    """Parts that end within a round."""
    for trials in (7, 16):
        search(tmp_path / "parts", trials=trials)
    assert bytes_of(tmp_path / "parts") == bytes_of(found)
    assert len(bytes_of(found)) > 15


def test_a_search_that_is_stopped_keeps_what_it_tried_and_goes_on(found, tmp_path, monkeypatch):
    monkeypatch.setattr("visref.search.fuzz._WRITTEN_EVERY_S", 0.0)
    out, told = tmp_path / "out", []

    def stop(folder, doing):
        told.append(folder.tally.trials)
        if told[-1] == 7:
            raise KeyboardInterrupt

    asked = Asked(culler=PLANTED, making=Making(in_process=True))
    with pytest.raises(KeyboardInterrupt):
        fuzz(asked, out, trials=16, shown=stop)
    assert json.loads((out / "summary.json").read_text())["trials"] == 6
    search(out)
    assert bytes_of(out) == bytes_of(found)


@pytest.mark.slow
def test_the_same_trials_write_the_same_bytes_by_any_number_of_workers(tmp_path):
    search(tmp_path / "one", trials=40)
    search(tmp_path / "two", trials=40, workers=2)
    assert bytes_of(tmp_path / "one") == bytes_of(tmp_path / "two")


def test_other_seeds_try_other_scenes(tmp_path):
    for seed in (0, 1):
        search(tmp_path / str(seed), HERE + "Sound", 2, seed=seed)
    first, second = (bytes_of(tmp_path / seed / "corpus") for seed in ("0", "1"))
    assert first["000000.json"] != second["000000.json"]


def test_who_breaks_down_is_not_called_sound(tmp_path):
    assert search(tmp_path / "out", HERE + "Breaks") == 3
    told = summary(tmp_path / "out")
    assert told["broke_down"] > 0
    assert told["failed"] == "ValueError: more than two"


def test_who_promises_nothing_breaks_no_promise(tmp_path):
    assert search(tmp_path / "out", HERE + "Nothing", 4) == 0
    assert summary(tmp_path / "out")["faults"] == []


def test_scenes_that_a_culler_is_not_for_are_skipped(tmp_path):
    search(tmp_path / "out", HERE + "Sound", 16, can=frozenset())
    told = summary(tmp_path / "out")
    assert 0 < told["skipped"] < 16
    assert told["judged"] + told["skipped"] <= 16


@pytest.fixture(scope="module")
def houses(tmp_path_factory) -> str:
    """A scene of one's own."""
    folder = written("walk_through_a_city", tmp_path_factory.mktemp("houses"))
    return str(folder / "scene.glb")


def test_views_of_a_scene_find_what_is_missed_there(houses, tmp_path):
    scene = houses
    assert search(tmp_path / "views", scene=scene) == 1
    told = summary(tmp_path / "views")
    assert told["asked"]["scene"] == scene
    assert all(one["objects"] <= 2 and one["folder"] for one in told["faults"])


@pytest.mark.slow
def test_views_write_the_same_bytes_in_parts(houses, tmp_path):
    """What stands before a trial in its run of several is the same wherever a search stopped."""
    late = "tests.wrong_cullers.memory:LastFrustum"
    for name, parts in (("whole", (9,)), ("parts", (3, 9))):
        for trials in parts:
            search(tmp_path / name, late, trials, scene=houses)
    assert bytes_of(tmp_path / "whole") == bytes_of(tmp_path / "parts")


def command(out: Path, *arguments: str) -> int:
    return main(["fuzz", "--workers", "1", *arguments, "--out", str(out)])


def test_the_command_tells_what_it_found(tmp_path, capsys):
    """Of a culler in a process of its own; the search is the same there."""
    out = tmp_path / "apart"
    assert command(out, "--culler", PLANTED, "--trials", "6") == 1
    search(tmp_path / "here", trials=6)
    assert summary(out) == summary(tmp_path / "here")
    said = capsys.readouterr().out
    assert said.startswith("6 trials: ")
    assert "faults/001  missed" in said


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")
def test_a_program_s_fault_is_found_and_replays(tmp_path, monkeypatch):
    program = compiled(tmp_path, "NEAREST")
    out = tmp_path / "out"
    asked = ["--command", f"{program} {FILES}", "--trials", "12", "--can", "plain"]
    assert command(out, *asked) == 1
    fault = summary(out)["faults"][0]
    monkeypatch.chdir(out / fault["folder"])
    arguments = json.loads(Path("expected.json").read_text())["run"]
    assert main([*arguments, "--out", str(tmp_path / "run")]) == 1


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
    assert command(tmp_path / "out", *arguments) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert said in lines[0]
    assert not (tmp_path / "out").exists()


def test_what_stands_in_the_folder_is_never_replaced(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="no search"):
        search(tmp_path / "mine", HERE + "Sound")
    assert bytes_of(tmp_path / "mine") == {"notes.txt": b"mine"}


def test_another_search_is_not_gone_on_with(tmp_path):
    out = tmp_path / "out"
    search(out, HERE + "Sound", 2)
    before = bytes_of(out)
    for asked in ({"culler": PLANTED}, {"culler": HERE + "Sound", "seed": 1}):
        with pytest.raises(InputError, match="another search"):
            search(out, trials=8, **asked)
    assert bytes_of(out) == before


@pytest.mark.slow
def test_a_scene_that_is_another_since_is_not_gone_on_with(tmp_path):
    scene, out = tmp_path / "scene.glb", tmp_path / "out"
    for name, trials in (("coplanar_ties", 1), ("glass", 2)):
        shutil.copyfile(written(name, tmp_path / name) / "scene.glb", scene)
        if trials == 1:
            search(out, HERE + "Sound", trials, scene=str(scene))
    with pytest.raises(InputError, match="another search"):
        search(out, HERE + "Sound", 2, scene=str(scene))


@pytest.mark.parametrize("name", ["corpus/state.json", "corpus/000000.json"])
@pytest.mark.parametrize("text", ["", "[]", '{"format": "visref-fuzz-state"}'])
def test_a_spoilt_corpus_is_refused_in_one_line(name, text, tmp_path):
    out = tmp_path / "out"
    search(out, HERE + "Sound", 1)
    (out / name).write_text(text)
    with pytest.raises(InputError, match=name) as caught:
        search(out, HERE + "Sound", 4)
    assert "\n" not in str(caught.value)
