"""`visref conformance --command`: a program in any language, held to the suite."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from visref.cli.main import main

# Names all nodes of the scene, in each view of each frame; `LEFT_OUT` at its end are left out.
ENGINE = """
import json, pathlib, sys

scene, path, visible = sys.argv[1:4]
data = pathlib.Path(scene).read_bytes()
nodes = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])["nodes"]
names = [node["name"] for node in nodes]
frames = json.loads(pathlib.Path(path).read_text())["frames"]
lines = [json.dumps({"frame": k, "visible": names[LEFT_OUT:]}) for k in range(len(frames))]
SAYS
pathlib.Path(visible).write_text("\\n".join(lines) + "\\n")
"""


@pytest.fixture
def engine(tmp_path):
    def written(left_out=0, says=""):
        file = tmp_path / "engine.py"
        file.write_text(ENGINE.replace("LEFT_OUT", str(left_out)).replace("SAYS", says))
        words = [sys.executable, str(file), "{scene}", "{path}", "{visible}"]
        return " ".join(shlex.quote(w) if "{" not in w else w for w in words)

    return written


def judged(tmp_path, command, *arguments):
    file = tmp_path / "results.json"
    more = [*map(str, arguments), "--json", str(file)]
    status = main(["conformance", "--command", command, *more])
    written = json.loads(file.read_text())
    assert written["engine"].endswith("engine.py")
    return status, {one["name"]: one for one in written["cases"]}


@pytest.mark.slow
def test_program_that_draws_everything_passes_and_clusters_are_not_run(tmp_path, engine, capsys):
    status, found = judged(tmp_path, engine())
    assert status == 0
    assert {one["result"] for one in found.values()} == {"passed", "not run"}
    not_run = [name for name, one in found.items() if one["result"] == "not run"]
    assert not_run == [name for name, one in found.items() if "clusters" in one["classes"]]
    assert re.search(r"^\d+ cases: \d+ passed, 3 not run\.$", capsys.readouterr().out, re.MULTILINE)


def test_program_that_loses_an_object_is_convicted_with_its_witness(tmp_path, engine):
    status, found = judged(tmp_path, engine(left_out=1), "--only", "crowd", "--only", "two_eyes")
    assert status == 1
    for name, lost in (("crowd", "'box' (object 0)"), ("two_eyes", "'board' (object 0)")):
        assert found[name]["problems"][0].startswith("MISSED_OBJECT: frame ")
        assert lost in found[name]["problems"][0]
        assert "witness: pixel (" in found[name]["problems"][0]


def test_program_is_run_for_no_case_that_it_is_not_made_for(tmp_path, engine):
    command = engine(says="raise SystemExit('it was asked')")
    status, found = judged(tmp_path, command, "--can", "plain", "--only", "two_eyes")
    assert (status, found["two_eyes"]["result"]) == (3, "not run")


@pytest.mark.parametrize(
    ("says", "told"),
    [
        (
            "raise SystemExit('no such thing')",
            "it ended with status 1; its last words: no such thing",
        ),
        ("raise SystemExit(0)", "it ended well, but {visible} was not written"),
        ("lines.pop()", "1 of 3 frames are missing"),
        ("lines[0] = '{'", "line 1"),
    ],
)
def test_program_that_breaks_down_fails_its_case(tmp_path, engine, says, told):
    status, found = judged(tmp_path, engine(says=says), "--only", "crowd")
    assert status == 1
    (problem,) = found["crowd"]["problems"]
    assert problem.startswith("CULLER_FAILED: ")
    assert told in problem


def test_program_that_takes_too_long_fails_its_case(tmp_path, engine):
    command = engine(says="import time; time.sleep(60)")
    status, found = judged(tmp_path, command, "--only", "crowd", "--time-limit", "1")
    assert status == 1
    assert "took longer than 1 s" in found["crowd"]["problems"][0]


def test_program_is_held_to_its_promise(tmp_path, engine):
    status, found = judged(tmp_path, engine(), "--only", "crowd", "--promise", "exact")
    assert status == 1
    assert found["crowd"]["problems"][0].startswith("DRAWN_HIDDEN")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--command", "no-such-program {scene} {path} {visible}"), "there is no program"),
        (("--command", "true {scene} {path}"), "no placeholder for the file that it writes"),
        (("--command", "true {visible}", "--raster", "snap=9"), "--raster snap=9"),
        (("--command", "true {visible}", "--time-limit", "0"), "--time-limit is 0"),
        (("--command", "true {visible}", "--suite", "x"), "--suite does not go with --command"),
        (("--command", "true {visible}", "--only", "crwod"), "did you mean 'crowd'"),
    ],
)
def test_wrong_arguments_are_bad_input(capsys, arguments, told):
    assert main(["conformance", *arguments]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1


SOURCE = Path(__file__).parent.parent.parent / "examples" / "c_culler" / "c_culler.c"


def compiled(folder, *switches):
    program = folder / "c_culler"
    flags = [f"-DBROKEN_{one}" for one in switches]
    command = ["gcc", "-std=c99", "-O2", *flags, "-o", str(program), str(SOURCE), "-lm"]
    subprocess.run(command, check=True)
    return f"{program} {{scene}} {{path}} {{visible}}"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")
def test_the_example_in_c_passes_and_its_broken_twin_is_convicted(tmp_path, capsys):
    arguments = ["conformance", "--command", compiled(tmp_path)]
    assert main(arguments) == 0
    assert re.search(r"^\d+ cases: \d+ passed, 3 not run\.$", capsys.readouterr().out, re.MULTILINE)
    arguments = ["conformance", "--command", compiled(tmp_path, "LENS_SHIFT")]
    assert main(arguments) == 1
    said = capsys.readouterr().out
    told = r"^beside_the_unshifted_view .* failed +MISSED_OBJECT: frame 0 .*'aside.*witness: pixel"
    assert re.search(told, said, re.MULTILINE)
    # Known to fail, with a reason, it is as it should be; repaired, it no longer is.
    failed = re.findall(r"^(\w+) .* failed  ", said, re.MULTILINE)
    expected = tmp_path / "engine.toml"
    text = "".join(f'[[expect]]\ncase = "{n}"\nreason = "no lens shift yet"\n' for n in failed)
    expected.write_text(text)
    assert main([*arguments, "--expected", str(expected)]) == 0
    repaired = ["conformance", "--command", compiled(tmp_path), "--expected", str(expected)]
    assert main(repaired) == 1
    assert f"{len(failed)} unexpected pass" in capsys.readouterr().out
