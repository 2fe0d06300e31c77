"""Camera poses that other programs wrote: CSV, TUM trajectories, COLMAP reconstructions.

- CSV: a heading line with `x, y, z, qx, qy, qz, qw` in any order, and `time_s` where there is one;
  other columns are left alone. A row per frame.
- TUM (the RGB-D benchmark of Sturm et al. 2012): `timestamp x y z qx qy qz qw`, lines with # are
  comments. Times are counted from the first pose.
- COLMAP: `images.txt`; see `visref.paths.colmap`.

Position and quaternion take the camera's own axes to the world's, those of a convention.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from visref.camera_forms import rotation_matrix
from visref.camera_path import CameraPath, Frame
from visref.clip_matrices import RIGID_TOLERANCE
from visref.errors import InputError
from visref.files import map_file
from visref.memory import Budget
from visref.numerals import decimal_number
from visref.paths.colmap import decoded, is_colmap, read_colmap
from visref.paths.conventions import Convention
from visref.paths.lens import Lens
from visref.scene import Float64

# Where neither the file nor the lens says it; what is often meant where one unit is a metre.
DEFAULT_NEAR = 0.1

_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")


# A pose as a frame: its camera's matrix as an array of its own, its fields, and lists on the way.
_POSE_BYTES = 2500


def from_poses(
    file: Path,
    convention: Convention,
    lens: Lens | None,
    *,
    near: float,
    far: float,
    max_memory: int | None = None,
) -> CameraPath:
    """A frame for each pose of a file; which of the three kinds it is shows in the file itself.

    `lens`: of all cameras; None takes COLMAP's own from the `cameras.txt` beside it, which the
    other kinds do not have. Raises InputError with the file and the line, and where the file needs
    more than `max_memory` bytes (None: a share of what is free).
    """
    try:
        budget = Budget.of(max_memory)
        data = map_file(file)
        # Its text, its lines and the words of one of them.
        budget.claim("its text", 8 * data.size)
        lines = decoded(data.tobytes()).splitlines()
        budget.claim(f"{len(lines):,} poses", len(lines) * _POSE_BYTES)
        if is_colmap(lines):
            return CameraPath(read_colmap(file, lines, convention, lens, near, far))
        rows = _csv(lines) if file.suffix.lower() == ".csv" else _tum(lines)
        used = lens if lens is not None else Lens(far=far)
        frames = [
            Frame((used.camera(_pose(numbers, convention, place), near),), time_s)
            for place, time_s, numbers in rows
        ]
        if not frames:
            raise InputError("there is no pose in it", fix="give a line per pose")
        return CameraPath(frames)
    except InputError as error:
        raise error.at(source=str(file)) from error


# Where the pose stands, its time, and x, y, z, qx, qy, qz, qw.
_Row = tuple[str, float | None, list[float]]


def _csv(lines: Sequence[str]) -> Iterator[_Row]:
    reader = csv.reader(lines, skipinitialspace=True)
    try:
        headings = [cell.strip() for cell in next(reader, [])]
        missing = [name for name in _COLUMNS if headings.count(name) != 1]
        if missing or headings.count("time_s") > 1:
            raise InputError(
                f"there is no one column {(missing or ['time_s'])[0]!r}",
                place="line 1",
                fix=f"write a heading with {', '.join(_COLUMNS)}, and time_s if there is one",
            )
        for cells in reader:
            place = f"line {reader.line_num}"
            if not any(cell.strip() for cell in cells):
                continue
            if len(cells) != len(headings):
                raise InputError(
                    f"it has {len(cells)} cells for {len(headings)} columns", place=place
                )
            row = dict(zip(headings, cells, strict=True))
            numbers = _decimals([row[name] for name in _COLUMNS], place)
            time_s = row.get("time_s", "").strip()
            yield place, _decimals([time_s], place)[0] if time_s else None, numbers
    except csv.Error as error:
        raise InputError(f"this is no CSV: {error}", place=f"line {reader.line_num}") from error


def _tum(lines: Sequence[str]) -> Iterator[_Row]:
    first: float | None = None
    for index, line in enumerate(lines, start=1):
        cells = line.split("#", 1)[0].split()
        if not cells:
            continue
        place = f"line {index}"
        if len(cells) != 8:
            raise InputError(
                f"it has {len(cells)} numbers, and no pose has",
                place=place,
                fix="give timestamp x y z qx qy qz qw (TUM), COLMAP's images.txt, or a .csv file",
            )
        stamp, *numbers = _decimals(cells, place)
        first = stamp if first is None else first
        yield place, stamp - first, numbers


def _decimals(cells: Sequence[str], place: str) -> list[float]:
    try:
        return [decimal_number(cell.strip()) for cell in cells]
    except ValueError as error:
        raise InputError(str(error), place=place, fix="write decimal numbers") from error


def _pose(numbers: Sequence[float], convention: Convention, place: str) -> Float64:
    try:
        rotation = unit_rotation(np.array(numbers[3:]))
    except InputError as error:
        raise error.at(place=place) from error
    return convention.pose(rotation, np.array(numbers[:3]))


def unit_rotation(quaternion: Float64) -> Float64:
    """(3, 3) float64, the rotation of a unit quaternion x, y, z, w. Raises InputError where it is
    further off than printing with few digits makes it."""
    length = float(np.linalg.norm(quaternion))
    if not abs(length * length - 1.0) <= RIGID_TOLERANCE:
        raise InputError(
            f"the quaternion's length is {length:.6g}", fix="give unit quaternions x, y, z, w"
        )
    return rotation_matrix(quaternion)
