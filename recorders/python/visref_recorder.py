"""Writes what an engine saw and drew as a visref recording, one line per frame, for
`visref check SCENE --recording FILE`. Python 3.9 or newer, no other package; copy this in.

Within a frame the calls come in any order; what is said before the first frame is said of all. What
first goes wrong (a number that is not finite, a name that is no Unicode, a full disk, a call out of
place) is kept, nothing is written after it but a last line that tells it, and `close` raises it:
rendering goes on undisturbed.
`view` is None in a frame whose one view has no name. Cameras: README.md beside this file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from operator import index
from typing import Any, Optional, Union

Matrix = Union[Sequence[float], Sequence[Sequence[float]]]
Camera = tuple[str, list[list[float]]]
FORMS = ("world_from_camera", "camera_from_world", "clip_from_world")
BUFFER = 1 << 16


class RecordingError(Exception):
    """What went wrong first."""


class Recorder:
    """A recording that is being written. As a context manager it closes itself."""

    def __init__(self, file: str, width: int, height: int) -> None:
        """`width`, `height`: of the view, in pixels."""
        self.problem: Optional[str] = None
        self._number = -1
        self._open = True
        self._full = False  # the file takes no more
        self._header: dict[str, Any] = {"format": "visref-recording", "version": 1}
        self._start({"width": int(width), "height": int(height)})
        try:
            self._file = open(  # noqa: SIM115 (it stays open)
                file, "w", encoding="utf-8", newline="\n", buffering=BUFFER
            )
        except OSError as error:
            self._file = None
            self._fail(f"cannot open the file: {error.strerror}")

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, kind: Any, *_: Any) -> None:
        if kind is None:
            self.close()
            return
        if issubclass(kind, Exception):  # not SystemExit, with which some engines end
            self._fail(f"the program raised {kind.__name__}")
        with suppress(RecordingError):  # the program's own exception is the one to see
            self.close()

    def begin_frame(self, number: int) -> None:
        """`number`: ascending; gaps are allowed."""
        if self._number < 0:
            self._write_header()
        elif self._open:
            self._fail("it has no end")
        if number <= self._number:
            self._fail("the next must have a higher number")
        self._number = int(number)
        self._open = True
        self._start({"frame": self._number})

    def time(self, seconds: float) -> None:
        self.field("time_s", seconds)

    def cut(self) -> None:
        """The camera has jumped."""
        if self._may():
            self._frame["cut"] = True

    def camera(
        self, form: str, matrix: Matrix, view: Optional[str] = None, *, column_major: bool = False
    ) -> None:
        """`form`: one of FORMS. `matrix`: four rows of four numbers, or 16 numbers."""
        if self._may(in_frame=True):
            fields = self._view(view)
            if form not in FORMS or any(known in fields for known in FORMS):
                self._fail("a second camera" if form in FORMS else f"a camera cannot be a {form}")
            fields[form] = self._matrix(matrix, column_major)

    def field(self, name: str, value: float, view: Optional[str] = None) -> None:
        """`name`: "near", "far" (math.inf: endless), "yfov" (vertical, radians) or "ymag" (half the
        view's height), "fps", "shift_x_px", "shift_y_px"; "width" and "height" of a view of another
        size."""
        if self._may():
            real = None if value == math.inf else self._real(value)
            whole = name in ("width", "height") and math.isfinite(value)
            self._view(view)[name] = int(value) if whole else real

    def text(self, name: str, text: str) -> None:
        """`name`: "units" (a file of meshlets or batches, which `visible` then lists); of
        clip_from_world "clip_depth": "-1..1" (OpenGL), "0..1", or "1..0" (reversed), and "clip_y":
        "down" (Vulkan)."""
        if self._may():
            self._frame[name] = text

    def group(self, name: str, objects: Iterable[str]) -> None:
        """Objects, by name or path, that the engine knows by one name."""
        if self._may(in_frame=False):
            self._frame.setdefault("groups", {})[name] = list(objects)

    def visible(self, drawn: Iterable[Union[int, str]], view: Optional[str] = None) -> None:
        """Ids and names, of objects or groups; `()` says that nothing was drawn."""
        if self._may(in_frame=True):
            whole = self._whole
            names = [x if isinstance(x, str) else whole(x, "visible", "ids") for x in drawn]
            self._of_view("visible", view).extend(names)

    def visible_nodes(self, nodes: Iterable[int], view: Optional[str] = None) -> None:
        """The same by glTF node index."""
        if self._may(in_frame=True):
            numbers = [self._whole(x, "visible_nodes", "node indices") for x in nodes]
            self._of_view("visible_nodes", view).extend(numbers)

    def absent(self, name: str) -> None:
        if self._may(in_frame=True):
            self._frame.setdefault("absent", []).append(name)

    def pose(self, name: str, matrix: Matrix, *, column_major: bool = False) -> None:
        """`matrix`: world_from_object of an object, or what moves a whole group."""
        self._part("world_from_object", name, lambda: self._matrix(matrix, column_major))

    def level(self, group: str, level: int) -> None:
        self._part("levels", group, lambda: self._whole(level, "level", "levels"))

    def bounds(self, name: str, least: Sequence[float], greatest: Sequence[float]) -> None:
        """The box that was tested, in world space."""
        self._part("bounds", name, lambda: [[self._real(x) for x in p] for p in (least, greatest)])

    def stat(self, name: str, count: int) -> None:
        self._part("stats", name, lambda: self._whole(count, "stat", "counts"))

    def stat_ms(self, phase: str, ms: float) -> None:
        if self._may(in_frame=True):
            phases = self._frame.setdefault("stats", {}).setdefault("ms", {})
            phases[phase] = self._real(ms)

    def end_frame(self) -> None:
        if not self._may(in_frame=True):
            return
        self._open = False
        views = self._frame.get("views", {})
        for fields in views.values() or [self._frame]:
            if not any(form in fields or form in self._frame for form in FORMS):
                self._fail("no camera")
        given = [(key, view is None) for key, sets in self._sets.items() for view in sets]
        if len(set(given)) > 1:
            self._fail("what is visible is given in two ways")
        key, joint = given[0] if given else ("visible", True)
        sets = self._sets[key]
        self._frame[key] = sets.get(None, []) if joint else {v: sets.get(v, []) for v in views}
        self._write(self._frame)

    def flush(self) -> None:
        """What is written is not to be lost in a crash."""
        if self.problem is None and self._file is not None:
            try:
                self._file.flush()
            except OSError as error:
                self._full = True
                self._fail(f"cannot write: {error.strerror}")

    def close(self) -> None:
        """Raise RecordingError if anything went wrong."""
        if self._number < 0:
            self._write_header()
        elif self._open:
            self._fail("it has no end")
        if self._file is not None:
            with suppress(OSError):
                self._write_stopped()
            try:
                self._file.close()
            except OSError as error:
                self._fail(f"cannot write: {error.strerror}")
        if self.problem is not None:
            raise RecordingError(self.problem)

    def _start(self, fields: dict[str, Any]) -> None:
        self._frame = fields
        self._sets: dict[str, dict[Optional[str], list[Any]]] = {"visible": {}, "visible_nodes": {}}

    def _write_header(self) -> None:
        self._write({**self._header, **self._frame})

    def _may(self, in_frame: Optional[bool] = None) -> bool:
        """`in_frame`: whether the call belongs into a frame, or before all; None: both."""
        if not self._open or (in_frame is not None and in_frame != (self._number >= 0)):
            self._fail("a call out of place")
        return self.problem is None

    def _view(self, view: Optional[str]) -> dict[str, Any]:
        if view is None:
            return self._frame
        fields: dict[str, Any] = self._frame.setdefault("views", {}).setdefault(view, {})
        return fields

    def _of_view(self, key: str, view: Optional[str]) -> list[Any]:
        self._view(view)
        return self._sets[key].setdefault(view, [])

    def _part(self, part: str, name: str, value: Any) -> None:
        if self._may(in_frame=True):
            self._frame.setdefault(part, {})[name] = value()

    def _real(self, value: float) -> float:
        real = float(value)
        if not math.isfinite(real):
            self._fail("a number is not finite")
        return real

    def _whole(self, value: Any, call: str, what: str) -> int:
        try:
            whole = index(value)
        except TypeError:
            whole = -1
        if whole < 0:
            self._fail(f"{call} got {value!r}; {what} are whole numbers")
        return whole

    def _matrix(self, matrix: Matrix, column_major: bool) -> list[list[float]]:
        flat: list[float] = []
        for row in matrix:
            flat.extend(row if hasattr(row, "__iter__") else [row])
        if len(flat) != 16:
            self._fail("a matrix has 16 numbers")
            return []
        rows = [[self._real(x) for x in flat[4 * i : 4 * i + 4]] for i in range(4)]
        return [list(column) for column in zip(*rows)] if column_major else rows

    def _write(self, line: dict[str, Any]) -> None:
        if self.problem is not None or self._file is None:
            return
        try:
            self._file.write(json.dumps(line, ensure_ascii=False, separators=(",", ":")) + "\n")
        except UnicodeEncodeError:
            self._fail("a name is no Unicode")
        except OSError as error:
            self._full = True
            self._fail(f"cannot write: {error.strerror}")

    def _write_stopped(self) -> None:
        """The last line of a recording that ends too early, unless the file takes no more."""
        if self.problem is None or self._full or self._file.closed:
            return
        told = self.problem.encode("utf-8", "replace").decode("utf-8")
        self._file.write(json.dumps({"stopped": told}, ensure_ascii=False) + "\n")

    def _fail(self, problem: str) -> None:
        if self.problem is None:
            where = f"frame {self._number}: " if self._number >= 0 else ""
            self.problem = where + problem


# Cameras, for `recorder.camera(*from_blender(...))`.


def yfov_from_xfov(xfov: float, width: int, height: int) -> float:
    """The vertical field of view of a horizontal one, in radians; square pixels."""
    return 2 * math.atan(math.tan(xfov / 2) * height / width)


def from_blender(matrix_world: Sequence[Sequence[float]]) -> Camera:
    """`matrix_world` of a camera object (Z up), for a scene exported as glTF with +Y up."""
    x, y, z, last = ([float(v) for v in row] for row in matrix_world)
    return "world_from_camera", [x, z, [-v for v in y], last]


def from_panda3d(mat: Sequence[Sequence[float]]) -> Camera:
    """`camera.get_mat(render)` (row vectors, Z up, the camera looks along +Y), for a scene in glTF,
    whose (x, y, z) is Panda's (x, -z, y)."""
    right, forward, up, location = ([row[0], row[2], -row[1]] for row in mat)
    columns = (right, up, [-v for v in forward], location)
    return "world_from_camera", [[c[i] for c in columns] for i in range(3)] + [[0, 0, 0, 1]]


def from_opencv(rotation: Sequence[Sequence[float]], translation: Sequence[float]) -> Camera:
    """R and t of OpenCV (camera_from_world, x right, y down, z forward), in the scene's world."""
    rows = [[*map(float, row), float(t)] for row, t in zip(rotation, translation)]
    return "camera_from_world", [
        rows[0],
        [-v for v in rows[1]],
        [-v for v in rows[2]],
        [0, 0, 0, 1],
    ]
