"""An engine's recordings of the suite: a file per case, all in one folder.

`CASE.jsonl` is a recording, or recorded visible sets; these may as well be `CASE.csv` or
`CASE.parquet`. Nothing else stands there but the suite's manifest, and the units files that
recordings name: a misspelt name would pass for a case that was not recorded.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from visref.conformance.declared import Declared
from visref.conformance.files import MANIFEST, WrittenCase
from visref.culler import Culler, CullerError, Promise, RasterTolerance
from visref.errors import InputError
from visref.recordings.visible_sets import Replay, VisibleSets, read_visible_sets
from visref.wording import did_you_mean

_SUFFIXES = (".jsonl", ".csv", ".parquet")


@dataclass(frozen=True, eq=False)
class Recordings:
    """The recordings of a folder, read and found to be those of the suite; an `Entrant`. `sets`:
    by case."""

    name: str
    sets: Mapping[str, VisibleSets]
    promise: Promise = Promise.CONSERVATIVE
    raster: RasterTolerance | None = None

    @contextmanager
    def culler(self, case: WrittenCase) -> Iterator[Culler]:
        """What was recorded of a case. Raises CullerError where nothing was."""
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
    files = _files_of(folder, cases)
    sets = {}
    for case in cases:
        file = files.get(case.name)
        if file is None or declared.lacks(case.classes):
            continue
        frames = range(len(case.path))
        sets[case.name] = read_visible_sets(
            file, case.scene, frames, case.case.path, max_memory=max_memory
        )
    return Recordings(folder.name or str(folder), sets, promise, raster)


def _files_of(folder: Path, cases: Sequence[WrittenCase]) -> dict[str, Path]:
    """The file of each case that has one."""
    try:
        entries = sorted(folder.iterdir())
    except OSError as error:
        raise InputError(
            f"cannot read the folder: {error.strerror}",
            source=str(folder),
            fix="name the folder with the engine's recordings",
        ) from error
    names = [case.name for case in cases]
    found: dict[str, Path] = {}
    for entry in entries:
        if entry.name == MANIFEST or entry.name.startswith("."):
            continue
        if entry.stem not in names or entry.suffix not in _SUFFIXES:
            near = did_you_mean(entry.stem, names, "take it out: recordings stand there alone")
            raise InputError("it is of no case of the suite", source=str(entry), fix=near)
        if entry.stem in found:
            raise InputError(
                f"there is {found[entry.stem].name} too", source=str(entry), fix="keep one"
            )
        found[entry.stem] = entry
    if not found:
        raise InputError(
            "there is no recording in it",
            source=str(folder),
            fix=f"write {names[0]}.jsonl and so on",
        )
    return found
