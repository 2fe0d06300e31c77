"""Between a one-file recording and the pair of a camera path and recorded visible sets.

What both can say is carried over as it is written; what only one can say is refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from visref.camera import ALL_VIEWS
from visref.camera_path import PATH_FORMAT, PATH_VERSION, CameraPath
from visref.culler import QueryStats
from visref.errors import InputError
from visref.files import refuse_inputs, replacing_file
from visref.memory import Budget
from visref.recordings.recording import (
    HEADER_FIELDS,
    RECORDING_FORMAT,
    RECORDING_VERSION,
    RecordingLines,
)
from visref.recordings.rows import READERS, ROW_FIELDS, Row, reading
from visref.recordings.writing import json_text

_BESIDE = ("format", "version", *HEADER_FIELDS)


def pair_of_recording(
    recording: Path | str,
    path_out: Path | str,
    visible_out: Path | str,
    *,
    max_memory: int | None = None,
) -> tuple[int, str]:
    """Write a recording's camera path and visible sets, JSON and JSON Lines; returns how many
    frames there are, and how it was cut off, if it was.

    Frames are numbered anew from 0; after frames that the recording leaves out the path has a cut,
    and where `fps` gave the time, each frame says it. Raises InputError where the recording is
    wrong, and where it has units or groups of its own, which a pair cannot say.
    """
    recording = Path(recording)
    source = str(recording)
    for out in (path_out, visible_out):
        refuse_inputs(out, [recording])
    if Path(path_out).resolve() == Path(visible_out).resolve():
        raise InputError("path and visible sets are the same file", fix="name two")
    with reading(source):
        lines = RecordingLines(recording, Budget.of(max_memory))
        for name in HEADER_FIELDS:
            if lines.header.get(name):
                raise InputError(
                    f"it has {name} of its own, which a path and visible sets cannot say",
                    place=f"line 1: {name}",
                    fix="judge it as it is, with --recording",
                )
        top = {name: value for name, value in lines.header.items() if name not in _BESIDE}
        head = {"format": PATH_FORMAT, "version": PATH_VERSION, **top}
        with ExitStack() as closing:
            path_file = closing.enter_context(replacing_file(path_out))
            visible_file = closing.enter_context(replacing_file(visible_out))
            path_text = closing.enter_context(path_file.open("w", encoding="utf-8"))
            visible_text = closing.enter_context(visible_file.open("w", encoding="utf-8"))
            path_text.write(json_text(head, "line 1").removesuffix("}") + ', "frames": [')
            count = 0
            for count, (frame_number, frame, visible) in enumerate(_pairs(lines), 1):
                place = f"frame {frame_number}"
                path_text.write(("\n" if count == 1 else ",\n") + json_text(frame, place))
                visible_text.write(json_text(visible, place) + "\n")
            path_text.write("\n]}\n")
            if not count:
                raise InputError("there is no whole frame in it", fix="record one at least")
        return count, lines.cut_off


def _pairs(lines: RecordingLines) -> Iterator[tuple[int, dict[str, Any], dict[str, Any]]]:
    """The number, a path's frame and a line of visible sets for each line."""
    before = -1
    for index, line in enumerate(lines):
        frame = {name: value for name, value in line.values.items() if name not in ROW_FIELDS}
        if line.number != before + 1 and index:
            frame["cut"] = True
        if lines.fps is not None and index != line.number:
            frame["time_s"] = line.frame.time_s
        before = line.number
        said = {name: line.values[name] for name in ROW_FIELDS if name in line.values}
        yield line.number, frame, {**said, "frame": index}


def recording_of_pair(
    path: Path | str, visible: Path | str, out: Path | str, *, max_memory: int | None = None
) -> int:
    """Write the recording that a camera path and visible sets (.jsonl, .csv or .parquet) make;
    returns how many frames it has: those of the visible sets.

    Raises InputError where one of them is wrong, or a frame is not on the path or comes twice.
    """
    for given in (path, visible):
        refuse_inputs(out, [given])
    source = str(visible)
    budget = Budget.of(max_memory)
    cameras = CameraPath.load(path, budget=budget)
    written = cameras.to_json()
    frames = written.pop("frames")
    reader = READERS.get(Path(visible).suffix.lower())
    if reader is None:
        raise InputError(
            "recorded visible sets are .jsonl, .csv or .parquet", source=source, fix="rename it"
        )
    rows: dict[int, dict[str, Any]] = {}
    with reading(source):
        for row in reader(Path(visible), budget):
            if not cameras.has(row.frame) or row.frame in rows:
                twice = "comes twice" if row.frame in rows else "is not on the path"
                raise InputError(
                    f"frame {row.frame} {twice}", place=row.place, fix="record each frame once"
                )
            size = sum(map(len, row.sets.values())) + 8 * len(row.bounds) + 10
            budget.claim("its frames up to here", 60 * size, place=row.place)
            rows[row.frame] = _row_json(row)
    if not rows:
        raise InputError("there is no frame in it", source=source, fix="record one at least")
    header = {**written, "format": RECORDING_FORMAT, "version": RECORDING_VERSION}
    with replacing_file(out) as file, file.open("w", encoding="utf-8") as text:
        text.write(json_text({"format": RECORDING_FORMAT, **header}, "header") + "\n")
        for number in sorted(rows):
            said = {"frame": number, **frames[number], **rows[number]}
            text.write(json_text(said, f"frame {number}") + "\n")
    return len(rows)


def _row_json(row: Row) -> dict[str, Any]:
    sets: Any = row.sets[ALL_VIEWS] if list(row.sets) == [ALL_VIEWS] else row.sets
    values: dict[str, Any] = {"visible_nodes" if row.nodes else "visible": sets}
    counted = {name: value for name, value in vars(row.stats).items() if value is not None}
    if row.stats != QueryStats():
        values["stats"] = {name: value for name, value in counted.items() if value != {}}
    if row.bounds:
        values["bounds"] = {name: [list(one) for one in box] for name, box in row.bounds.items()}
    return values
