"""Whatever a plug-in does, it is named for it and all others are judged."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.plug_ins import faulty
from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.cli.main import main
from visref.culler import Culler, CullerError
from visref.errors import InputError
from visref.judging.referee import Referee
from visref.judging.status import Exit, Status
from visref.plug_ins import Making, making_cullers
from visref.plug_ins.in_process import CullerGuarded
from visref.plug_ins.process import CullerApart
from visref.scene import Scene

HERE = Path(__file__).parent

# What the fault is told as, by the culler that has it.
LEFT = {
    "LeavesInConstructor": "it left by sys.exit(0)",
    "LeavesInPrepare": "it left by sys.exit(0)",
    "LeavesInCull": "it left by sys.exit()",
    "LeavesInClose": "it left by sys.exit(0)",
}
ENDED = {
    "EndsInConstructor": "its process ended with status 0 in its import or constructor",
    "EndsInPrepare": "its process ended with status 0 in prepare()",
    "EndsInCull": "its process ended with status 0 in cull()",
    "EndsInClose": "its process ended with status 0 in close()",
    "Dies": "killed by SIGSEGV in cull(); its last words: about to read address 0",
    "AnswersAlsoItself": "its process answered a header too long in cull()",
}
HANGS = {
    "HangsInPrepare": "prepare() took longer than",
    "HangsInCull": "cull() took longer than",
    "HangsInClose": "close() took longer than",
    "HangsInThePicture": "its rasteriser's item_buffer() took longer than",
}
RAISED = {
    "RaisesInConstructor": "RuntimeError: not today",
    "RaisesInputErrorInConstructor": "nobody gave an option",
    "RaisesInPrepare": "RuntimeError: not today",
    "RaisesInputError": "an InputError of its own",
    "RaisesNothingToJudge": "no GL",
    "RaisesGeneratorExit": "GeneratorExit",
    "RaisesWithoutWords": "Mute",
    "RunsOutOfStack": "RecursionError",
    "RaisesInClose": "RuntimeError: not today",
}
NO_ANSWER = {
    "NoUnits": "prepare() returned no Units",
    "UnitsOfLists": "",
    "UnitsBeyondTheScene": "the units' offsets|a unit names a triangle that the scene lacks",
    "UnitsOfTwoDimensions": "the units are not arrays of integers",
    "UnitsWithoutAName": "the units' kind is no",
    "DrawsNoSet": "cull() returned no DrawnSet",
    "DrawsTwice": "a unit is drawn twice",
    "DrawsAGenerator": "unit_ids is no",
    "DrawsBeyond": "a unit id is outside",
    "CountsNonsense": "stats.queries is 1.5",
    "TakesForever": "stats.ms['cull'] is nan",
    "NamesAPhaseBadly": "stats.ms['\\ud800'] is 1.0",
    "PromisesNonsense": "it promises 'trust me'",
    "PromisesInAList": "it promises",
    "CannotPromise": "RuntimeError: not ready",
}
EXCUSES = {
    "SnapsByNaN": "raster.tolerance: a snap of nan px is not from 0 to 0.5",
    "SnapsFar": "raster.tolerance: a snap of 1000000.0 px is not from 0 to 0.5",
    "SnapsInWords": "raster.tolerance: snap_px is a str, not a number",
    "SnapsInAList": "raster.tolerance: snap_px is a ",
    "HasNoBits": "raster.tolerance: 0 bits of depth are not from 16 to 32",
    "HasBitsInWords": "raster.tolerance: depth_bits is a str, not a whole number or None",
    "DeclaresNoTolerance": "'tolerance'",
}
HARMLESS = [
    "LeavesAThread",
    "Forks",
    "ChangesFolder",
    "MakesErrorsOfWarnings",
    "Prints",
    "PrintsWithoutEnd",
    "ClosesItsOutput",
    "WritesIntoWhatItGets",
]


def scene() -> Scene:
    """A sliver that owns one sample, by a thousandth of a pixel, and a triangle that owns many."""
    sliver = np.array([(0.499, 0.4, 0), (0.499, 0.6, 0), (0.9, 0.5, 0)])
    large = np.array([(-4, -4, -1), (4, -4, -1), (-4, 4, -1)])
    order = np.array([[0, 1, 2]])
    return Scene.from_objects([("sliver", sliver, order), ("large", large, order)])


def path() -> CameraPath:
    pose = np.eye(4)
    pose[2, 3] = 5.0
    camera = Camera(pose, 8, 8, 1.0, 100.0, ymag=4.0)
    return CameraPath((camera, camera))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The caller's folder: a plug-in beside a scene and a path."""
    for name in ("faulty.py", "leaves.py", "lacks.py"):
        shutil.copy(HERE / name, tmp_path)
    rows = [("sliver", [(0.499, 0.4, 0), (0.499, 0.6, 0), (0.9, 0.5, 0)])]
    rows += [("large", [(-4, -4, -1), (4, -4, -1), (-4, 4, -1)])]
    lines, number = [], 1
    for name, corners in rows:
        lines += [f"o {name}", *(f"v {x} {y} {z}" for x, y, z in corners)]
        lines += [f"f {number} {number + 1} {number + 2}"]
        number += 3
    (tmp_path / "s.obj").write_text("\n".join(lines) + "\n")
    pose = np.eye(4)
    pose[2, 3] = 5.0
    view = {"width": 8, "height": 8, "near": 1.0, "far": 100.0, "ymag": 4.0}
    frames = [{"world_from_camera": pose.tolist()}] * 2
    about = {"format": "visref-path", "version": 1, **view, "frames": frames}
    (tmp_path / "p.json").write_text(json.dumps(about))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*specs: str, more: tuple[str, ...] = ()) -> tuple[int, dict]:
    """The status and the verdict of a run of these cullers of `faulty`, or of other specs."""
    named = [spec if ":" in spec or spec == "none" else f"faulty:{spec}" for spec in specs]
    cullers = [part for spec in named for part in ("--culler", spec)]
    arguments = ["run", "s.obj", "--path", "p.json", *cullers, "--out", "out", "--pictures", "0"]
    if "--in-process" in more:
        # It forks, which a test's process with its threads had better not.
        command = [sys.executable, "-P", "-m", "visref", *arguments, *more]
        status = subprocess.run(command, check=False).returncode
    else:
        status = main([*arguments, *more])
    verdict = Path("out/verdict.json")
    return status, json.loads(verdict.read_text()) if verdict.is_file() else {}


