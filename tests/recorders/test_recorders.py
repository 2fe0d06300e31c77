"""Every recorder writes what the format says, whatever it is given, and hides no failure."""

from __future__ import annotations

import math
import re
import subprocess
from collections.abc import Sequence

import numpy as np
import pytest

from tests.recorders.calls import (
    EYE,
    Call,
    awkward_calls,
    exactly,
    expected_lines,
    strict_lines,
)
from tests.recorders.languages import each
from tests.recorders.languages.base import RECORDERS, Recording, Recordings
from tests.recorders.languages.rust import build_rust

CAMERA: Call = ("camera", "world_from_camera", "row_major", list(EYE), None)
FRAME: tuple[Call, ...] = (("begin_frame", 0), CAMERA, ("visible_ids", [3], None), ("end_frame",))


AWKWARD = awkward_calls(seed=16, frames=25)
OF_AWKWARD = Recordings(Recording("awkward.jsonl", AWKWARD))


@each()
def test_awkward_names_and_numbers_are_read_back_exactly(language, tmp_path):
    """All recorders make the same calls, so their files hold equal values."""
    assert OF_AWKWARD.run(language, tmp_path) == ["ok"]
    lines = strict_lines((tmp_path / "awkward.jsonl").read_bytes())
    assert exactly(lines) == exactly(expected_lines(AWKWARD, 64, 48))
    assert len(lines) == 26


def test_the_awkward_calls_hold_what_they_are_for():
    calls = AWKWARD
    text = repr(calls)
    for one in (
        "1e-308",
        "5e-324",
        "-0.0",
        "1e+22",
        "inf",
        "😀",
        "\\x01",
        "__proto__",
        "column_major",
    ):
        assert one in text
    lines = expected_lines(calls, 64, 48)
    sets = [line.get("visible", line.get("visible_nodes")) for line in lines[1:]]
    assert {type(one) for one in sets} == {list, dict}
    assert any(isinstance(one, dict) and [] in one.values() for one in sets)
    assert any("visible_nodes" in line for line in lines)
    assert {call[0] for call in calls} >= {
        "cut",
        "time",
        "absent",
        "pose",
        "level",
        "bounds",
        "stat_ms",
    }


def test_numbers_that_differ_in_one_bit_are_not_equal():
    assert exactly([0.1]) != exactly([math.nextafter(0.1, 1)])
    assert exactly({"a": 0.0}) != exactly({"a": -0.0})
    assert exactly({"views": {"a": {}, "b": {}}}) != exactly({"views": {"b": {}, "a": {}}})


def test_the_parser_of_these_tests_is_strict():
    for text in (b'{"a":1,"a":2}\n', b'{"a":NaN}\n', b'{"a":1}', b'{"a":"\xff"}\n', b'{"a":1e+}\n'):
        with pytest.raises((AssertionError, ValueError)):
            strict_lines(text)


def of_camera(*matrix: float) -> Call:
    return ("camera", "world_from_camera", "row_major", [*matrix, *EYE[len(matrix) :]], None)


VIEW = ("camera", "world_from_camera", "row_major", list(EYE), "left")
# What is done wrong in frame 4, behind a good one, and what is told.
WRONG: tuple[tuple[str, Sequence[Call], str], ...] = (
    ("a number that is none", [of_camera(math.nan)], "frame 4: a number is not finite"),
    ("an endless number", [of_camera(1.0, -math.inf)], "frame 4: a number is not finite"),
    (
        "a bound",
        [CAMERA, ("bounds", "a", [0.0, 0.0, math.nan], [1.0, 1.0, 1.0])],
        "frame 4: a number is not finite",
    ),
    ("no camera", [], "frame 4: no camera"),
    ("a view without", [VIEW, ("visible_ids", [1], "right")], "frame 4: no camera"),
    ("two cameras", [CAMERA, CAMERA], "frame 4: a second camera"),
    (
        "ids and nodes",
        [CAMERA, ("visible_ids", [1], None), ("visible_nodes", [1], None)],
        "frame 4: what is visible",
    ),
    (
        "both kinds of sets",
        [VIEW, ("visible_ids", [], None), ("visible_ids", [], "left")],
        "frame 4: what is visible",
    ),
    ("a frame in a frame", [CAMERA, ("begin_frame", 5)], "frame 4: it has no end"),
    ("a group in a frame", [CAMERA, ("group", "a", ["b"])], "frame 4: a call out of place"),
    (
        "no higher number",
        [CAMERA, ("end_frame",), ("begin_frame", 4)],
        "frame 4: the next must have",
    ),
    ("between frames", [CAMERA, ("end_frame",), ("absent", "a")], "frame 4: a call out of place"),
)


AFTER: tuple[Call, ...] = (("end_frame",), ("begin_frame", 9), CAMERA, ("end_frame",))
OF_WRONG = Recordings(
    *(
        Recording(f"wrong {number}.jsonl", [*FRAME, ("begin_frame", 4), *calls, *AFTER])
        for number, (_, calls, _) in enumerate(WRONG)
    )
)


