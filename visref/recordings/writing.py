"""Writing a recording from Python: an engine, or a script that has its log."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

import numpy as np

from visref.errors import InputError
from visref.findings import Code
from visref.path_frame import Remarks, frame_of, shared_of
from visref.recordings.recording import (
    HEADER_FIELDS,
    MOST_FRAME,
    RECORDING_FORMAT,
    RECORDING_VERSION,
)
from visref.recordings.rows import ROW_FIELDS, row_of
from visref.scene import clean_name


class RecordingWriter:
    """Writes a recording, a line per frame, each whole once `frame` returns.

        with RecordingWriter("run.jsonl", width=1280, height=720, near=0.1, yfov=1.0) as recording:
            recording.frame(0, world_from_camera=matrix, visible=["wall", 7])

    `shared`: what all frames share, fields of a camera path's top, and `groups` and `units`.
    Arrays, of NumPy too, are written as lists. Raises InputError for what no reader would take,
    unknown fields too, and OSError where the file cannot be written.
    """

    def __init__(self, file: Path | str, **shared: Any) -> None:
        remarks = Remarks()
        header = {"format": RECORDING_FORMAT, "version": RECORDING_VERSION, **_plain(shared)}
        self._shared, self._fps = shared_of(header, remarks, HEADER_FIELDS)
        _refuse_unknown(remarks)
        self._last = -1
        # Open as long as the engine records.
        # Lines are handed over as they are whole: an engine may die at any time.
        line = json_text(header, "header")
        self._text: TextIO = Path(file).open("w", 1, encoding="utf-8")  # noqa: SIM115
        self._text.write(line + "\n")

    def frame(
        self,
        frame: int,
        *,
        visible: Sequence[int | str] | Mapping[str, Sequence[int | str]] | None = None,
        visible_nodes: Sequence[int] | Mapping[str, Sequence[int]] | None = None,
        **fields: Any,
    ) -> None:
        """Write a frame: its number, above the one before; what was drawn, for all views or by
        view; and its `fields`: the camera's, `views`, `time_s`, `world_from_object`, `absent`,
        `levels`, `cut`, `stats`, `bounds`."""
        frame = _plain(frame)
        values: dict[str, Any] = {"frame": frame, **_plain(fields)}
        for name, drawn in (("visible", visible), ("visible_nodes", visible_nodes)):
            if drawn is not None:
                values[name] = _plain(drawn)
        place = f"frame {frame}"
        row_of(values, place)
        if not self._last < frame <= MOST_FRAME:
            raise InputError(
                f"it comes after frame {self._last}", place=place, fix="number frames ascending"
            )
        remarks = Remarks()
        try:
            frame_of(values, self._shared, None, remarks=remarks, place=place, beside=ROW_FIELDS)
        except InputError as error:
            raise error.at(place=place) from error
        _refuse_unknown(remarks)
        line = json_text(values, place)
        self._last = frame
        self._text.write(line + "\n")

    def close(self) -> None:
        """Write what is left. What comes after is refused by Python's closed file."""
        self._text.close()

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def json_text(values: Mapping[str, Any], place: str) -> str:
    """A line's JSON, in UTF-8 with the names that readers will find in it (`clean_name`). Raises
    InputError naming `place` for a number that is not finite, and for what is no JSON."""
    try:
        text = json.dumps(values, allow_nan=False, ensure_ascii=False)
    except (ValueError, TypeError) as error:
        raise InputError(
            f"JSON cannot say it: {str(error)[:200]}", place=place, fix="leave it out"
        ) from error
    return clean_name(text)


def _refuse_unknown(remarks: Remarks) -> None:
    for code, text in remarks.all("recording"):
        if code is Code.FIELD_IGNORED:
            raise InputError(text, fix="mend what is written")


def _plain(value: Any) -> Any:
    """The same in what JSON knows."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, (list, tuple, set, frozenset, range)):
        made = [_plain(one) for one in value]
        return sorted(made, key=repr) if isinstance(value, (set, frozenset)) else made
    return value
