"""An engine's recordings of the suite: a file per case, all in one folder.

`CASE.jsonl` is a recording, or recorded visible sets; these may as well be `CASE.csv` or
`CASE.parquet`. Nothing else stands there but the suite's manifest, and the units files that
recordings name: a misspelt name would pass for a case that was not recorded.

A recording says which cameras it was made with and how things stood. It is judged by the case's own
path; where what it says is not that, it is of another case.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from visref.camera_path import CameraPath
from visref.conformance.declared import Declared
from visref.conformance.files import EXPECTED, MANIFEST, WrittenCase
from visref.culler import Culler, CullerError, Promise, RasterTolerance
from visref.errors import InputError
from visref.files import open_file
from visref.findings import Code
from visref.recordings.along import check_along
from visref.recordings.recording import RECORDING_FORMAT, read_recording
from visref.recordings.visible_sets import Replay, VisibleSets, read_visible_sets
from visref.wording import did_you_mean

_SUFFIXES = (".jsonl", ".csv", ".parquet")
# A header that is longer than this is none.
_HEADER_BYTES = 1 << 24


@dataclass(frozen=True, eq=False)
class Recordings:
    """The recordings of a folder, read and found to be those of the suite; an `Entrant`. `sets`:
    by case; `faults`: by case, why its recording answers not all of it."""

    name: str
    sets: Mapping[str, VisibleSets]
    promise: Promise = Promise.CONSERVATIVE
    raster: RasterTolerance | None = None
    faults: Mapping[str, str] = field(default_factory=dict)

    @contextmanager
    def culler(self, case: WrittenCase) -> Iterator[Culler]:
        """What was recorded of a case. Raises CullerError where that is not all of it."""
        if case.name in self.faults:
            raise CullerError(self.faults[case.name])
        if case.name not in self.sets:
            raise CullerError(f"there is no recording of it: {case.name}.jsonl is missing")
        yield Replay(self.sets[case.name], case.case.path, self.promise, self.raster)


def read_recordings(
    folder: Path,
    cases: Sequence[WrittenCase],
    declared: Declared,
    *,
    promise: Promise = Promise.CONSERVATIVE,
    raster: RasterTolerance | None = None,
    max_memory: int | None = None,
) -> Recordings:
    """Read the recordings of what the engine is made for. Raises InputError for a file that is no
    recording of its case, for two of one case, and for any file that is of none."""
    files, others = _files_of(folder, cases)
    sets: dict[str, VisibleSets] = {}
    faults: dict[str, str] = {}
    # A folder of units files is theirs altogether.
    units = {Path(named).parts[0] for file in files.values() if (named := _units_of(file))}
    for other in others:
        if other.name not in units:
            names = [case.name for case in cases]
            near = did_you_mean(other.stem, names, "take it out: recordings stand there alone")
            raise InputError("it is of no case of the suite", source=str(other), fix=near)
    for case in cases:
        file = files.get(case.name)
        if file is None or declared.lacks(case.classes):
            continue
        if _header(file) is None:
            frames = range(len(case.path))
            sets[case.name] = read_visible_sets(
                file, case.scene, frames, case.case.path, max_memory=max_memory
            )
            continue
        found = read_recording(file, case.scene, max_memory=max_memory)
        try:
            check_along(found.path, case.path)
        except InputError as error:
            raise error.at(source=str(file)) from error
        sets[case.name] = found.sets
        if fault := _incomplete(found.path, case.path):
            faults[case.name] = fault
    return Recordings(folder.absolute().name, sets, promise, raster, faults)


def _files_of(folder: Path, cases: Sequence[WrittenCase]) -> tuple[dict[str, Path], list[Path]]:
    """The file of each case that has one, and whatever else stands there."""
    try:
        entries = sorted(folder.iterdir())
    except OSError as error:
        raise InputError(
            f"cannot read the folder: {error.strerror}",
            source=str(folder),
            fix="name the folder with the engine's recordings",
        ) from error
    if any(entry.name == EXPECTED for entry in entries):
        raise InputError(
            "this is the suite itself",
            source=str(folder),
            fix="give the recordings a folder of their own",
        )
    names = {case.name for case in cases}
    found: dict[str, Path] = {}
    others = []
    for entry in entries:
        if entry.name == MANIFEST or entry.name.startswith("."):
            continue
        if entry.stem not in names or entry.suffix not in _SUFFIXES:
            others.append(entry)
        elif entry.stem in found:
            raise InputError(
                f"there is {found[entry.stem].name} too", source=str(entry), fix="keep one"
            )
        else:
            found[entry.stem] = entry
    if not found and not others:
        first = next(iter(cases)).name
        raise InputError(
            "there is no recording in it", source=str(folder), fix=f"write {first}.jsonl and so on"
        )
    return found, others


def _header(file: Path) -> Mapping[str, object] | None:
    """The header of a one-file recording, None of any other file."""
    if file.suffix != ".jsonl":
        return None
    try:
        with open_file(file) as opened:
            line = opened.readline(_HEADER_BYTES)
    except InputError as error:
        raise error.at(source=str(file)) from error
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        # Half a header is that of a recording whose engine died at once.
        return {} if RECORDING_FORMAT.encode() in line else None
    is_header = isinstance(found, dict) and found.get("format") == RECORDING_FORMAT
    return found if is_header else None


def _units_of(file: Path) -> str | None:
    named = (_header(file) or {}).get("units")
    return named if isinstance(named, str) and Path(named).parts and "\0" not in named else None


def _incomplete(recorded: CameraPath, path: CameraPath) -> str:
    missing = [number for number in path.numbers if not recorded.has(number)]
    if not missing:
        return ""
    said = next((text for code, text in recorded.remarks if code is Code.RECORDING_CUT_OFF), "")
    if said:
        return f"{Code.RECORDING_CUT_OFF}: {said}"
    return f"its recording has {len(recorded)} of {len(path)} frames; {missing[0]} is missing"
