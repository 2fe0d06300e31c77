"""A program as a culler: whatever it does, it is named for it, and all others are judged."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.plug_ins.test_plug_ins import path, scene
from visref.camera_path import CameraPath
from visref.cli.main import main
from visref.culler import CullerError, Promise
from visref.errors import InputError
from visref.judging.status import Exit, Status
from visref.plug_ins.command import Command, CommandCuller
from visref.trials.hardcases import read_cases

# What each program does, after `import json, os, sys, time; scene, path, out = sys.argv[1:]`.
# `everything()` writes that both objects are drawn in both frames.
PROGRAMS = {
    "good": "everything()",
    "misses": "write([1], [1])",
    "fails": "print('no such mesh', file=sys.stderr); print('bye'); sys.exit(3)",
    "crashes": "print('at 0x0', file=sys.stderr, flush=True); os.kill(os.getpid(), 11)",
    "hangs": "everything(); print('still here', file=sys.stderr, flush=True); time.sleep(3600)",
    "writes_nothing": "pass",
    "writes_a_folder": "os.mkdir(out)",
    "writes_garbage": "open(out, 'wb').write(bytes(range(256)))",
    "writes_half": "write([0, 1])",
    "names_a_stranger": "write(['sliver'], ['sliver', 'ghost'])",
    "kills_its_starter": "os.kill(os.getppid(), 9); time.sleep(3600)",
    "has_no_end": "f = open(out, 'w')\nwhile True: f.write('x' * (1 << 20))",
    "allocates": "held = []\nwhile True: held.append(bytearray(1 << 26))",
    "speaks_to_the_terminal": "print('::error::x\\x1b[2J'); everything()",
    "prints_without_end": "for _ in range(5000): print('again')\neverything()",
    "reads_what_it_is_asked": "input(); everything()",
    "complains_of_its_files": "sys.exit(f'cannot read {scene}, {path} or {out}')",
}
_HEAD = """import json, os, sys, time
scene, path, out = sys.argv[1:4]
def write(*frames):
    with open(out, "w") as file:
        for number, drawn in enumerate(frames):
            file.write(json.dumps({"frame": number, "visible": drawn}) + "\\n")
def everything():
    write([0, 1], [0, 1])
"""
# What the fault is told as.
FAULTS = {
    "fails": "it ended with status 3; its last words: no such mesh",
    "crashes": "it was killed by SIGSEGV; its last words: at 0x0",
    "writes_nothing": "it ended well, but {visible} was not written",
    "writes_a_folder": "it ended well, but {visible} is no ordinary file",
    "writes_garbage": "what it wrote to {visible}: ",
    "writes_half": "what it wrote to {visible}: frame: 1 of 2 frames are missing: 1; ",
    "names_a_stranger": "what it wrote to {visible}: line 2: the scene has no object named 'ghost'",
    "kills_its_starter": "it ended the process that started it",
    "reads_what_it_is_asked": "it ended with status 1; its last words: EOFError",
    "complains_of_its_files": "its last words: cannot read {scene}, {path} or {visible}",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The caller's folder: the programs beside a scene and a path."""
    for name, body in PROGRAMS.items():
        (tmp_path / f"{name}.py").write_text(f"{_HEAD}{body}\n")
    lines, number = [], 1
    for name, corners in (
        ("sliver", [(0.499, 0.4, 0), (0.499, 0.6, 0), (0.9, 0.5, 0)]),
        ("large", [(-4, -4, -1), (4, -4, -1), (-4, 4, -1)]),
    ):
        lines += [f"o {name}", *(f"v {x} {y} {z}" for x, y, z in corners)]
        lines += [f"f {number} {number + 1} {number + 2}"]
        number += 3
    (tmp_path / "s.obj").write_text("\n".join(lines) + "\n")
    (tmp_path / "p.json").write_text(json.dumps(path().to_json()))
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def line(name: str, more: str = "") -> str:
    return f"{sys.executable} {name}.py {{scene}} {{path}} {{visible}}{more}"