def faults(verdict: dict) -> dict[str, str]:
    return {
        finding["culler"].removeprefix("faulty:"): finding["message"]
        for finding in verdict["findings"]
        if finding["code"] == "CULLER_FAILED"
    }


def assert_told(found: dict[str, str], expected: dict[str, str]) -> None:
    assert found.keys() == expected.keys()
    for name, said in expected.items():
        assert any(part in found[name] for part in said.split("|")), (name, found[name])


@pytest.mark.slow
def test_a_plug_in_that_leaves_or_ends_its_process_is_named_and_the_others_are_judged(folder):
    expected = {**LEFT, **ENDED, "EndsInThePicture": "its process ended with status 0 in its rast"}
    status, verdict = run("Misses", *expected, "none")
    assert status == verdict["exit_status"] == Exit.VIOLATION
    assert verdict["cullers"]["faulty:Misses"]["status"] == Status.VIOLATION
    assert verdict["cullers"]["faulty:Misses"]["missed_pixels"] == 2
    assert verdict["cullers"]["none"]["status"] == Status.NO_VIOLATION_FOUND
    assert_told(faults(verdict), expected)
    for name in expected:
        assert verdict["cullers"][f"faulty:{name}"]["status"] == Status.INCONCLUSIVE


def test_a_culler_that_ends_its_process_gives_a_run_no_good_status(folder):
    status, verdict = run("EndsInCull")
    assert (status, verdict["status"]) == (Exit.NOTHING_JUDGED, Status.INCONCLUSIVE)


