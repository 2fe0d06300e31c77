"""Files in and out. Reading: bytes and JSON, with an InputError for whatever is wrong with them.
Writing without halves: everything is written beside its place, then renamed into it.
"""

from __future__ import annotations

import json
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError

Bytes = NDArray[np.uint8]

# Not the target's own name, which may be as long as names get.
_PREFIX = ".visref-unfinished-"
_BLOCK = 1 << 24


def _refuse(path: Path, reason: str, fix: str) -> InputError:
    return InputError(f"cannot write here: {reason}", source=str(path), fix=fix)


@contextmanager
def _refusing(target: Path) -> Iterator[None]:
    """What the system refuses at `target` is said in one line."""
    try:
        yield
    except OSError as error:
        raise _refuse(target, error.strerror or "no access", "name another place") from error


@contextmanager
def replacing_file(path: Path | str) -> Iterator[Path]:
    """Yields a path beside `path`; renames it there when the block ends well.

    What stands there already is replaced only if it is a file: never a folder, a device or a
    pipe.
    """
    target = Path(path)
    with _refusing(target):
        if target.is_dir():
            raise _refuse(target, "it is a folder", "name a file")
        if target.exists() and not target.is_file():
            raise _refuse(target, "it is no ordinary file", "name a file")
        # A link stays, and what it names is replaced.
        target = target.resolve()
        target.parent.mkdir(parents=True, exist_ok=True)
        beside = Path(tempfile.mkdtemp(dir=target.parent, prefix=_PREFIX))
    try:
        written = beside / target.name
        yield written
        with _refusing(target):
            written.replace(target)
    finally:
        shutil.rmtree(beside, ignore_errors=True)


@contextmanager
def replacing_folder(path: Path | str, *, marker: str) -> Iterator[Path]:
    """Yields a new folder beside `path`; renames it there when the block ends well.

    An existing folder is replaced only if it is empty or holds `marker`, a file that says
    that it is one of ours; it is gone only once the new one stands in its place.
    """
    target = Path(path)
    with _refusing(target):
        # A link stays, and what it names is replaced; "." gets a name.
        target = target.resolve()
        if target.exists() and not target.is_dir():
            raise _refuse(target, "it is no folder", "name a folder")
        if target.is_dir() and any(target.iterdir()) and not (target / marker).is_file():
            raise _refuse(
                target, f"the folder is not empty and has no {marker}", "name a new folder"
            )
        target.parent.mkdir(parents=True, exist_ok=True)
        beside = Path(tempfile.mkdtemp(dir=target.parent, prefix=_PREFIX))
    try:
        written, replaced = beside / "written", beside / "replaced"
        written.mkdir()
        yield written
        with _refusing(target):
            if target.is_dir():
                target.rename(replaced)
            try:
                written.rename(target)
            except OSError:
                if replaced.is_dir():
                    replaced.rename(target)
                raise
    finally:
        shutil.rmtree(beside, ignore_errors=True)


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


def beside(file: Path, named: str) -> Path:
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
    count = np.zeros(256, np.int64)
    for at in range(0, len(data), _BLOCK):  # bincount makes int64 of what it counts
        count += np.bincount(data[at : at + _BLOCK], minlength=256)
    opened = int(count[ord("[")] + count[ord("{")])
    return 2 * len(data) + 64 * (opened + int(count[ord(",")])) + 124 * int(count[ord(":")])


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
