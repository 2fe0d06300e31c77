"""Writing beside the place that a thing is for, and the ways from there into it.

A folder `.visref-unfinished-…` next to the target holds what is being written. Its file `lock` says
that it is ours and whose target it is for, and is locked (flock) for as long as the process that
made it lives: what a killed one left is known by its free lock, and the next run cleans it up.

    lock        JSON, locked
    written     what is being written
    replaced    what was moved away from the target, where two names cannot be exchanged at once
    moving      what is on its way into a target that can be neither renamed nor removed
    parts       what was finished on the way, of a folder that lasts: who writes to the same target
                the next time goes on with it
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import json
import os
import re
import secrets
import shutil
import stat
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

if sys.platform != "win32":
    import fcntl

PREFIX = ".visref-unfinished-"
WRITTEN = "written"
PARTS = "parts"
_REPLACED, _MOVING, _LOCK = "replaced", "moving", "lock"
_NAME = re.compile(re.escape(PREFIX) + "[0-9a-f]{16}")
_MARK = '{"visref": "unfinished", '
# Names have 255 bytes at most, and JSON makes six of one.
_MARK_BYTES = 1 << 14
# No link is followed, and no pipe waited for.
_NO_SURPRISE = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)

# Another run is between two renames of one folder; it needs milliseconds.
_WAIT_S = 30.0
# The workers of a run that was killed hold its lock until the system has ended them too.
_LASTING_WAIT_S = 1.0
# Of runs that take turns at one target, each try that fails is another run's success.
_TRIES = 1000
_OCCUPIED = (errno.ENOTEMPTY, errno.EEXIST)
_RENAME_EXCHANGE, _AT_FDCWD = 2, -100
# What file systems say that cannot exchange two names.
_NO_EXCHANGE = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)

Check = Callable[[Path], None]
T = TypeVar("T")


@contextmanager
def beside(folder: Path, *, name: str, marker: str = "") -> Iterator[Path]:
    """A new folder of ours in `folder`, gone when the block ends; whatever it still holds of the
    target then goes back.

    `name`: the target's, in `folder`; empty where `folder` itself is the target (`move_into`), and
    then `marker` is the file that makes it whole. Raises OSError.
    """
    path, lock = _made(folder, json.dumps({"name": name, "marker": marker}))
    try:
        yield path
    finally:
        # What cannot go back stays here, for the next run.
        with suppress(OSError):
            _settle(path, name, marker)
        os.close(lock)


@contextmanager
def lasting(folder: Path, *, name: str) -> Iterator[Path | None]:
    """A folder of ours in `folder` for the target `name`, the same each time, with `PARTS` in it;
    None while another process has it. When the block ends it stays if there is anything in those.
    Raises OSError."""
    path = folder / f"{PREFIX}{hashlib.sha256(os.fsencode(name)).hexdigest()[:16]}"
    lock = _entered(path, name)
    if lock is None:
        yield None
        return
    try:
        (path / PARTS).mkdir(exist_ok=True)
        yield path
    finally:
        with suppress(OSError):
            if not _lasts(path):
                _removed(path)
        os.close(lock)


def _entered(path: Path, name: str) -> int | None:
    """The lock of a folder that lasts, held; None where another process holds it, or there are no
    locks."""
    if sys.platform == "win32":
        return None
    until = time.monotonic() + _LASTING_WAIT_S
    for _ in range(_TRIES):
        with suppress(FileExistsError):
            path.mkdir(mode=0o700)
        flags = os.O_RDWR | os.O_CREAT | _NO_SURPRISE
        try:
            if path.is_symlink() or path.stat().st_uid != os.geteuid():
                # Where others may write too, the name is no secret.
                raise PermissionError(errno.EPERM, os.strerror(errno.EPERM), str(path))
            lock = os.open(path / _LOCK, flags, 0o600)
        except FileNotFoundError:
            # Removed meanwhile.
            continue
        try:
            if _locked(lock) is True and os.path.samestat(os.fstat(lock), os.stat(path / _LOCK)):
                facts = _facts(os.read(lock, _MARK_BYTES))
                if facts is None:
                    raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
                if not facts:
                    os.ftruncate(lock, 0)
                    mark = json.dumps({"name": name, "marker": "", "lasts": True})
                    os.pwrite(lock, (_MARK + mark[1:]).encode(), 0)
                return lock
        except FileNotFoundError:
            pass
        except BaseException:
            os.close(lock)
            raise
        os.close(lock)
        if time.monotonic() > until:
            return None
        time.sleep(0.01)
    return None


def _lasts(path: Path) -> bool:
    """Whether anything was finished in a folder that lasts."""
    try:
        return bool(os.listdir(path / PARTS))
    except FileNotFoundError:
        return False


def _made(folder: Path, facts: str) -> tuple[Path, int]:
    """A new folder and its lock, held."""
    for _ in range(_TRIES):
        path = folder / f"{PREFIX}{secrets.token_hex(8)}"
        path.mkdir(mode=0o700)
        # Until it holds the lock, another run may take the folder for what a killed one left.
        with suppress(FileNotFoundError):
            lock = os.open(path / _LOCK, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
            try:
                if _locked(lock) is not False and os.path.samestat(
                    os.fstat(lock), os.stat(path / _LOCK)
                ):
                    os.write(lock, (_MARK + facts[1:]).encode())
                    (path / WRITTEN).mkdir()
                    return path, lock
            except BaseException:
                os.close(lock)
                _removed(path)
                raise
            os.close(lock)
    raise OSError(errno.EBUSY, os.strerror(errno.EBUSY), str(folder))


def _locked(file: int) -> bool | None:
    """Whether the lock is ours now; None where the file system or the system has no locks."""
    if sys.platform == "win32":
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def is_unfinished(path: Path) -> bool:
    """Whether this is a folder of ours, of a run that writes or of one that was killed."""
    while _NAME.fullmatch(path.name) and not path.is_symlink():
        try:
            mark = _open_lock(path)
        except OSError:
            try:
                inside = os.listdir(path)
            except FileNotFoundError:
                # Gone meanwhile.
                return True
            except OSError:
                return False
            if inside == [_LOCK] and (path / _LOCK).is_file():
                # Made meanwhile.
                continue
            return not inside
        try:
            return _facts(os.read(mark, _MARK_BYTES)) is not None
        finally:
            os.close(mark)
    return False


def _open_lock(path: Path) -> int:
    """Opened, if it is a file. Raises OSError."""
    lock = os.open(path / _LOCK, os.O_RDWR | _NO_SURPRISE)
    if stat.S_ISREG(os.fstat(lock).st_mode):
        return lock
    os.close(lock)
    raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path / _LOCK))


def _facts(mark: bytes) -> dict[str, Any] | None:
    """What a lock says; empty where its writer was killed at it, None where it is not ours."""
    if _MARK.encode().startswith(mark):
        return {}
    if not mark.startswith(_MARK.encode()):
        return None
    try:
        found: dict[str, Any] = json.loads(mark)
    except ValueError:
        return {}
    return found


def sweep(folder: Path) -> None:
    """Put back what killed runs moved away in `folder`, and remove what they left.

    Left alone is what belongs to a run that lives, and what merely has such a name.
    """
    with suppress(OSError):
        for name in os.listdir(folder):
            path = folder / name
            if _NAME.fullmatch(name) and path.is_dir() and not path.is_symlink():
                with suppress(OSError):
                    _sweep_one(path)


def _sweep_one(path: Path) -> None:
    try:
        lock = _open_lock(path)
    except FileNotFoundError:
        # Killed before there was a lock, or after it was removed: empty, or it is not ours.
        path.rmdir()
        return
    try:
        if _locked(lock) is not True:
            return
        facts = _facts(os.read(lock, _MARK_BYTES))
        if facts is None:
            return
        if facts and facts.get("lasts"):
            if not _lasts(path):
                _removed(path)
        elif facts:
            _settle(path, str(facts["name"]), str(facts["marker"]))
        elif os.listdir(path) == [_LOCK]:
            _removed(path)
    finally:
        os.close(lock)


def _settle(path: Path, name: str, marker: str) -> None:
    """Bring the target to rest, and remove `path`. Raises OSError, and then all is still there."""
    if name:
        if (path / _REPLACED).is_dir():
            try:
                os.rename(path / _REPLACED, path.parent / os.path.basename(name))
            except OSError as error:
                # Occupied: a new one stands there.
                if error.errno not in _OCCUPIED:
                    raise
    elif (path / _MOVING).is_dir():
        with alone_in(path.parent):
            _move_all(path / _MOVING, path.parent, last=marker)
    elif (path / _REPLACED).is_dir():
        with alone_in(path.parent):
            _move_all(path / _REPLACED, path.parent, last=marker)
    _removed(path)


def _removed(path: Path) -> None:
    """Remove a folder of ours, its lock last."""
    for name in os.listdir(path):
        if name != _LOCK:
            if (path / name).is_dir() and not (path / name).is_symlink():
                shutil.rmtree(path / name)
            else:
                (path / name).unlink()
    with suppress(FileNotFoundError):
        (path / _LOCK).unlink()
    path.rmdir()


def exchange(one: Path, other: Path) -> bool:
    """Exchange two names at once; False where that cannot be done. Raises OSError."""
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, TypeError):
        return False
    first, second = os.fsencode(one), os.fsencode(other)
    if rename(_AT_FDCWD, first, _AT_FDCWD, second, _RENAME_EXCHANGE) == 0:
        return True
    number = ctypes.get_errno()
    if number in _NO_EXCHANGE:
        return False
    raise OSError(number, os.strerror(number), str(other))


def put(path: Path, target: Path, check: Check) -> None:
    """What was written into `path`, which `beside` gave, becomes the folder `target`.

    Other runs may do the same at the same time: each folder is whole, and the last one stays.
    `check` is given the folder that is replaced, and raises where it must not be. Raises OSError.
    """
    written, replaced = path / WRITTEN, path / _REPLACED
    for _ in range(_TRIES):
        # To where nothing stands, or an empty folder.
        if _renamed(written, target):
            return
        steady(target, check)
        try:
            if exchange(written, target):
                try:
                    # Somebody may have been at it since.
                    check(written)
                except BaseException:
                    exchange(written, target)
                    raise
                return
            if replaced.is_dir():
                shutil.rmtree(replaced)
            os.rename(target, replaced)
        except FileNotFoundError:
            # Another run has just moved it away.
            continue
        check(replaced)
        if _renamed(written, target):
            return
    raise OSError(errno.EBUSY, os.strerror(errno.EBUSY), str(target))


def steady(folder: Path, look: Callable[[Path], T]) -> T:
    """What `look` finds in one folder, though other runs may put others in its place meanwhile."""
    for _ in range(_TRIES):
        before = _state(folder)
        try:
            found = look(folder)
        except Exception:
            if _state(folder) == before:
                raise
        else:
            if _state(folder) == before:
                return found
    return look(folder)


def _state(folder: Path) -> tuple[int, ...] | None:
    """What changes when another folder takes its name; None where there is none."""
    try:
        found = folder.stat()
    except FileNotFoundError:
        return None
    return found.st_dev, found.st_ino, found.st_ctime_ns


def _renamed(source: Path, target: Path) -> bool:
    try:
        os.rename(source, target)
    except OSError as error:
        if error.errno not in _OCCUPIED:
            raise
        return False
    return True


def move_into(path: Path, check: Check, *, marker: str) -> None:
    """What was written into `path`, which stands in its target, moves into that folder; what stood
    there moves out of it. While the marker is missing, the folder is not whole. Raises OSError."""
    target = path.parent
    with alone_in(target):
        check(target)
        (path / _REPLACED).mkdir()
        _move_all(target, path / _REPLACED, first=marker)
        os.rename(path / WRITTEN, path / _MOVING)
        _move_all(path / _MOVING, target, last=marker)


def _move_all(source: Path, target: Path, *, first: str = "", last: str = "") -> None:
    names = [name for name in os.listdir(source) if not _NAME.fullmatch(name)]
    for name in sorted(names, key=lambda name: (name == last, name != first, name)):
        os.rename(source / name, target / name)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """No other run moves anything in `folder` meanwhile. Raises OSError if one does not end."""
    opened = os.open(folder, os.O_RDONLY)
    try:
        until = time.monotonic() + _WAIT_S
        while _locked(opened) is False:
            if time.monotonic() > until:
                raise OSError(errno.EBUSY, "another run writes here", str(folder))
            time.sleep(0.01)
        yield
    finally:
        os.close(opened)


def on_disk(path: Path) -> None:
    """Wait until a file, or a folder with all that is in it, is on disk. Raises OSError."""
    if path.is_dir():
        for name in os.listdir(path):
            on_disk(path / name)
        names_on_disk(path)
        return
    opened = os.open(path, os.O_RDWR)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


def names_on_disk(folder: Path) -> None:
    """Wait until a folder's names are on disk. Raises OSError."""
    if sys.platform == "win32":
        return
    opened = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(opened)
    except OSError as error:
        # Some file systems have no such thing for folders.
        if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):
            raise
    finally:
        os.close(opened)
