"""What a run keeps on its way, so that the same command goes on with it after an end in between.

Beside the run folder that is to be stands a folder that lasts (`visref.beside.lasting`):

    command.json   what determines the result, by name: values and digests
    parts/A-B/     the frames at the places A to before B of the run, as `visref.merging` reads a
                   part, with `seal.json`: the digest of the command and of each of its files
    making/        parts that are being written

A part that is not as it was sealed is no part, and its frames are judged again. Parts of another
command are never used, and never removed.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from visref import beside
from visref.errors import InputError
from visref.files import lasting_beside
from visref.merging.reading import read_part
from visref.picking import Stretch
from visref.recordings.truth_reading import TruthRows
from visref.run_folder.inside import file_inside, json_inside
from visref.run_folder.write import write_json
from visref.wording import counted

# How long a part takes to judge, at least: so much is lost at most, and one more frame.
PART_S = 30.0

COMMAND, SEAL = "command.json", "seal.json"
_MAKING, _GONE = "making", "gone"
_NAME = re.compile("([0-9]{8,})-([0-9]{8,})")
_FIX = "remove it"


@dataclass(eq=False)
class Kept:
    """The parts of one command. `folder` is there, and nobody else's. `seconds`: how long a part
    takes to judge, at least. `spoilt`: what was wrong with parts that were removed."""

    folder: Path
    command: str
    seconds: float
    spoilt: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._made = self.folder / _MAKING
        with suppress(FileNotFoundError):
            shutil.rmtree(self._made)
        self._made.mkdir()
        self._parts.mkdir(exist_ok=True)

    @property
    def _parts(self) -> Path:
        return self.folder / beside.PARTS

    def begin(self) -> Path:
        """A new folder, for a part that is about to begin."""
        return Path(tempfile.mkdtemp(dir=self._made))

    def keep(self, folder: Path, stretch: Stretch) -> None:
        """The folder, which a part of these frames fills, is that part's for good. It moves."""
        files = {name: _digest(folder / name) for name in _names(folder)}
        write_json(folder / SEAL, {"command": self.command, "files": files})
        beside.on_disk(folder)
        folder.rename(self._parts / f"{stretch.start:08}-{stretch.stop:08}")
        beside.names_on_disk(self._parts)

    def finished(self) -> list[tuple[Stretch, Path]]:
        """What is there, in order, by names alone."""
        found = [
            (Stretch(int(match[1]), int(match[2])), path)
            for path in self._parts.iterdir()
            if (match := _NAME.fullmatch(path.name))
        ]
        return sorted(found, key=lambda one: (one[0].start, one[0].stop))

    def sound(self, frames: Sequence[int], truth: TruthRows | None = None) -> list[Stretch]:
        """The stretches that are finished, in order and apart, of a run over these frames. Whatever
        else is there is removed. `truth`: that of the file that the run goes by."""
        found: list[Stretch] = []
        known = self.finished()
        for path in {*self._parts.iterdir()} - {path for _, path in known}:
            _remove(path)
        for stretch, path in known:
            try:
                self._check(stretch, path, frames, truth)
                if found and stretch.start < found[-1].stop:
                    raise InputError("its frames are in another part too", fix=_FIX)
            except InputError as error:
                self.spoilt.append(f"the part {path.name}: {error.problem}")
                _remove(path)
            else:
                found.append(stretch)
        return found

    def _check(
        self, stretch: Stretch, path: Path, frames: Sequence[int], truth: TruthRows | None
    ) -> None:
        """Raises InputError where a part is not as it was kept."""
        if path.is_symlink() or not path.is_dir():
            raise InputError("it is no folder", fix=_FIX)
        seal = json_inside(path, SEAL, _FIX)
        if not isinstance(seal, dict) or seal.get("command") != self.command:
            raise InputError("it is not of this command", fix=_FIX)
        names = [name for name in _names(path) if name != SEAL]
        files = {name: _digest(file_inside(path, name, _FIX)) for name in names}
        if seal.get("files") != files:
            raise InputError("it is not as it was written", fix=_FIX)
        said = read_part(path, truth).said
        if said.shard != stretch or said.frames != tuple(frames):
            raise InputError("it is of other frames", fix=_FIX)

    def remove(self) -> None:
        """The run is whole: nothing is to be gone on with."""
        gone = self.folder / _GONE
        self._parts.rename(gone)
        shutil.rmtree(gone)


@contextmanager
def keeping(out: Path | str, asked: Mapping[str, str]) -> Iterator[Kept | None]:
    """What is kept for a run folder `out` by a command that is `asked`: what determines its result,
    by name. None where nothing can be kept there, as while another run does.

    Raises InputError where parts of another command are kept.
    """
    with lasting_beside(out) as folder:
        if folder is None:
            yield None
            return
        command = hashlib.sha256(json.dumps(dict(asked), sort_keys=True).encode()).hexdigest()
        shutil.rmtree(folder / _GONE, ignore_errors=True)
        kept = Kept(folder, command, PART_S)
        if kept.finished():
            _refuse_others(kept, asked)
        else:
            write_json(folder / COMMAND, dict(asked))
        yield kept


def _refuse_others(kept: Kept, asked: Mapping[str, str]) -> None:
    # Where that cannot be read, nobody knows whose they are.
    before = json_inside(kept.folder, COMMAND, f"remove {kept.folder}")
    if not isinstance(before, dict):
        before = {}
    other = sorted(
        name for name in {*before, *asked} if before.get(name, "") != asked.get(name, "")
    )
    if other:
        count = sum(stretch.stop - stretch.start for stretch, _ in kept.finished())
        raise InputError(
            f"{counted(count, 'frame')} of another command are kept for this folder: its "
            f"{' and its '.join(other[:3])} {'was' if len(other) == 1 else 'were'} otherwise",
            source=str(kept.folder),
            fix="give that command again, and it goes on; or remove this folder, and name --out "
            "once more",
        )


def _names(folder: Path) -> list[str]:
    """Of all files in a folder, by path with "/"; links are not followed."""
    found = []
    for at, folders, files in os.walk(folder):
        links = [name for name in folders if (Path(at) / name).is_symlink()]
        found += [(Path(at) / name).relative_to(folder).as_posix() for name in (*files, *links)]
    return sorted(found)


def _digest(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def _remove(path: Path) -> None:
    if path.is_symlink() or not path.is_dir():
        path.unlink()
    else:
        shutil.rmtree(path)