def run(*names: str, more: tuple[str, ...] = ()) -> tuple[int, dict]:
    """The status and the verdict of a run of these programs."""
    programs = [part for name in names for part in ("--command", line(name))]
    status = main(
        ["run", "s.obj", "--path", "p.json", *programs, "--out", "out", "--pictures", "0", *more]
    )
    verdict = Path("out/verdict.json")
    return status, json.loads(verdict.read_text()) if verdict.is_file() else {}


def called(name: str) -> str:
    return f"command:{Path(sys.executable).name} {name}.py"


def culler(name: str, **more) -> CommandCuller:
    more.setdefault("time_limit_s", 60.0)
    return CommandCuller(Command.parse(line(name)), "s.obj", path(), **more)


def lives(process: int) -> bool:
    """Whether a process does something still."""
    try:
        return ") Z " not in Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return False


def ends(process: int) -> bool:
    """Whether a process ends, soon."""
    for _ in range(200):
        if not lives(process):
            return True
        time.sleep(0.05)
    return False


def test_each_program_that_fails_is_named_and_the_others_are_judged(folder):
    status, verdict = run("misses", *FAULTS, "good")
    assert status == verdict["exit_status"] == Exit.VIOLATION
    assert verdict["cullers"][called("misses")]["status"] == Status.VIOLATION
    assert verdict["cullers"][called("misses")]["missed_pixels"] == 2
    assert verdict["cullers"][called("good")]["status"] == Status.NO_VIOLATION_FOUND
    found = {
        finding["culler"]: finding["message"]
        for finding in verdict["findings"]
        if finding["code"] == "CULLER_FAILED"
    }
    assert found.keys() == set(map(called, FAULTS))
    for name, said in FAULTS.items():
        assert said in found[called(name)]
        assert "\n" not in found[called(name)]
        assert str(folder) not in found[called(name)]
        assert verdict["cullers"][called(name)]["status"] == Status.INCONCLUSIVE


def test_a_program_that_fails_alone_leaves_nothing_judged(folder):
    status, verdict = run("fails")
    assert (status, verdict["status"]) == (Exit.NOTHING_JUDGED, Status.INCONCLUSIVE)


def test_a_program_that_hangs_is_ended_by_the_time_limit_whatever_it_wrote(folder):
    started = time.monotonic()
    status, verdict = run("hangs", "good", more=("--time-limit", "2"))
    assert time.monotonic() - started < 30
    assert status == Exit.NOTHING_JUDGED
    assert verdict["cullers"][called("good")]["status"] == Status.NO_VIOLATION_FOUND
    (found,) = [f["message"] for f in verdict["findings"] if f["code"] == "CULLER_FAILED"]
    assert found == "it took longer than 2 s (--time-limit); its last words: still here"


def test_a_limit_may_be_beyond_all_measure(folder):
    for limit in (1e300, float("inf"), None):
        made = culler("good", time_limit_s=limit)
        made.prepare(scene())
        assert made.cull(path().cameras[0]).unit_ids.tolist() == [0, 1]


@pytest.mark.parametrize(
    ("name", "said"), [("allocates", "MemoryError"), ("has_no_end", "SIGXFSZ|File too large")]
)
def test_memory_and_files_are_limited(name, said, folder):
    with pytest.raises(CullerError) as caught:
        culler(name, memory_limit=1 << 29).prepare(scene())
    assert any(one in str(caught.value) for one in said.split("|"))
    assert not list((folder / "tmp").iterdir())


def test_what_it_prints_stands_behind_its_name_and_has_an_end(folder, capfd):
    status, _ = run("speaks_to_the_terminal", "prints_without_end")
    assert status == Exit.NO_VIOLATION
    out, err = capfd.readouterr()
    assert f"{called('speaks_to_the_terminal')}: ::error::x\\x1b[2J" in err.splitlines()
    assert "\x1b" not in out + err
    assert 100 < err.count(f"{called('prints_without_end')}: again") < 1000


