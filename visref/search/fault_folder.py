"""The folder of a fault: everything that shows it, and replays from there alone.

scene.glb, path.json   the case
drawn.jsonl            what the culler drew: recorded visible sets, or a recording where it decides
                       about something else than objects, with units.csv beside it
command.txt            the command lines that replay it
expected.json          what is violated, and how it was found
picture.png            the scene of the last frame, and what is wrong at its samples
test_fault.py          a test for the culler's own repository
REPORT.md              for its tracker
"""

from __future__ import annotations

import json
import platform
import re
import shlex
import tempfile
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from visref.camera_path import CameraPath
from visref.conformance.files import units_csv
from visref.culler import Promise
from visref.errors import InputError
from visref.files import FolderKind
from visref.inputs import Inputs, open_inputs
from visref.judging.outcome import CullerRecord, RunOutcome
from visref.recordings.recording import RECORDING_FORMAT, RECORDING_VERSION
from visref.recordings.units import read_units
from visref.registry import DEFAULT_ENGINE
from visref.runs import judge_to_folder
from visref.search.case import PATH, SCENE, Case
from visref.search.fault_picture import LastFrame, draw
from visref.search.fault_texts import Told, report, test_file
from visref.search.holding import Wanted
from visref.search.judging import Drawn, Kind, Verdict, Violation, verdict_from
from visref.search.shrinking import Shrunk
from visref.search.suspects import Suspect
from visref.search.violation_file import violation_json

FORMAT, VERSION = "visref-fault", 1
DRAWN, UNITS, COMMANDS, EXPECTED = "drawn.jsonl", "units.csv", "command.txt", "expected.json"
PICTURE, TEST, REPORT = "picture.png", "test_fault.py", "REPORT.md"
_FILES = (SCENE, PATH, DRAWN, UNITS, COMMANDS, EXPECTED, PICTURE, TEST, REPORT)


def _wrote(record: Any) -> Sequence[str] | None:
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        return None
    return [re.escape(name) for name in _FILES]


FAULT_FOLDER = FolderKind(EXPECTED, _wrote)


def write_fault(
    folder: Path, shrunk: Shrunk, suspect: Suspect, *, engine: str = DEFAULT_ENGINE
) -> Violation:
    """Write a shrunk fault into a folder that is there and empty, and judge what was written, by a
    culler that has met nothing else. Returns the violation as the files have it.

    Raises InputError where it is not there any more: where no file says the case exactly, or where
    the culler's answers hang on what it met before.
    """
    case = shrunk.case
    case.write(folder)
    inputs = _opened(folder, case, engine)
    suspect.forget()
    drawn, last = Drawn(), LastFrame(len(case.path) - 1)
    with tempfile.TemporaryDirectory(prefix="visref-fault-") as name, suspect.on(case) as culler:
        outcome = judge_to_folder(
            inputs,
            [(suspect.name, culler)],
            Path(name) / "run",
            pictures=0,
            listeners=[drawn, last],
        )
        verdict = verdict_from(outcome, inputs.scene, drawn.units)
        found = Wanted.of(shrunk.violation, cause="").shown(verdict, len(case.path) - 1)
        if not found:
            raise InputError(
                f"'{suspect.name}' answers otherwise when it is made anew: the fault hangs on what "
                "it met before this case",
                fix="make its answers depend on the scene and the path alone",
            )
    violation = Wanted.of(shrunk.violation).picked(found) or found[0]
    draw(case, violation, last, folder / PICTURE)
    record = outcome.cullers[0]
    checks = _write_drawn(folder, inputs, drawn, verdict)
    run_arguments = ["run", *_scene_arguments(case, engine), *suspect.arguments]
    lines = [shlex.join(["visref", *words, "--out", "run"]) for words in (run_arguments, checks)
             if words]  # fmt: skip
    (folder / COMMANDS).write_text("\n".join(lines) + "\n", encoding="utf-8")
    expected = _expected(shrunk, violation, verdict, record, suspect, engine)
    expected |= {"run": run_arguments, "check": checks or None}
    _write_text(folder / EXPECTED, json.dumps(expected, indent=1, ensure_ascii=True) + "\n")
    told = _told(shrunk, violation, outcome, suspect, engine)
    _write_text(folder / TEST, test_file(told, checked=bool(checks)))
    _write_text(folder / REPORT, report(told, lines))
    return violation


