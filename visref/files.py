"""Files in and out. Reading: bytes and JSON, with an InputError for whatever is wrong with them.
Writing without halves and without loss: everything is written beside its place and is on disk
before it is renamed into it (`visref.beside`), and what is not ours is never replaced.
"""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import stat
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from visref import beside
from visref.errors import InputError

Bytes = NDArray[np.uint8]

_BLOCK = 1 << 24
# What a disk says while it is written to, wherever in a block that is.
_FULL_OR_BROKEN = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)
# A folder that can be neither renamed nor removed: something is mounted there.
_MOUNTED = (errno.EBUSY, errno.EXDEV)


@dataclass(frozen=True)
class FolderKind:
    """How a folder that visref wrote is known. `marker`: the name of its JSON file that says so.
    `wrote`: from the content of that file, patterns of the files that stand in such a folder, by
    path with "/"; None where the content is not visref's."""

    marker: str
    wrote: Callable[[Any], Sequence[str] | None]


def _refuse(path: Path, reason: str, fix: str) -> InputError:
    return InputError(f"cannot write here: {reason}", source=str(path), fix=fix)


@contextmanager
def _refusing(target: Path, only: Sequence[int] = ()) -> Iterator[None]:
    """What the system refuses at `target` (of the `only` numbers) is said in one line."""
    try:
        yield
    except OSError as error:
        if only and error.errno not in only:
            raise
        raise _refuse(target, error.strerror or "no access", "name another place") from error


def for_arrow(file: Path, mode: str = "rb") -> Any:
    """A file that Arrow reads or writes (`wb`), opened, to be closed. Its own way to take a path
    breaks down on a name that is not UTF-8, and takes a leading ~ for the home folder."""
    import pyarrow as pa

    return pa.OSFile(os.fsencode(file.absolute()), mode)


def make_folder(folder: Path, *, asked: Path | None = None) -> None:
    """Make a folder and those that it stands in, where they are not there. Raises InputError, of
    the path that was `asked` for, where one of them is a file, or cannot be made."""
    target = folder if asked is None else asked
    with _refusing(target):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            up = (one for one in (folder, *folder.parents) if one.exists())
            raise _refuse(
                target, f"{next(up, folder)} is no folder", "name another place"
            ) from None


def _place(path: Path | str) -> Path:
    """Where a path leads: a link stays, and what it names is replaced; "." gets a name."""
    target = Path(os.path.realpath(path))
    if target.is_symlink():
        raise _refuse(target, "it is a link to itself", "name another place")
    return target


@contextmanager
def replacing_file(path: Path | str, *, begins: bytes = b"") -> Iterator[Path]:
    """Yields a path beside `path`; renames it there when the block ends well.

    What stands there already is replaced only if it is a file, and empty or one that `begins` so:
    never a folder, a device or a pipe.
    """
    target = _file_to_replace(path, begins)
    with _writing(target, target.parent, name=target.name) as folder:
        written = folder / beside.WRITTEN / target.name
        yield written
        with _refusing(target):
            beside.on_disk(written)
            written.replace(target)
            beside.names_on_disk(target.parent)


def check_replacing(path: Path | str, *, begins: bytes = b"") -> None:
    """Raises InputError where `replacing_file` would, before there is anything to write. What
    stands there stays; the folder that it is to stand in is made."""
    target = _file_to_replace(path, begins)
    with _writing(target, target.parent, name=target.name):
        pass


def _file_to_replace(path: Path | str, begins: bytes) -> Path:
    """Where a file leads that may be replaced; its folder is there."""
    with _refusing(Path(path)):
        target = _place(path)
        if target.is_dir():
            raise _refuse(target, "it is a folder", "name a file")
        if target.exists():
            if not target.is_file():
                raise _refuse(target, "it is no ordinary file", "name a file")
            with target.open("rb") as old:
                if old.read(len(begins)) not in (b"", begins):
                    raise _refuse(target, "what stands there is of another kind", "name a new file")
        make_folder(target.parent, asked=target)
        beside.sweep(target.parent)
    return target


@contextmanager
def _writing(target: Path, folder: Path, *, name: str, marker: str = "") -> Iterator[Path]:
    """`beside.beside`, with a full disk, or one that cannot be written to, said in one line."""
    with _refusing(target, _FULL_OR_BROKEN), ExitStack() as closing:
        with _refusing(target):
            path = closing.enter_context(beside.beside(folder, name=name, marker=marker))
        yield path