@pytest.mark.parametrize("how", ["", "os.setsid()"], ids=["child", "daemon"])
def test_what_it_leaves_running_is_ended(how, folder):
    """A child of a child, so that nobody below waits for it."""
    leaves = (
        f"if os.fork() == 0:\n    {how or 'pass'}\n    if os.fork() == 0:\n"
        "        open('left', 'w').write(str(os.getpid()))\n        time.sleep(3600)\n"
        "    os._exit(0)\n"
        "while not (os.path.exists('left') and os.path.getsize('left')): time.sleep(0.01)\n"
    )
    (folder / "leaves.py").write_text(f"{_HEAD}{leaves}everything()\n")
    culler("leaves").prepare(scene())
    assert ends(int((folder / "left").read_text()))


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_all_that_it_started_ends_with_the_judge(number, folder):
    body = (
        "if os.fork() == 0:\n    os.setsid()\n"
        "open(f'runs-{os.getpid()}', 'w').close()\ntime.sleep(3600)\n"
    )
    (folder / "forks.py").write_text(_HEAD + body)
    command = [sys.executable, "-m", "visref", "run", "s.obj", "--path", "p.json"]
    command += ["--command", line("forks"), "--out", "out"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as judge:
        deadline = time.monotonic() + 120
        while len(runs := list(folder.glob("runs-*"))) < 2:
            assert judge.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)
        judge.send_signal(number)
        status = judge.wait()
    assert status == (130 if number == signal.SIGINT else -number)
    for process in runs:
        assert ends(int(process.name.partition("-")[2]))
    assert not Path("out").exists()


def test_it_is_given_the_scene_and_the_whole_path_in_world_coordinates(folder):
    """And told of back faces; the frames that are not judged need not be written."""
    body = (
        "open('seen.json', 'w').write(json.dumps([open(scene).read(), json.load(open(path)),"
        " os.environ['VISREF_CULL_BACKFACES'], os.environ['TMPDIR'], os.getcwd()]))\n"
        "open(os.path.join(os.environ['TMPDIR'], 'scratch'), 'w').close()\n"
        "open(out, 'w').write(json.dumps({'frame': 1, 'visible': [0, 1]}))\n"
    )
    (folder / "looks.py").write_text(_HEAD + body)
    status, _ = run("looks", more=("--frames", "1:2", "--cull-backfaces"))
    assert status == Exit.NO_VIOLATION
    text, told, back, scratch, here = json.loads((folder / "seen.json").read_text())
    assert text == (folder / "s.obj").read_text()
    assert told == path().to_json()
    assert back == "1"
    # Its scratch folder is gone, and it ran where visref did.
    assert Path(scratch).parent == folder / "tmp"
    assert not list((folder / "tmp").iterdir())
    assert here == str(folder)


def test_about_an_origin_its_cameras_are_those_of_the_world(folder):
    far = np.array([4_208_411.0, 1_120_733.0, -4_645_519.0])
    views = []
    for camera in path():
        pose = camera.world_from_camera.copy()
        pose[:3, 3] += far
        views.append(replace(camera, world_from_camera=pose))
    shifted = CameraPath(views)
    (folder / "looks.py").write_text(f"{_HEAD}os.link(path, 'seen.json'); everything()\n")
    of_far = replace(scene(), origin=far)
    command = Command.parse(line("looks"))
    made = CommandCuller(command, "s.obj", shifted.relative_to(far), time_limit_s=60.0)
    made.prepare(of_far)
    assert json.loads((folder / "seen.json").read_text()) == shifted.to_json()
    # What it wrote is played back to the cameras of the scene.
    for camera in shifted.relative_to(far):
        assert made.cull(camera).unit_ids.tolist() == [0, 1]


