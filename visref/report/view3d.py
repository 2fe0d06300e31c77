"""Freeze and fly: the scene in three dimensions, with what each culler did in each frame.

A run folder holds no geometry, so the scene is given beside it, and must be the one that was
judged. What draws it is three.js, as trimesh's viewer brings it along.
"""

from __future__ import annotations

import json
import re
import struct
import zipfile
from collections import defaultdict
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from visref.doing import doing
from visref.errors import InputError
from visref.inputs import open_scene
from visref.recordings.truth_reading import read_rows
from visref.report import words
from visref.report.packed import packed_bytes
from visref.report.thinned import Thinned, thinned
from visref.run_folder.facts import FIX
from visref.run_folder.inside import file_inside
from visref.run_folder.layout import MISS_KINDS, TRUTH, UNNAMED_VIEW, ObjectKind
from visref.run_folder.read import RunFolder
from visref.scene import Scene
from visref.wording import legible

# What the scene is simplified to; and what was missed or superfluous stays whole as far as a
# browser turns it without stopping.
TRIANGLES = 60_000
WHOLE_TRIANGLES = 2_000_000
# Of the page, with three.js and as base64; more is written beside it.
MAX_BYTES = 3_000_000

_THREE = re.compile(
    r"/\*\*\s*\* @license(?P<license>.*?)\*/\s*"
    r'!function.*?Object\.defineProperty\(t,"__esModule",\{value:!0\}\)\}\)\);',
    re.S,
)
_NO_THREE = (
    "The view in three dimensions is left out: this installation of trimesh does not bring "
    "three.js along (resources/templates/viewer.zip)."
)

Cell = tuple[int, str]


@dataclass(frozen=True)
class View3d:
    """The view as the page has it. `scene`, `three`: data and code, packed; `license`: the code's;
    `notes`: what is to be said of what is shown. Without `scene`, the notes say why there is
    none."""

    scene: str = ""
    three: str = ""
    license: str = ""
    notes: tuple[str, ...] = ()
    beside: bool = False

    def script(self) -> str:
        """The file beside the page."""
        data = json.dumps({"scene": self.scene, "three": self.three})
        return f"// three.js: {self.license}\nglobalThis.visrefScene3d = {data};\n"


def view3d_of(run: RunFolder, given: str | Scene, *, most: int = MAX_BYTES) -> View3d:
    """The view of a run of the scene that is `given`: loaded, a file, or a generated one; to be
    written beside the page if it takes more than `most` bytes. Raises InputError if that is
    another scene than the run's."""
    settings = run.manifest.settings
    scene = given
    if not isinstance(scene, Scene):
        scene, _, _ = open_scene(
            scene,
            cull_backfaces=settings.get("cull_backfaces") is True,
            lenient=settings.get("lenient") is True,
        )
    judged = run.manifest.scene
    if scene.digest != judged.sha256:
        raise InputError(
            f"this is not the scene that was judged: its digest is {scene.digest[:12]}…, the run's "
            f"{judged.sha256[:12]}…",
            source=scene.source,
            fix=f"give --scene {judged.source} as it was",
        )
    if run.manifest.version < 2 or not (run.folder / TRUTH).is_file():
        return View3d(notes=("The view in three dimensions needs the run folder's truth.parquet.",))
    three, license_ = three_js()
    if not three:
        return View3d(notes=(_NO_THREE,))
    with doing("simplifying the scene"):
        shown = thinned(scene, _told(run), TRIANGLES, WHOLE_TRIANGLES)
    data = packed_bytes(payload(run, scene, shown))
    code = packed_bytes(three.encode())
    large = len(data) + len(code) > most
    return View3d(data, code, license_, _notes(run, scene, shown), large)


def three_js() -> tuple[str, str]:
    """three.js and its licence's line, both empty where trimesh does not have it."""
    try:
        archive = files("trimesh") / "resources" / "templates" / "viewer.zip"
        with archive.open("rb") as file, zipfile.ZipFile(file) as opened:
            text = opened.read("viewer.html.template").decode("utf-8")
    except (OSError, KeyError, zipfile.BadZipFile, UnicodeDecodeError):
        return "", ""
    found = _THREE.search(text)
    if found is None or "SPDX-License-Identifier: MIT" not in found["license"]:
        return "", ""
    return found[0], " ".join(found["license"].replace("*", " ").split())