@contextmanager
def replacing_folder(path: Path | str, *, kind: FolderKind) -> Iterator[Path]:
    """Yields a new folder beside `path`; renames it there when the block ends well.

    An existing folder is replaced only if it is empty, or if its marker says that it is one of
    ours and it holds nothing else than what visref writes there. It is gone only once the new one
    stands in its place. Where it can be neither renamed nor removed (something is mounted there),
    the files are put into it.
    """

    def check(folder: Path, *, shared: bool = False) -> None:
        if reason := _not_ours(folder, kind, shared=shared):
            raise _refuse(target, reason, "name a new folder")

    def check_shared(folder: Path) -> None:
        check(folder, shared=True)

    with _refusing(Path(path)):
        target = _place(path)
        if target.exists() and not target.is_dir():
            raise _refuse(target, "it is no folder", "name a folder")
        make_folder(target.parent, asked=target)
        beside.sweep(target.parent)
        beside.sweep(target)
        stays = _stays(target)
        # Another run may be moving its files in.
        with beside.alone_in(target) if stays else nullcontext():
            beside.steady(target, check_shared if stays else check)
    if stays:
        with _writing(target, target, name="", marker=kind.marker) as folder:
            yield folder / beside.WRITTEN
            with _refusing(target):
                beside.on_disk(folder / beside.WRITTEN)
                beside.move_into(folder, check_shared, marker=kind.marker)
                beside.names_on_disk(target)
        return
    with _writing(target, target.parent, name=target.name) as folder:
        yield folder / beside.WRITTEN
        with _refusing(target):
            beside.on_disk(folder / beside.WRITTEN)
            try:
                beside.put(folder, target, check)
            except OSError as error:
                if error.errno not in _MOUNTED or not target.is_dir():
                    raise
                _put_into(folder / beside.WRITTEN, target, check_shared, kind.marker)
            beside.names_on_disk(target.parent)


def _stays(target: Path) -> bool:
    """Whether a folder can be neither renamed nor removed: what is for it is written into it."""
    return target.is_dir() and (os.path.ismount(target) or not os.access(target.parent, os.W_OK))


@contextmanager
def lasting_beside(path: Path | str) -> Iterator[Path | None]:
    """Yields a folder beside `path`, the same each time, that stays where its folder `parts` holds
    anything at the end; None where there can be none, or while another process has it."""
    with ExitStack() as closing:
        found = None
        try:
            target = _place(path)
            stays = _stays(target)
            folder = target if stays else target.parent
            folder.mkdir(parents=True, exist_ok=True)
            found = closing.enter_context(beside.lasting(folder, name=target.name))
        except (OSError, InputError):
            # Who writes to it says what is wrong.
            found = None
        yield found


def _put_into(written: Path, target: Path, check: beside.Check, marker: str) -> None:
    with beside.beside(target, name="", marker=marker) as inside:
        shutil.copytree(written, inside / beside.WRITTEN, dirs_exist_ok=True)
        beside.on_disk(inside / beside.WRITTEN)
        beside.move_into(inside, check, marker=marker)
        beside.names_on_disk(target)


def remove_folder(path: Path, kind: FolderKind) -> None:
    """Remove a folder of ours, if that is what stands there and nothing else is in it."""
    with suppress(OSError):
        if _not_ours(path, kind) is None:
            shutil.rmtree(path)


def _not_ours(folder: Path, kind: FolderKind, *, shared: bool = False) -> str | None:
    """Why a folder is not to be replaced; None where it is ours, empty, or not there. `shared`:
    other runs may be writing in it."""
    try:
        entries = list(folder.iterdir())
    except FileNotFoundError:
        return None
    unfinished = [entry for entry in entries if beside.is_unfinished(entry)]
    if unfinished and not shared:
        return "another command of visref is writing in it"
    entries = [entry for entry in entries if entry not in unfinished]
    if not entries:
        return None
    marker = folder / kind.marker
    if not _is_ordinary(marker):
        return f"the folder is not empty and has no {kind.marker}"
    try:
        wrote = kind.wrote(json.loads(marker.read_bytes()))
    except (ValueError, RecursionError):
        wrote = None
    if wrote is None:
        return f"the folder is not empty and its {kind.marker} is not visref's"
    for name in _files_in(folder, entries, _entered(wrote)):
        if not any(re.fullmatch(pattern, name) for pattern in wrote):
            return f"the folder holds {name!r}, which visref did not write"
    return None


def _entered(patterns: Sequence[str]) -> set[str]:
    """The patterns of the folders that lie on the way to files of some patterns."""
    parts = [pattern.split("/") for pattern in patterns]
    return {"/".join(part[:end]) for part in parts for end in range(1, len(part))}


def _files_in(top: Path, entries: Iterable[Path], entered: set[str]) -> Iterator[str]:
    """Paths below `top` of all that stands in a folder; only folders of the `entered` patterns are
    looked into, and anything but an ordinary file ends in "/"."""
    for entry in entries:
        name = entry.relative_to(top).as_posix()
        if _is_ordinary(entry):
            yield name
        elif (
            any(re.fullmatch(pattern, name) for pattern in entered)
            and entry.is_dir()
            and not entry.is_symlink()
        ):
            yield from _files_in(top, entry.iterdir(), entered)
        else:
            yield f"{name}/"