def _write_text(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8")


def _opened(folder: Path, case: Case, engine: str) -> Inputs:
    """As a command opens the written files."""
    return open_inputs(
        str(folder / SCENE),
        path=str(folder / PATH),
        engine=engine,
        threads=1,
        cull_backfaces=_culls(case),
    )


def _culls(case: Case) -> bool:
    """Whether the setting makes a difference to the case."""
    return case.cull_backfaces and case.scene.has_one_sided


def _scene_arguments(case: Case, engine: str) -> list[str]:
    said = [SCENE, "--path", PATH]
    if _culls(case):
        said.append("--cull-backfaces")
    if engine != DEFAULT_ENGINE:
        said += ["--engine", engine]
    return said


# What was drawn.


def _write_drawn(folder: Path, inputs: Inputs, drawn: Drawn, verdict: Verdict) -> list[str]:
    """Write what was drawn; the arguments of `visref check`, none where no file can say it: where
    a culler's units leave triangles out, which it never draws."""
    units = drawn.units
    assert units is not None, "who was judged has units"
    path = CameraPath.load(folder / PATH)
    rows = [{"frame": number, "visible": _visible(drawn, number)} for number in path.numbers]
    culls = ["--cull-backfaces"] if inputs.settings["cull_backfaces"] else []
    engine = [] if inputs.engine == DEFAULT_ENGINE else ["--engine", inputs.engine]
    promise = [] if verdict.promise is Promise.CONSERVATIVE else ["--promise", verdict.promise]
    if units.are_objects(inputs.scene):
        _write_lines(folder / DRAWN, rows)
        told = [SCENE, "--path", PATH, "--visible", DRAWN]
    else:
        (folder / UNITS).write_bytes(units_csv(inputs.scene, units))
        try:
            read_units(folder / UNITS, inputs.scene)
        except InputError:
            (folder / UNITS).unlink()
            return []
        said = path.to_json()
        header = {name: value for name, value in said.items() if name != "frames"}
        header |= {"format": RECORDING_FORMAT, "version": RECORDING_VERSION, "units": UNITS}
        frames = said["frames"]
        _write_lines(
            folder / DRAWN,
            [header, *({**row, **frame} for row, frame in zip(rows, frames, strict=True))],
        )
        told = [SCENE, "--recording", DRAWN]
    return ["check", *told, *culls, *engine, *promise]


def _visible(drawn: Drawn, frame: int) -> Any:
    """The ids of what was drawn in a frame: for all views, or by view."""
    by_view = {view: ids.tolist() for (at, view), ids in drawn.drawn.items() if at == frame}
    return by_view[""] if set(by_view) == {""} else by_view


def _write_lines(file: Path, rows: Sequence[Any]) -> None:
    text = "".join(json.dumps(row, ensure_ascii=True, allow_nan=False) + "\n" for row in rows)
    _write_text(file, text)


# What is told of it.


def _expected(
    shrunk: Shrunk,
    violation: Violation,
    verdict: Verdict,
    record: CullerRecord,
    suspect: Suspect,
    engine: str,
) -> dict[str, Any]:
    scene = shrunk.case.scene
    return {
        "format": FORMAT,
        "version": VERSION,
        "visref": version("visref"),
        "culler": suspect.name,
        "promise": verdict.promise.value,
        "engine": engine,
        "exit_status": int(record.exit),
        "violation": violation_json(violation),
        "first_cause": shrunk.first_cause,
        "frames": len(shrunk.case.path),
        "objects": scene.object_count,
        "triangles": scene.triangle_count,
        "trials": shrunk.trials,
        "smallest": shrunk.whole,
    }


def _told(
    shrunk: Shrunk, violation: Violation, outcome: RunOutcome, suspect: Suspect, engine: str
) -> Told:
    scene, path = shrunk.case.scene, shrunk.case.path
    camera = next(
        (c for c in path.frames[-1].cameras if c.view == violation.seen_in),
        path.frames[-1].cameras[0],
    )
    hider = int(scene.object_of_triangle[violation.triangle]) if violation.triangle >= 0 else -1
    return Told(
        suspect=suspect.name,
        promise=outcome.cullers[0].promise,
        violation=violation,
        first_cause=shrunk.first_cause,
        hider=scene.names[hider] if violation.kind is Kind.SUPERFLUOUS and hider >= 0 else "",
        width=camera.width,
        height=camera.height,
        frames=len(path),
        views=len(path.frames[-1].cameras),
        objects=scene.object_count,
        triangles=scene.triangle_count,
        moves=shrunk.case.moves,
        engine=engine,
        trials=shrunk.trials,
        smallest=shrunk.whole,
        visref=version("visref"),
        system=f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        arguments=tuple(suspect.arguments),
        scene_arguments=tuple(_scene_arguments(shrunk.case, engine)),
    )