def payload(run: RunFolder, scene: Scene, shown: Thinned) -> bytes:
    """What the page's script unpacks: the length of a JSON head, 4 bytes, little-endian; the head,
    filled up with spaces to a multiple of 4; `triangles` as int32, `positions` as uint16; and per
    cell a bit per object, the lowest first: whether it is visible in this cell or in the one
    before, and not in both."""
    cells = [(frame, view) for frame in run.frame_numbers for view in run.manifest.samples[frame]]
    places = {cell: place for place, cell in enumerate(cells)}
    head = {
        "names": [legible(name) for name in scene.names],
        "vertices": shown.vertex_counts.tolist(),
        "triangles": shown.triangle_counts.tolist(),
        "low": shown.low.tolist(),
        "step": shown.step.tolist(),
        "core": scene.core_bounds.tolist(),
        "cells": [[*cell, _camera(run.manifest.samples[cell[0]][cell[1]])] for cell in cells],
        "cullers": [_culler(run, culler, places) for culler in run.cullers],
        "moves": _moves(run),
    }
    text = json.dumps(head, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    triangles = shown.triangles.astype("<i4").tobytes()
    positions = shown.positions.astype("<u2").tobytes()
    bits = np.packbits(_changed(run, scene, places), axis=1, bitorder="little").tobytes()
    return struct.pack("<I", len(text)) + text + triangles + positions + bits


def _moves(run: RunFolder) -> dict[str, Any]:
    """How many `objects` move in some frame, and `named`, those that do most often."""
    motion = run.manifest.motion
    if motion is None:
        return {"objects": 0, "named": []}
    return {"objects": motion.objects, "named": [one.object for one in motion.most]}


def _changed(run: RunFolder, scene: Scene, places: dict[Cell, int]) -> NDArray[np.bool_]:
    """(cells, n) bool: whose visibility is another than a cell before; at first, who is visible."""
    truth = read_rows(file_inside(run.folder, TRUTH, FIX), scene.object_count).recorded
    visible = np.zeros((len(places), scene.object_count), np.bool_)
    for (frame, view), row in places.items():
        if (frame, view) in truth.views:
            visible[row] = truth.seen(frame, view, scene.object_count)
    visible[1:] ^= visible[:-1].copy()
    return visible


def _camera(definition: Any) -> dict[str, Any]:
    def number(name: str) -> float:
        return float.fromhex(definition[name])

    far = number("far")
    return {
        "flat": definition["projection"] == "orthographic",
        "size": [definition["width"], definition["height"]],
        "near": number("near"),
        "far": far if np.isfinite(far) else None,
        "shift": [number("shift_x_px"), number("shift_y_px")],
        **{axis: [float.fromhex(one) for one in definition[axis]] for axis in ("e", "F", "R", "U")},
    }


def _culler(run: RunFolder, culler: str, places: dict[Cell, int]) -> dict[str, Any]:
    """A culler's `name`; by cell, whom it `missed` (objects and their ages, null where by right)
    and drew for nothing (`superfluous`); and `unlisted`, how many more of those there were."""
    missed: dict[int, list[tuple[int, int | None]]] = defaultdict(list)
    superfluous: dict[int, list[int]] = defaultdict(list)
    unlisted: dict[int, int] = {}
    by_object = run.manifest.cullers[culler].unit_kind == "object"
    rows = _rows(run.objects, culler, MISS_KINDS)
    for frame, view, obj, age in _columns(rows, "frame", "view", "object", "age"):
        for place in _cells(run, places, frame, view):
            missed[place].append((obj, age))
    if by_object:
        rows = _rows(run.objects, culler, (ObjectKind.SUPERFLUOUS,))
        for frame, view, unit in _columns(rows, "frame", "view", "unit"):
            for place in _cells(run, places, frame, view):
                superfluous[place].append(unit)
    for row in run.frames_of[culler]:
        for view in run.views_of(row):
            place = places[row.frame, view]
            more = (row.superfluous or 0) - len(superfluous.get(place, ()))
            if more > 0:
                unlisted[place] = more
    return {
        "name": culler,
        "shown": legible(culler),
        "missed": missed,
        "superfluous": superfluous,
        "unlisted": unlisted,
    }


def _cells(run: RunFolder, places: dict[Cell, int], frame: int, view: str | None) -> list[int]:
    """The cells that a row tells of: its own, or all of its frame."""
    if (frame, view or UNNAMED_VIEW) in places:
        return [places[frame, view or UNNAMED_VIEW]]
    return [places[frame, one] for one in run.manifest.samples[frame]]


def _rows(table: pa.Table, culler: str, kinds: tuple[ObjectKind, ...]) -> pa.Table:
    wanted = pc.is_in(table["kind"].cast(pa.string()), pa.array([one.value for one in kinds]))
    return table.filter(pc.and_(pc.equal(table["culler"], culler), wanted))


def _columns(table: pa.Table, *names: str) -> Any:
    return zip(*(table[name].to_pylist() for name in names), strict=True)


def _told(run: RunFolder) -> list[int]:
    """Objects that were missed, the most samples lost first, then those drawn for nothing."""
    lost: dict[int, int] = defaultdict(int)
    hidden: dict[int, int] = defaultdict(int)
    for culler in run.cullers:
        rows = _rows(run.objects, culler, MISS_KINDS)
        for obj, pixels in _columns(rows, "object", "pixels"):
            lost[obj] += pixels or 0
        if run.manifest.cullers[culler].unit_kind == "object":
            rows = _rows(run.objects, culler, (ObjectKind.SUPERFLUOUS,))
            for (unit,) in _columns(rows, "unit"):
                hidden[unit] += 1
    first = sorted(lost, key=lambda obj: (-lost[obj], obj))
    return first + sorted(hidden.keys() - lost.keys(), key=lambda obj: (-hidden[obj], obj))


def _notes(run: RunFolder, scene: Scene, shown: Thinned) -> tuple[str, ...]:
    drawn, every = len(shown.triangles), scene.triangle_count
    notes = []
    if drawn < every:
        notes.append(
            f"Simplified to {words.count(drawn)} of {words.count(every)} triangles, to be looked "
            "at: the verdict is from the whole scene."
        )
    told = _told(run)
    cut = int(np.count_nonzero(~shown.whole[told]))
    if cut:
        notes.append(
            f"Of the missed and superfluous objects, {words.count(cut)} of {words.count(len(told))}"
            " are simplified too."
        )
    if shown.left_out:
        notes.append(f"{words.counted(shown.left_out, 'object')}, the smallest, left out.")
    if run.manifest.motion is not None and run.manifest.motion.objects:
        moved = words.counted(run.manifest.motion.objects, "object")
        notes.append(
            f"What moves ({moved}) stands as it does at rest, not as in the frame; the ray of a "
            "witness is that of its frame."
        )
    return tuple(notes)