@each()
def test_what_goes_wrong_is_told_at_the_end_and_nothing_is_written_after_it(language, tmp_path):
    """Told by closing, and by the file's last line."""
    told = OF_WRONG.run(language, tmp_path)
    assert len(told) == len(WRONG)
    for number, ((what, calls, expected), one) in enumerate(zip(WRONG, told, strict=True)):
        assert one.startswith(f"problem: {expected}"), what
        lines = strict_lines((tmp_path / f"wrong {number}.jsonl").read_bytes())
        frames = [line["frame"] for line in lines[1:-1]]
        assert frames == ([0, 4] if ("end_frame",) in calls else [0]), what
        assert lines[-1] == {"stopped": one.removeprefix("problem: ")}, what


# What is no whole number, and how it is told; the calls' names are those of the language.
NOT_WHOLE: tuple[tuple[Call, str], ...] = (
    (("visible_ids", [1.5], None), "frame 4: visible got 1.5; ids are whole numbers"),
    (("visible_ids", [-1], None), "frame 4: visible got -1; ids are whole numbers"),
    (("visible_nodes", [1, 2.5], None), "frame 4: {} got 2.5; node indices are whole numbers"),
    (("level", "a", -1), "frame 4: level got -1; levels are whole numbers"),
    (("stat", "queries", -7), "frame 4: stat got -7; counts are whole numbers"),
)


SCRIPTS = ("javascript", "python", "gdscript")
OF_NOT_WHOLE = Recordings(
    *(
        Recording(
            f"whole {number}.jsonl", [*FRAME, ("begin_frame", 4), CAMERA, call, ("end_frame",)]
        )
        for number, (call, _) in enumerate(NOT_WHOLE)
    ),
    languages=SCRIPTS,
)


@each(*SCRIPTS)
def test_numbers_that_are_not_whole_are_told_with_the_call_that_got_them(language, tmp_path):
    nodes = "visibleNodes" if language.name == "javascript" else "visible_nodes"
    expected = [f"problem: {text.format(nodes)}" for _, text in NOT_WHOLE]
    assert OF_NOT_WHOLE.run(language, tmp_path) == expected


OF_PLACES = Recordings(
    Recording("a.jsonl", [*FRAME, ("begin_frame", 1), CAMERA]),
    Recording("b.jsonl", [("visible_ids", [1], None), *FRAME]),
    Recording("nowhere/c.jsonl", FRAME),
    Recording("d.jsonl", []),
    Recording("e.jsonl", [CAMERA, *FRAME]),
)


@each()
def test_a_frame_without_an_end_a_frame_s_call_before_all_and_a_missing_folder_are_told(
    language, tmp_path
):
    told = OF_PLACES.run(language, tmp_path)
    assert told[:2] == ["problem: frame 1: it has no end", "problem: a call out of place"]
    assert told[2].startswith("problem: cannot open the file: ")
    assert told[3:] == ["ok", "problem: a call out of place"]
    (_, frame, stopped) = strict_lines((tmp_path / "a.jsonl").read_bytes())
    assert frame["frame"] == 0
    assert stopped == {"stopped": "frame 1: it has no end"}
    for name in "be":
        assert strict_lines((tmp_path / f"{name}.jsonl").read_bytes()) == [
            {"stopped": "a call out of place"}
        ]
    assert strict_lines((tmp_path / "d.jsonl").read_bytes()) == expected_lines([], 64, 48)


# In a shell that lets no file grow beyond 4 KiB, as a full disk does.
FULL = ("bash", "-c", "trap '' XFSZ; ulimit -f 4; exec \"$@\"", "bash")


# More than any recorder's buffer of 64 KiB.
LONG: list[Call] = []
for _frame in range(24):
    LONG += [("begin_frame", _frame), CAMERA, ("visible_names", ["a" * 3000], None)]
    LONG += [("end_frame",)]
OF_LONG = Recordings(Recording("long.jsonl", LONG))


@each()
def test_a_disk_that_is_full_is_told(language, tmp_path):
    (told,) = OF_LONG.run(language, tmp_path, prefix=FULL)
    assert told.startswith("problem: ")
    assert "cannot write: " in told
    file = tmp_path / "long.jsonl"
    assert file.stat().st_size == 4096
    assert OF_LONG.run(language, tmp_path) == ["ok"]
    assert strict_lines(file.read_bytes()) == expected_lines(LONG, 64, 48)


CRASHED: list[Call] = []
for _frame in range(30):
    CRASHED += [("begin_frame", _frame), CAMERA, ("end_frame",)]
    CRASHED += [("flush",)] if _frame == 9 else []
OF_CRASHED = Recordings(Recording("crashed.jsonl", [*CRASHED, ("kill",)]))


