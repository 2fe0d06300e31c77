"""What a fault's folder says to people, and to their test runner."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

from visref.culler import Promise
from visref.judging.causes import CODES
from visref.markdown import code
from visref.search.case import Case
from visref.search.judging import Kind, Violation
from visref.wording import counted, legible


@dataclass(frozen=True, kw_only=True)
class Told:
    """All that the texts tell. `first_cause`: what was named before the first step; `hider`: the
    object that hides what was drawn for nothing, "" where there is none; `arguments`: how
    `visref run` is told of the culler, `scene_arguments`: of the case, which is beside the text."""

    suspect: str
    promise: Promise
    violation: Violation
    first_cause: str
    hider: str
    width: int
    height: int
    frames: int
    views: int
    objects: int
    triangles: int
    moves: bool
    engine: str
    trials: int
    smallest: bool
    visref: str
    system: str
    arguments: tuple[str, ...]
    scene_arguments: tuple[str, ...]


def sentence(told: Told) -> str:
    """What is wrong, in one sentence."""
    one = told.violation
    where = f"frame {one.frame}"
    if one.view or one.seen_in:
        where += f", view {code(one.view or one.seen_in)}"
    name = f"{code(one.name)} (object {one.object})"
    if one.kind is Kind.SUPERFLUOUS:
        what = name if one.unit == one.object else f"unit {one.unit}, of {name},"
        if one.x < 0:
            return f"In {where} {what} is drawn and covers no sample."
        by = f", at pixel ({one.x}, {one.y}) by {code(told.hider)}" if told.hider else ""
        return (
            f"In {where} {what} is drawn and is hidden at all of the {one.samples} "
            f"{'sample' if one.samples == 1 else 'samples'} that it covers{by}."
        )
    seen = counted(one.owned, "sample")
    lost = f"{one.samples} of the {seen}" if one.owned > 1 else "the one sample"
    part = "is not drawn" if one.kind is Kind.MISSED else "is not drawn whole"
    return (
        f"In {where} {name} is visible and {part}: it loses {lost} at which it is seen. At pixel "
        f"({one.x}, {one.y}) of {told.width} × {told.height} its triangle {one.triangle} is the "
        f"nearest, at depth {one.depth:.6g}."
    )


def cause_sentence(told: Told) -> str:
    """Why, as far as a smallest scene tells it; "" where nothing was named at all."""
    one = told.violation
    if one.cause:
        others = " or ".join(f"{code(other)} ({CODES[other]})" for other in one.others)
        also = f" As likely in so small a scene: {others}." if others else ""
        return f"Cause, as visref names it: {code(one.cause)} ({CODES[one.cause]}).{also}"
    if told.first_cause:
        return (
            f"Before the scene was made smaller visref named a cause, {code(told.first_cause)} "
            f"({CODES[told.first_cause]}); what is left of it tells none."
        )
    return ""


def report(told: Told, lines: Sequence[str]) -> str:
    """REPORT.md: for a tracker."""
    one = told.violation
    verb = "draws" if one.kind is Kind.SUPERFLUOUS else "leaves out"
    adjective = "hidden" if one.kind is Kind.SUPERFLUOUS else "visible"
    size = [counted(told.objects, "object"), counted(told.triangles, "triangle"),
            counted(told.frames, "frame")]  # fmt: skip
    if told.views > 1:
        size.append(counted(told.views, "view"))
    still = "; things move in it" if told.moves else ""
    parts = [
        f"# {code(told.suspect)} {verb} a {adjective} object",
        sentence(told),
        f"It promises to be {told.promise.value}: {told.promise.statement}.",
    ]
    if said := cause_sentence(told):
        parts.append(said)
    parts += [
        "![left: the last frame, at more samples than were judged; right: its samples, with those "
        "that are wrong in vermilion](picture.png)",
        "## Steps",
        f"The scene has {', '.join(size)}{still}. With the files of this folder:",
        "\n".join(["```sh", *lines, "```"]),
        "Each ends with exit status 1, and `run/verdict.json` says the rest. "
        "`run` asks the culler again; `check` judges what it drew (`drawn.jsonl`)."
        if len(lines) > 1
        else "It ends with exit status 1, and `run/verdict.json` says the rest.",
        "`pytest test_fault.py` does the same; set `FIXED` in it once the fault is mended.",
        "## Expected",
        "Nothing that is visible is left out: exit status 0."
        if one.kind is not Kind.SUPERFLUOUS
        else "Nothing that is hidden is drawn: exit status 0.",
        "## Versions",
        f"visref {told.visref}, engine `{told.engine}`; {told.system}. "
        + (
            f"Shrunk in {counted(told.trials, 'trial')}; "
            + ("nothing more could be left out." if told.smallest else "more may be left out.")
        ),
    ]
    return "\n\n".join(parts) + "\n"


_TEST = '''"""{title}

{said}

Needs visref and pytest, and the files beside it.
"""

import json
import subprocess
import sys
from pathlib import Path

# Set it to True once the culler is mended: then it has to draw what is visible here.
FIXED = False

HERE = Path(__file__).resolve().parent
EXPECTED = json.loads((HERE / "expected.json").read_text(encoding="utf-8"))


def judged(arguments, out):
    """The exit status of a visref command on the files beside, and its verdict."""
    words = [str(HERE / word) if (HERE / word).is_file() else word for word in arguments]
    command = [sys.executable, "-m", "visref", *words, "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    verdict = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
    (culler,) = verdict["cullers"].values()
    return done.returncode, culler


def test_the_culler_is_judged_as_it_is(tmp_path):
    status, culler = judged(EXPECTED["run"], tmp_path / "run")
    assert status == (0 if FIXED else EXPECTED["exit_status"])
    assert bool(culler["violations"]) is not FIXED
{check}'''

_CHECK = """

def test_what_was_drawn_is_a_violation(tmp_path):
    status, culler = judged(EXPECTED["check"], tmp_path / "check")
    assert status == EXPECTED["exit_status"]
    assert culler["violations"] > 0
"""


def test_file(told: Told, *, checked: bool) -> str:
    """test_fault.py: alone with the files beside it."""
    title = f"A fault of {json.dumps(legible(told.suspect))[1:-1]}, shrunk by visref."
    said = f"{sentence(told)} {cause_sentence(told)}".replace("\\", "\\\\")
    said = said.replace('"""', "'''")
    return _TEST.format(title=title, said=_wrapped(said), check=_CHECK if checked else "")


def _wrapped(text: str) -> str:
    lines, line = [], ""
    for word in text.split():
        if line and len(line) + 1 + len(word) > 96:
            lines.append(line)
            line = word
        else:
            line = f"{line} {word}".strip()
    return "\n".join([*lines, line])


def size_text(case: Case) -> str:
    """How large a case is, in words."""
    return ", ".join(
        [
            counted(len(case.path), "frame"),
            counted(case.scene.object_count, "object"),
            counted(case.scene.triangle_count, "triangle"),
        ]
    )
