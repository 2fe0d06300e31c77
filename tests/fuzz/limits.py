"""What a case may cost and touch: time, memory, and the one folder that it may write into.

`watched` runs a reader on a case and says what was wrong with it. Python's audit events tell of
files, processes and sockets; what a library opens by itself is seen only where it changes the
case's folder.
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from visref.errors import InputError, NothingToJudge

MiB = 2**20
# What a reader is told that it may take, in bytes.
MEMORY = 512 * MiB


@dataclass(frozen=True)
class Limits:
    """Of one case. `seconds` of processor time, and `wall` ones, of which a machine with other
    work needs more; `memory`, bytes that it may add at its peak; `ceiling`, bytes at which the
    system refuses more, so that the machine survives the case."""

    seconds: float = 10.0
    wall: float = 60.0
    memory: int = 1024 * MiB
    ceiling: int = 3072 * MiB


LIMITS = Limits()
PATIENT = Limits(seconds=900.0, wall=1800.0, memory=2**40, ceiling=2**40)


@dataclass(frozen=True)
class Fault:
    """What was wrong with a case. `kind` is the same for the same fault in other cases."""

    kind: str
    detail: str


class TooLong(BaseException):
    """Not an Exception, so that no reader catches it."""


class WrongAnswer(AssertionError):
    """What a reader or a command did and must not do: the fault's kind, and a detail."""


class Folders:
    """Where a case lives: `inside` is its own, it may write into `out` and `temporary`, and
    `secret` must be neither read nor written."""

    SECRET = "what stands outside is nobody's business"

    def __init__(self, root: Path) -> None:
        self.root = root = root.resolve()
        self.inside, self.out, self.temporary = root / "in", root / "out", root / "tmp"
        self.secret = root / "outside" / "secret.txt"
        for folder in (self.inside, self.out, self.temporary, self.secret.parent):
            folder.mkdir(parents=True, exist_ok=True)
        self.secret.write_text(self.SECRET)

    def empty(self) -> None:
        """Make them ready for the next case."""
        for folder in (self.inside, self.out, self.temporary):
            for entry in os.scandir(folder):
                if entry.is_dir(follow_symlinks=False):
                    shutil.rmtree(entry.path)
                else:
                    os.unlink(entry.path)


# Audit events that change files: where in their arguments a path stands, and the descriptor of the
# folder that it starts from.
_CHANGES: dict[str, tuple[tuple[int, int | None], ...]] = {
    "os.mkdir": ((0, 2),), "os.rmdir": ((0, 1),), "os.remove": ((0, 1),),
    "os.rename": ((0, 2), (1, 3)), "os.link": ((1, 3),), "os.symlink": ((1, 2),),
    "os.chmod": ((0, 2),), "os.chown": ((0, 3),), "os.truncate": ((0, None),),
    "os.utime": ((0, 3),), "shutil.rmtree": ((0, 1),),
}  # fmt: skip
_NEVER = ("os.system", "os.exec", "socket.connect", "socket.bind", "socket.getaddrinfo",
          "webbrowser.open")  # fmt: skip
# A reader's own child, and what Python asks for the machine's name and where OpenGL lies.
_HELPERS = (sys.executable, "uname", "/sbin/ldconfig", "/usr/bin/gcc", "ld")
_PROCESSES = ("subprocess.Popen", "os.posix_spawn")
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


class _Watch:
    """Hears every audit event, as long as it is on."""

    def __init__(self) -> None:
        self.folders: Folders | None = None
        self.allowed: tuple[Path, ...] = ()
        self.seen: list[tuple[str, str]] = []
        self.reads_outside = False
        self._installed = self._busy = False

    def start(self, folders: Folders, allowed: tuple[Path, ...], reads_outside: bool) -> None:
        if not self._installed:
            sys.addaudithook(self._hear)
            self._installed = True
        self.seen, self.allowed, self.reads_outside = [], allowed, reads_outside
        self.folders = folders

    def stop(self) -> None:
        self.folders = None

    def _hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.folders is None or self._busy:
            return
        self._busy = True
        try:
            wrong = self._wrong(event, arguments)
        finally:
            self._busy = False
        if wrong:
            self.seen.append((wrong, repr(arguments)))
            raise PermissionError(f"the fuzz forbids it: {wrong}")

    def _wrong(self, event: str, arguments: tuple[Any, ...]) -> str:
        if event == "open":
            path, _, flags = arguments
            if isinstance(path, int):
                return ""
            if flags & _WRITING:
                return self._outside(event, path)
            return "" if self.reads_outside or not self._is_secret(path) else "reads outside"
        if event in _CHANGES:
            found = (
                self._outside(event, arguments[at], None if base is None else arguments[base])
                for at, base in _CHANGES[event]
            )
            return next(filter(None, found), "")
        if event in _PROCESSES and os.fspath(arguments[0]) not in _HELPERS:
            return f"starts {arguments[0]!r}"
        return event if event in _NEVER else ""

    def _outside(self, event: str, path: Any, base: int | None = None) -> str:
        if isinstance(path, int) or os.fsdecode(path) == os.devnull:
            return ""
        start = "" if base in (None, -1) else os.readlink(f"/proc/self/fd/{base}")
        # A folder's own link is followed, the last part is what changes.
        name = Path(start, os.fsdecode(path)).absolute()
        real = name.parent.resolve() / name.name if event != "open" else name.resolve()
        allowed = (*self.allowed, *_caches())
        if "__pycache__" in real.parts or any(real.is_relative_to(own) for own in allowed):
            return ""
        return f"writes outside ({event})"

    def _is_secret(self, path: Any) -> bool:
        assert self.folders is not None
        name = os.fsdecode(path)
        # Elsewhere on the machine nothing leads there, and looking takes time.
        if name.startswith("/") and not name.startswith(str(self.folders.root)):
            return False
        try:
            return Path(name).resolve() == self.folders.secret
        except (OSError, ValueError, RuntimeError):
            return False