@each()
def test_what_was_flushed_outlives_a_crash(language, tmp_path):
    """And what follows is whole lines, and perhaps a piece of one."""
    assert OF_CRASHED.run(language, tmp_path) == []
    text = (tmp_path / "crashed.jsonl").read_bytes()
    whole = strict_lines(text[: text.rindex(b"\n") + 1])
    expected = expected_lines(CRASHED, 64, 48)
    assert len(whole) >= 11
    assert whole == expected[: len(whole)]


def random_floats() -> np.ndarray:
    """20 matrices, float32 [20, 16], of normal ones: a program built with -ffast-math takes all
    smaller ones for zero."""
    rng = np.random.default_rng(5)
    bits = rng.integers(0x00800000, 0x7F800000, (20, 16), dtype=np.uint32)
    return np.where(rng.random((20, 16)) < 0.5, -1, 1).astype(np.float32) * bits.view(np.float32)


FLOATS: list[Call] = []
for _frame, _matrix in enumerate(random_floats()):
    _numbers = [float(x) for x in _matrix]
    FLOATS += [("begin_frame", _frame), ("end_frame",)]
    FLOATS.insert(-1, ("camera_f", "world_from_camera", "column_major", _numbers, None))
COMPILED = ("c", "c++", "rust", "csharp")
OF_FLOATS = Recordings(Recording("floats.jsonl", FLOATS), languages=COMPILED)


@each(*COMPILED)
def test_floats_are_written_with_the_digits_that_a_float_needs(language, tmp_path):
    floats = random_floats()
    assert OF_FLOATS.run(language, tmp_path) == ["ok"]
    text = (tmp_path / "floats.jsonl").read_bytes()
    read = np.array([line["world_from_camera"] for line in strict_lines(text)[1:]])
    assert np.array_equal(read.astype(np.float32).reshape(20, 16), floats)
    # A double of so many floats would take 17 digits each.
    assert len(text) / (20 * 16) < 20


def sources(folder):
    """The files that someone copies of a recorder: all but its page and Python's compiled code."""
    return [
        file
        for file in sorted(folder.rglob("*"))
        if file.is_file() and file.suffix != ".md" and "__pycache__" not in file.parts
    ]


def test_every_source_is_short_and_every_folder_says_how_to_use_it():
    folders = [folder for folder in RECORDERS.iterdir() if folder.is_dir()]
    assert len(folders) == 6
    for folder in folders:
        for source in sources(folder):
            assert len(source.read_text("utf-8").splitlines()) < 300, source
        readme = (folder / "README.md").read_text("utf-8")
        assert 8 <= len([line for line in readme.splitlines() if line.strip()]) <= 40
        assert "visref check" in readme


@pytest.mark.needs("rustc")
def test_in_rust_the_feature_off_makes_every_call_nothing(tmp_path):
    off = ("--cfg", 'feature="off"')
    calls = [("text", "units", "a"), *FRAME, ("begin_frame", 0), ("absent", "a")]
    recording = Recording("recording.jsonl", calls)
    for flags, told, left in ((off, "ok", False), ((), "problem: frame 0: the next must", True)):
        (command,) = build_rust([recording], tmp_path, *flags)
        done = subprocess.run([command], cwd=tmp_path, capture_output=True, text=True, check=True)
        assert done.stdout.startswith(told)
        assert (tmp_path / recording.file).exists() == left


# How a call looks in a language's documentation, and where it is defined in its source.
SPELLED = {
    "c": (r"\b(visref_\w+)\b(?!\.h)|\b(VISREF_\w+)", r"\b{}\b"),
    "rust": (r"\br\.(\w+)\(|`(?:Recorder::)?(\w+)(?:\(|`)", r"\b{}\b"),
    "csharp": (r"\br\.(\w+)\(|`(\w+)\(", r"\b{}\b"),
    "javascript": (r"\br\.(\w+)\(|`(\w+)\(", r"\b{}\b"),
    "gdscript": (r"\brecorder\.(\w+)\(|`(\w+)\(", r"func {}\("),
    "python": (r"\br\.(\w+)\(|`(\w+)\(", r"def {}\("),
}
# What else stands there: of the engines.
OTHERS = {"look_at_rh", "look_at_lh", "to_cols_array", "lookAt", "GlobalTransform", "ColumnMajor"}


@pytest.mark.parametrize("folder", sorted(SPELLED))
def test_calls_that_a_folder_s_documentation_names_exist(folder):
    call, defined = SPELLED[folder]
    source = "\n".join(file.read_text("utf-8") for file in sources(RECORDERS / folder))
    readme = (RECORDERS / folder / "README.md").read_text("utf-8")
    named = {one for found in re.findall(call, readme) for one in found if one}
    assert len(named) > 4
    missing = {one for one in named - OTHERS if not re.search(defined.format(one), source)}
    assert not missing