def _is_ordinary(path: Path) -> bool:
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


def refuse_inputs(out: Path | str, inputs: Iterable[Path | str | None]) -> None:
    """Raises InputError if writing to `out` would replace or remove one of the `inputs`, by this
    or another name. An input that is no file (a generated scene, None) is passed over."""
    target = Path(os.path.realpath(out))
    for given in inputs:
        if given is None or not os.path.lexists(given):
            continue
        source = Path(os.path.realpath(given))
        # The link itself, and what it leads to.
        names = (source, Path(os.path.realpath(Path(given).parent)) / Path(given).name)
        same = target.exists() and source.exists() and target.samefile(source)
        if same or any(name.is_relative_to(target) for name in names):
            reason = f"an input of this command, {str(given)!r}, would be lost"
            raise _refuse(Path(out), reason, "name another place")


def map_file(path: Path) -> Bytes:
    """A file's bytes, (n,) uint8, mapped: what nobody looks at is not read.

    Raises InputError, without the file's name, if it is missing, empty, unreadable, or no
    ordinary file.
    """
    with open_file(path) as file:
        if os.fstat(file.fileno()).st_size == 0:
            raise InputError("the file is empty", fix="give a complete file")
        with _reading():
            return np.memmap(file, np.uint8, mode="r")


def open_file(path: Path) -> BinaryIO:
    """An ordinary file, open for reading. A pipe, a device or a socket is not waited for.

    Raises InputError, without the file's name, if it is missing, unreadable, or no such file.
    """
    # Opened first and looked at then, so that nobody can exchange it between the two; without
    # O_NONBLOCK a pipe that nobody writes to would never open.
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)
    with _reading():
        number = os.open(path, flags | getattr(os, "O_BINARY", 0))
    mode = os.fstat(number).st_mode
    if stat.S_ISREG(mode):
        return os.fdopen(number, "rb")
    os.close(number)
    if stat.S_ISDIR(mode):
        raise InputError("this is a folder, not a file", fix="give the file itself")
    raise InputError("this is a pipe, a device or a socket", fix="give an ordinary file")


def read_toml(file: Path, most: int, what: str) -> tuple[bytes, dict[str, Any]]:
    """The bytes of a TOML file, `most` of them at most, and what they say. `what` it is, is for
    the message: "a policy".

    Raises InputError, without the file's name.
    """
    with open_file(file) as opened:
        data = opened.read(most + 1)
    if len(data) > most:
        raise InputError(f"{what} of more than {most} bytes", fix="check the file")
    try:
        return data, tomllib.loads(data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise InputError("this is not UTF-8 text", fix="check that it is the right file") from error
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        raise InputError(f"not valid TOML: {error}", fix="mend the syntax there") from error


def named_beside(file: Path, named: str) -> Path:
    """The file that `file` names: relative to its folder, and by `..` outside it too, where
    exporters put textures. Nothing of such a file is ever shown.

    Raises InputError for an absolute name: it means something on one machine alone.
    """
    if PurePosixPath(named).is_absolute() or PureWindowsPath(named).anchor:
        raise InputError("its name is absolute", fix="name it relative to this file")
    return file.parent / named


@contextmanager
def _reading() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(
            f"cannot read the file: {error.strerror or error}", fix="check its name and permissions"
        ) from error
    except ValueError as error:
        # A zero in the name, or half of a character ("\ud800" in JSON).
        raise InputError("no file can have this name", fix="name a file that there is") from error


def json_bytes(data: Bytes) -> int:
    """How much memory a JSON text, (n,) uint8, takes as Python's objects, at most.

    The text twice (bytes and characters); for each bracket an empty list or dictionary, 64 bytes;
    for each comma and colon a value, at most 56 for a string's head, and 8 for its place. A
    dictionary's table takes 60 more for each of its entries.
    """
    marks = b"[{,:"
    count = [0] * len(marks)
    for at in range(0, len(data), _BLOCK):
        block = data[at : at + _BLOCK]
        for place, mark in enumerate(marks):
            count[place] += int(np.count_nonzero(block == mark))
    lists, dictionaries, commas, colons = count
    return 2 * len(data) + 64 * (lists + dictionaries + commas) + 124 * colons


def parse_json(data: bytes) -> Any:
    """Parsed JSON. Raises InputError with line and column.

    NaN and infinities pass, as Python's parser lets them: whoever reads the number knows its
    place and refuses it there.
    """
    fix = "mend the syntax there, or write the file anew"
    try:
        return json.loads(data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise InputError("this is not UTF-8 text", fix="check that it is the right file") from error
    except json.JSONDecodeError as error:
        place = f"line {error.lineno} column {error.colno}"
        raise InputError(f"not valid JSON: {error.msg}", place=place, fix=fix) from error
    except (RecursionError, ValueError) as error:
        problem = "not valid JSON: lists too deep, or a number too long"
        raise InputError(problem, fix=fix) from error