@cache
def _caches() -> tuple[Path, ...]:
    """Where compiled kernels are kept."""
    users = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "visref"
    told = os.environ.get("NUMBA_CACHE_DIR")
    return tuple(folder.resolve() for folder in (users, *([Path(told)] if told else [])))


_WATCH = _Watch()


@contextmanager
def _alarms(limits: Limits) -> Iterator[None]:
    def ring(number: int, frame: Any) -> None:
        raise TooLong

    before = [(number, signal.signal(number, ring)) for number in (signal.SIGALRM, signal.SIGPROF)]
    # Again and again: an exception that is raised within a callback may be lost.
    signal.setitimer(signal.ITIMER_REAL, limits.wall, 1.0)
    signal.setitimer(signal.ITIMER_PROF, limits.seconds, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        for number, handler in before:
            signal.signal(number, handler)


def _status(field: str) -> int:
    """A number of bytes that Linux tells of this process; 0 elsewhere."""
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith(field + ":"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    return 0


@contextmanager
def _ceiling(more: int) -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_DATA)
    now = _status("VmData")
    resource.setrlimit(resource.RLIMIT_DATA, (now + more if now else before[0], before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


def _reset_peak() -> None:
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _children_peak() -> int:
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024


def _listing(folder: Path) -> dict[str, tuple[int, int]]:
    found = {}
    for base, folders, files in os.walk(folder):
        for name in (*folders, *files):
            stat = os.lstat(os.path.join(base, name))
            size = 0 if name in folders else stat.st_size
            found[os.path.join(base, name)] = (size, 0 if name in folders else stat.st_mtime_ns)
    return found


def watched(
    read: Callable[[], Any],
    folders: Folders,
    limits: Limits = LIMITS,
    *,
    also: tuple[Path, ...] = (),
    reads_outside: bool = False,
) -> tuple[Any, Fault | None]:
    """What `read` gives (None where it refuses the case), and its fault.

    A reader gives a value or raises InputError or NothingToJudge with a text of one line; it warns
    of nothing, stays within `limits`, and writes into `folders.out`, `folders.temporary` and
    `also` alone. Outside it reads nothing either, but with `reads_outside`.
    """
    allowed = (folders.out, folders.temporary, *also)
    kept = {str(folder) for folder in also}
    listed = _listing(folders.inside)
    temporary, tempfile.tempdir = tempfile.tempdir, str(folders.temporary)
    here = os.getcwd()
    os.chdir(folders.inside)
    _reset_peak()
    resident, of_children = _status("VmRSS"), _children_peak()
    value, fault = None, None
    try:
        with warnings.catch_warnings(), _ceiling(limits.ceiling), _alarms(limits):
            warnings.simplefilter("error")
            # What a library forgets to close is nobody's wrong answer.
            warnings.simplefilter("ignore", ResourceWarning)
            _WATCH.start(folders, allowed, reads_outside)
            value = read()
    except (InputError, NothingToJudge) as error:
        fault = _of_refusal(error)
    except TooLong:
        fault = Fault("too long", f"more than {limits.seconds} s of work or {limits.wall} s")
    except MemoryError as error:
        fault = Fault(f"too much memory, {_frame(error)}", "MemoryError")
    except WrongAnswer as error:
        fault = Fault(error.args[0], str(error.args[-1]))
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        text = "".join(traceback.format_exception(error))
        fault = Fault(f"{type(error).__name__} in {_frame(error)}", text)
    finally:
        _WATCH.stop()
        os.chdir(here)
        tempfile.tempdir = temporary
    peak = max(_status("VmHWM") - resident, 0)
    of_children = _children_peak() - of_children
    if _WATCH.seen:
        fault = Fault(_WATCH.seen[0][0], "\n".join(f"{kind} {what}" for kind, what in _WATCH.seen))
    elif max(peak, of_children if of_children > limits.memory else 0) > limits.memory:
        fault = Fault("too much memory", f"{max(peak, of_children) // MiB} MiB more at its peak")
    elif fault is None:
        now = _listing(folders.inside)
        changed = [
            name
            for name in now.keys() ^ listed.keys() | {n for n in now if now[n] != listed.get(n)}
            if not any(name == own or name.startswith(own + os.sep) for own in kept)
        ]
        if changed or folders.secret.read_text() != Folders.SECRET:
            fault = Fault("changes its input", ", ".join(sorted(changed)[:5]))
    return value, fault


def _of_refusal(error: Exception) -> Fault | None:
    text = str(error)
    if len(text.splitlines()) != 1 or not text.strip():
        return Fault(f"refusal is not one line, {_frame(error)}", text)
    # Errors may name each other in a ring.
    chain: list[BaseException] = [error]
    while (cause := chain[-1].__cause__ or chain[-1].__context__) and cause not in chain:
        chain.append(cause)
    for cause in chain:
        if isinstance(cause, MemoryError):
            return Fault(f"too much memory, {_frame(cause)}", text)
    return None


def _frame(error: BaseException) -> str:
    """The innermost frame that is visref's own, or the innermost one."""
    found = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in found if f"{os.sep}visref{os.sep}" in frame.filename]
    frame = (own or list(found))[-1]
    return f"{Path(frame.filename).stem}.{frame.name}"
