"""Small scenes for engines, and what is read from their recordings."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from visref.cli.main import main
from visref.conformance.declared import Declared
from visref.conformance.files import WrittenCase, written_cases
from visref.conformance.recorded import read_recordings
from visref.conformance.suite import judged_on
from visref_datasets_gen.__main__ import main as generate

ENGINES = Path(__file__).parent.parent.parent.parent / "examples" / "engines"


def city(folder: Path) -> tuple[Path, Path]:
    """A city of 123 objects and a path of three frames."""
    size = ["--width", "96", "--height", "72"]
    generate(["city", "--scale", "0.02", "--frames", "3", *size, "--out", str(folder)])
    return folder / "city.glb", folder / "city.path.json"


def status_and_sums(scene: Path, folder: Path) -> tuple[int, dict]:
    """Of `r.jsonl` in the folder."""
    command = ["check", str(scene), "--recording", str(folder / "r.jsonl"), "--pictures", "0"]
    status = main([*command, "--out", str(folder / "run")])
    (sums,) = json.loads((folder / "run" / "verdict.json").read_text())["cullers"].values()
    return status, sums


def names_of(scene: Path) -> list[str]:
    """Of a GLB's nodes, in the file's order."""
    data = scene.read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    return [node["name"] for node in document["nodes"]]


def drawn_in(recording: Path, scene: Path) -> Iterator[list[int]]:
    """The numbers of the nodes of each frame."""
    names = names_of(scene)
    for line in recording.read_text(encoding="utf-8").splitlines()[1:]:
        told = json.loads(line)
        yield told.get("visible_nodes") or [names.index(name) for name in told["visible"]]


def colour_of(node: int) -> tuple[int, ...]:
    """Of a node in the recorders' pictures, red, green and blue."""
    number = (node + 1) * 0x9E3779 % 2**24
    return number >> 16, number >> 8 & 255, number & 255


def recorded_cases(names: Sequence[str], folder: Path) -> tuple[Path, Path]:
    """A suite of these cases alone, and where its recordings go."""
    suite, out = folder / "suite", folder / "recordings"
    rows = []
    for case in chosen(names):
        (suite / case.name).mkdir(parents=True)
        for name, data in case.files.items():
            (suite / case.name / name).write_bytes(data)
        files = {one: f"{case.name}/{name}" for one, name in FILES.items()}
        rows.append({"name": case.name, **files})
    (suite / "manifest.json").write_text(json.dumps({"cases": rows}), encoding="utf-8")
    return suite, out


FILES = {"scene": "scene.glb", "path": "path.json"}


def chosen(names: Sequence[str]) -> list[WrittenCase]:
    return [case for case in written_cases() if case.name in names]


def judged(names: Sequence[str], recordings: Path) -> dict[str, tuple[str, ...]]:
    """What is wrong with the recording of each case."""
    cases = chosen(names)
    entrant = read_recordings(recordings, cases, Declared())
    problems = {}
    for case in cases:
        with entrant.culler(case) as culler:
            found = judged_on(lambda one=culler: one, case.case, case.truths)
        problems[case.name] = found.problems
    return problems


def rows_of_a_rerun(engine: str, folder: Path) -> tuple[list[str], list[str]]:
    """The table that `judge.py` prints for an engine, and which of its lines its page lacks."""
    done = subprocess.run(
        [sys.executable, ENGINES / "judge.py", engine, "--out", folder, "--no-suite"],
        capture_output=True,
        text=True,
        check=True,
    )
    page = (ENGINES.parent.parent / "docs" / "engines" / f"{engine}.md").read_text(encoding="utf-8")
    rows = [line for line in done.stdout.splitlines() if line.startswith("|")]
    return rows, [line for line in rows if line not in page.splitlines()]