def test_a_generated_scene_is_written_to_a_file_for_it(folder):
    (folder / "counts.py").write_text(
        "import json, struct, sys\n"
        "scene, path, out = sys.argv[1:]\n"
        "data = open(scene, 'rb').read()\n"
        "gltf = json.loads(data[20 : 20 + struct.unpack('<I', data[12:16])[0]])\n"
        "count = sum('mesh' in node for node in gltf['nodes'])\n"
        "with open(out, 'w') as file:\n"
        "    for frame in range(len(json.load(open(path))['frames'])):\n"
        "        print(json.dumps({'frame': frame, 'visible': list(range(count))}), file=file)\n"
    )
    city = "city:scale=0.02,frames=2"
    made = ["run", city, "--command", line("counts"), "--out", "out", "--pictures", "0"]
    assert main(made) == Exit.NO_VIOLATION
    (sums,) = json.loads(Path("out/verdict.json").read_text())["cullers"].values()
    assert sums["drawn"] == 2 * 123
    assert not list((folder / "tmp").iterdir())


def test_runs_are_the_same_bytes_wherever_the_program_wrote(folder):
    files = ("verdict.json", "objects.parquet", "frames.parquet")
    kept = []
    for _ in range(2):
        run("misses", "complains_of_its_files")
        manifest = json.loads(Path("out/manifest.json").read_text())
        del manifest["machine"]
        kept.append([manifest, *(Path("out", name).read_bytes() for name in files)])
    assert kept[0] == kept[1]


def test_the_manifest_tells_the_command_and_what_was_said_of_it(folder):
    more = ("--command-promise", "approximate", "--command-raster", "snap=0.25,depth=float")
    status, verdict = run("misses", "misses", more=more)
    assert status == Exit.NO_VIOLATION
    assert {one["status"] for one in verdict["cullers"].values()} == {"measured"}
    commands = json.loads(Path("out/manifest.json").read_text())["settings"]["commands"]
    assert list(commands) == list(verdict["cullers"]) == [called("misses"), f"{called('misses')}#2"]
    for told in commands.values():
        assert told["command"] == line("misses")
        assert told["promise"] == "approximate"
        assert told["raster"] == {"snap_px": 0.25, "depth_bits": None}


def test_a_declared_rasteriser_excuses_what_lies_within_it(folder):
    """The sliver owns its sample by a thousandth of a pixel."""
    status, verdict = run("misses", more=("--command-raster", "snap=0.1,depth=24"))
    assert status == Exit.NO_VIOLATION
    assert verdict["cullers"][called("misses")]["within_raster_tolerance"] == 2


# What a program writes to {recording}, after the lines of `_RECORDS`.
RECORDINGS = {
    "records": "record([0, 1], [0, 1])",
    "records_a_miss": "record([0, 1], ['large'])",
    "records_units": "write_units(); head['units'] = 'u.csv'; record([0, 1, 2], [1, 2])",
    "records_bad_units": "write_units(9); head['units'] = 'u.csv'; record([0], [0])",
    "records_half": "record([0, 1])",
    "records_and_dies": "record([0, 1], [0, 1], cut=20)",
    "records_elsewhere": "frames[1]['world_from_camera'][0][3] += 1.0; record([0], [0])",
    "records_without_a_header": "open(out, 'w').write('{\"frame\": 0, \"visible\": []}')",
}
_RECORDS = """import json, os, sys
scene, path, out = sys.argv[1:4]
head = json.load(open(path))
frames = head.pop("frames")
head["format"] = "visref-recording"
def write_units(count=1):
    with open(os.path.join(os.path.dirname(out), "u.csv"), "w") as file:
        file.write("unit,object,first_triangle,triangle_count\\n")
        file.write(f"0,0,0,1\\n1,0,0,1\\n2,1,0,{count}\\n")
def record(*drawn, cut=0):
    lines = [head]
    for number, (frame, visible) in enumerate(zip(frames, drawn)):
        lines.append({"frame": number, **frame, "visible": visible})
    text = "".join(json.dumps(line) + "\\n" for line in lines)
    open(out, "w").write(text[: len(text) - cut])
"""
RECORDING_FAULTS = {
    "records_bad_units": "what it wrote to u.csv: row 2: ",
    "records_half": "what it wrote to {recording}: frame: 1 of 2 frames are missing: 1; ",
    "records_and_dies": "what it wrote to {recording}: frame: {recording}: line 3 is not whole",
    "records_elsewhere": "what it wrote to {recording}: frame 1: it was not recorded along the "
    "path: the position of the camera is another",
    "records_without_a_header": "what it wrote to {recording}: line 1: this is no recording: ",
}