@pytest.mark.slow
def test_a_plug_in_that_never_answers_is_ended_by_the_time_limit(folder):
    status, verdict = run("Misses", *HANGS, more=("--time-limit", "3"))
    assert status == Exit.VIOLATION
    assert_told(faults(verdict), HANGS)


@pytest.mark.slow
def test_what_is_harmless_in_a_process_of_its_own_passes(folder, capfd):
    status, verdict = run("Misses", *HARMLESS)
    assert status == Exit.VIOLATION
    assert not faults(verdict)
    for name in HARMLESS:
        assert verdict["cullers"][f"faulty:{name}"]["status"] == Status.NO_VIOLATION_FOUND
    out, err = capfd.readouterr()
    assert "::error" not in out
    # Named, so that it stands at the start of no line; and not without end.
    assert not any(line.lstrip().startswith("::") for line in err.splitlines())
    assert 100 < err.count("PrintsWithoutEnd: again and again") < 1000
    assert max(map(len, err.splitlines())) < 1000


@pytest.mark.slow
def test_faults_in_answers_are_told_alike_from_a_process_of_its_own(folder):
    few = {name: NO_ANSWER[name] for name in ("NoUnits", "DrawsBeyond", "PromisesInAList")}
    few["RaisesInputErrorInConstructor"] = RAISED["RaisesInputErrorInConstructor"]
    status, verdict = run("Misses", *few)
    assert status == Exit.VIOLATION
    assert_told(faults(verdict), few)


@pytest.mark.parametrize(("name", "said"), list({**LEFT, **RAISED, **NO_ANSWER, **EXCUSES}.items()))
@pytest.mark.parametrize("handed_over", [False, True])
def test_in_process_a_fault_is_its_culler_s_alone(name, said, handed_over, folder):
    made: list[tuple[str, Culler]] = [("misses", faulty.Misses())]
    if not handed_over:
        made.append((name, CullerGuarded(f"faulty:{name}")))
    elif "Constructor" in name or name == "RaisesInputError":
        return  # raised in the hands of who made it; an InputError of a class of one's own is input
    else:
        made.append((name, getattr(faulty, name)()))
    outcome = Referee(scene(), RecallingNothing).run(path(), range(2), made)
    assert outcome.exit is Exit.VIOLATION
    misses, other = outcome.cullers
    assert (misses.status, other.status) == (Status.VIOLATION, Status.INCONCLUSIVE)
    (found,) = [finding for finding in outcome.findings if finding.code == "CULLER_FAILED"]
    assert found.culler == name
    assert any(part in found.message for part in said.split("|"))


def RecallingNothing():
    from visref.engines import make_engine

    return make_engine("exact", scene())


@pytest.mark.parametrize("name", ["EndsInCull", "EndsInClose", "Dies"])
def test_in_process_the_end_of_the_process_is_no_verdict(name, folder, capfd):
    status, verdict = run("Misses", name, more=("--in-process",))
    assert status not in (0, 1)
    assert not verdict
    assert "before there was a verdict" in capfd.readouterr().err


def test_in_process_a_thread_that_never_ends_keeps_nobody(folder):
    status, verdict = run("Misses", "LeavesAThread", "LeavesInCull", more=("--in-process",))
    assert status == Exit.VIOLATION
    assert_told(faults(verdict), {"LeavesInCull": LEFT["LeavesInCull"]})


def test_apart_and_in_process_come_to_the_same_records(folder):
    specs = ("Misses", "Safe", "Paints", "PromisesLessLater")
    verdicts = []
    for more in ((), ("--in-process",)):
        status, verdict = run(*specs, more=more)
        assert status == Exit.VIOLATION
        verdicts.append(verdict)
    assert verdicts[0] == verdicts[1]
    # What was promised before the first frame holds.
    assert verdicts[0]["cullers"]["faulty:PromisesLessLater"]["status"] == Status.VIOLATION