def test_a_program_may_write_a_recording_of_the_path(folder):
    given = []
    for name, body in RECORDINGS.items():
        (folder / f"{name}.py").write_text(f"{_RECORDS}{body}\n")
        given += ["--command", line(name).replace("{visible}", "{recording}")]
    status = main(["run", "s.obj", "--path", "p.json", *given, "--out", "out", "--pictures", "0"])
    assert status == Exit.VIOLATION
    verdict = json.loads(Path("out/verdict.json").read_text())
    cullers = verdict["cullers"]
    assert cullers[called("records")]["status"] == Status.NO_VIOLATION_FOUND
    assert cullers[called("records_a_miss")]["missed_pixels"] == 1
    # Two units are the sliver, of which one is enough.
    assert cullers[called("records_units")]["status"] == Status.NO_VIOLATION_FOUND
    assert cullers[called("records_units")]["unit_kind"] == "unit"
    found = {f["culler"]: f["message"] for f in verdict["findings"] if f["code"] == "CULLER_FAILED"}
    assert found.keys() == set(map(called, RECORDING_FAULTS))
    for name, said in RECORDING_FAULTS.items():
        assert said in found[called(name)]
        assert str(folder) not in found[called(name)]


BAD = {
    "cat {visible} {recording}": "it is to write {recording} and {visible}",
    "nowhere {scene} {path} {visible}": "there is no program 'nowhere'",
    "./s.obj {scene} {path} {visible}": "is no program that can be run; make it executable",
    "": "it names no program",
    "cat 'x {visible}": "no closing quotation",
    "cat {scene} {path}": "it has no placeholder for the file that it writes",
    "cat {scene} {paths} {visible}": "{paths} is no placeholder; known are {scene}, {path}, ",
}


@pytest.mark.parametrize("text", BAD)
@pytest.mark.parametrize("command", ["run", "hardcases"])
def test_a_command_that_cannot_be_is_bad_input_for_all(command, text, folder, capfd):
    inputs = ["s.obj", "--path", "p.json", "--out", "out"] if command == "run" else []
    given = [command, *inputs, "--command", line("good"), "--command", text]
    assert main(given) == Exit.BAD_INPUT
    (said,) = capfd.readouterr().err.splitlines()
    assert said.startswith(f'error: --command "{text}": ')
    assert BAD[text] in said
    assert not Path("out").exists()


def test_what_is_said_of_no_program_is_refused(folder, capfd):
    inputs = ["run", "s.obj", "--path", "p.json", "--out", "out"]
    for more, said in (
        ((), "there is nothing to judge; give --culler or --command"),
        (("--culler", "none", "--command-promise", "exact"), "and no --command"),
        (("--command", line("good"), "--command-raster", "snap=9,depth=24"), "--command-raster"),
        (("--command", line("good"), "--time-limit", "0"), "--time-limit is 0"),
    ):
        assert main([*inputs, *more]) == Exit.BAD_INPUT
        (told,) = capfd.readouterr().err.splitlines()
        assert said in told