def test_the_judge_s_question_for_a_picture_crosses_the_process(folder):
    """The sliver is lost within the tolerance that both declare: whose own picture lacks it is
    excused, and whose shows it is not."""
    status, verdict = run("Paints", "PaintsEverything")
    excused, shown = (verdict["cullers"][f"faulty:{n}"] for n in ("Paints", "PaintsEverything"))
    assert status == Exit.VIOLATION
    assert (excused["within_raster_tolerance"], excused["confirmed"]) == (2, 0)
    assert (shown["within_raster_tolerance"], shown["confirmed"]) == (0, 2)


@pytest.mark.slow
def test_a_tolerance_out_of_bounds_excuses_nothing_from_a_process_of_its_own_either(folder):
    status, verdict = run("Misses", *EXCUSES)
    assert status == Exit.VIOLATION
    assert_told(faults(verdict), EXCUSES)
    for name in EXCUSES:
        assert verdict["cullers"][f"faulty:{name}"]["within_raster_tolerance"] == 0


@pytest.mark.slow
def test_memory_is_limited_and_its_end_is_the_plug_in_s_fault(folder):
    with making_cullers(["faulty:AllocatesWithoutEnd"], Making(memory_limit=1 << 30)) as cullers:
        ((_, culler),) = cullers
        culler.prepare(scene())
        with pytest.raises(CullerError, match=r"MemoryError|its process"):
            culler.cull(path().cameras[0])


@pytest.mark.slow
def test_the_limit_of_memory_is_the_one_that_is_given(folder):
    status, verdict = run("Misses", "AllocatesWithoutEnd", more=("--max-memory", "1.5G"))
    assert status == Exit.VIOLATION
    assert_told(faults(verdict), {"AllocatesWithoutEnd": "MemoryError|its process"})


@pytest.mark.parametrize("more", [(), ("--in-process",)])
def test_a_spec_that_names_nothing_is_bad_input_for_all(more, folder, capfd):
    for spec, said in (
        ("nowhere:Thing", "no culler and no module is named 'nowhere'"),
        ("faulty:Thing", "module 'faulty' has no 'Thing'"),
        ("faulty:np", "is not a subclass"),
        ("faulty:Safe:level=3", "has no option 'level'"),
    ):
        status, verdict = run("Misses", spec, more=more)
        assert (status, verdict) == (Exit.BAD_INPUT, {})
        (line,) = capfd.readouterr().err.splitlines()
        assert said in line


@pytest.mark.parametrize("more", [(), ("--in-process",)])
def test_a_module_that_leaves_or_lacks_something_is_at_fault_itself(more, folder):
    status, verdict = run("Misses", "leaves:Thing", "lacks:Thing", more=more)
    assert status == Exit.VIOLATION
    assert_told(
        faults(verdict),
        {
            "leaves:Thing": "it left by sys.exit(0)",
            "lacks:Thing": "No module named 'a_module_that_nobody_has'",
        },
    )


def test_a_time_limit_that_is_none_is_refused():
    with (
        pytest.raises(InputError, match="--time-limit is 0"),
        making_cullers([], Making(time_limit_s=0.0)),
    ):
        pass


def test_nothing_that_a_plug_in_started_outlives_it(folder):
    culler = CullerApart("faulty:LeavesAThread", time_limit_s=60.0)
    culler.prepare(scene())
    culler.cull(path().cameras[0])
    process = culler._process._process.pid
    culler.close()
    with pytest.raises(ProcessLookupError):
        os.killpg(process, 0)


def test_a_plug_in_s_process_ends_with_the_judge_s(folder):
    program = (
        "import sys, time\n"
        "from visref.plug_ins.process import CullerApart\n"
        "culler = CullerApart('faulty:Safe', time_limit_s=60.0)\n"
        "print(culler._process._process.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as judge:
        assert judge.stdout is not None
        process = int(judge.stdout.readline())
        judge.kill()
    for _ in range(200):
        if not Path(f"/proc/{process}").exists() or _is_dead(process):
            return
        time.sleep(0.05)
    raise AssertionError("it lives on")


def _is_dead(process: int) -> bool:
    try:
        return "State:\tZ" in Path(f"/proc/{process}/status").read_text()
    except OSError:
        return True