def test_a_file_that_is_no_program_of_this_machine_is_its_own_failure(folder):
    (folder / "foreign").write_bytes(b"MZ\x90\x00")
    (folder / "foreign").chmod(0o755)
    made = CommandCuller(Command.parse("./foreign {visible}"), "s.obj", path())
    with pytest.raises(CullerError, match="it could not be started: Exec format error"):
        made.prepare(scene())


def test_words_are_split_as_in_a_shell_and_no_shell_is_asked(folder):
    (folder / "my program").write_text(
        f"#!{sys.executable}\nimport json, sys\njson.dump(sys.argv[1:], open('seen', 'w'))\n"
    )
    (folder / "my program").chmod(0o755)
    text = "'./my program' --in={scene} \"a b\" '$HOME;*' --out={visible} ''"
    command = Command.parse(text, promise=Promise.AGGRESSIVE)
    made = CommandCuller(command, "s.obj", path())
    assert (command.name, made.promise) == ("command:my program", Promise.AGGRESSIVE)
    with pytest.raises(CullerError, match=r"{visible} was not written"):
        made.prepare(scene())
    first, *middle, last, empty = json.loads((folder / "seen").read_text())
    assert first == f"--in={folder / 's.obj'}"
    assert (middle, empty) == (["a b", "$HOME;*"], "")
    assert last.startswith(f"--out={folder / 'tmp'}{os.sep}")


def test_the_rest_pose_is_told_by_leaving_time_out(folder):
    (folder / "looks.py").write_text(f"{_HEAD}os.link(path, 'seen.json'); everything()\n")
    frames = [replace(frame, time_s=1.5, clip="walk") for frame in path().frames]
    command = Command.parse(line("looks"))
    for rest, keys in ((False, {"time_s"}), (True, set())):
        Path("seen.json").unlink(missing_ok=True)
        CommandCuller(command, "s.obj", CameraPath(frames), rest_pose=rest).prepare(scene())
        told = json.loads((folder / "seen.json").read_text())
        assert told.get("animation") == (None if rest else "walk")
        assert {"time_s"} & told["frames"][0].keys() == keys


def test_before_it_is_prepared_it_has_no_answer(folder):
    made = culler("good")
    assert (made.joint, made.raster, made.moves) == (False, None, True)
    with pytest.raises(CullerError, match="it was not prepared"):
        made.cull(path().cameras[0])


def test_the_hard_cases_run_a_program_on_each_case_s_files(folder, capfd):
    program = (
        "import json, struct, sys\n"
        "scene, path, out = sys.argv[1:]\n"
        "data = open(scene, 'rb').read()\n"
        "gltf = json.loads(data[20 : 20 + struct.unpack('<I', data[12:16])[0]])\n"
        "names = [n['name'] for n in gltf['nodes'] if 'mesh' in n]\n"
        "with open(out, 'w') as file:\n"
        "    for frame in range(len(json.load(open(path))['frames'])):\n"
        "        print(json.dumps({'frame': frame, 'visible': names[FROM:]}), file=file)\n"
    )
    (folder / "all.py").write_text(program.replace("FROM", "0"))
    (folder / "none.py").write_text(program.replace("FROM", "len(names)"))
    few = [case.name for case in read_cases(folder / "cases") if not case.error][:2]
    only = [part for name in few for part in ("--only", name)]
    commands = ["--command", line("all"), "--command", line("none")]
    assert main(["hardcases", *only, *commands, "--json"]) == Exit.VIOLATION
    table = json.loads(capfd.readouterr().out)
    assert table["cullers"] == [called("all"), called("none")]
    assert len(table["cases"]) == len(few)
    for case in table["cases"]:
        assert case["cells"][called("all")]["state"] == "right"
        assert case["cells"][called("none")]["state"] == "WRONG"


def test_a_bad_command_is_an_input_error_in_python_too():
    with pytest.raises(InputError, match="there is no program"):
        Command.parse("nowhere {visible}")
