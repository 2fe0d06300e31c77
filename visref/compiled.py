"""How every kernel is compiled: numba's `njit`, with a cache that is never stale and never in the
way.

numba keeps compiled functions beside their source or in the user's cache folder. It raises while
a module is imported where it may write to neither; it does not see an edit in a file that a kernel
takes a function or a constant from; and it reads old files by names that the source has no longer.
Here the folder's name is a digest of the kernel's file and of all files of this project that it
imports, at whatever distance: what was compiled from other source is in another folder. A cache
that cannot be read or written costs a compilation, and nothing else.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from types import FrameType
from typing import Any

import numba
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    InTreeCacheLocator,
)

# Folders that stay of a module when one is added: those of other checkouts, and of the last edits.
_KEPT = 8
_FROM = re.compile(rb"from (visref[\w.]*) import (\([^)]*\)|[^\n]*)")
_IMPORT = re.compile(rb"import (visref[\w.]*)")
# Modules are in lower case here.
_NAME = re.compile(rb"\b[a-z_]\w*")


# Where the kernels of each module that was imported are kept.
_in_use: dict[str, Path] = {}


def njit(*, makes_arrays: bool = True, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """numba's decorator of the same name and options; the function releases the interpreter's
    lock and is cached where it can be.

    A function that makes no arrays need not count who holds those that it is given, which numba
    does by atomic instructions wherever an inlined function takes one: up to four fifths of a loop.
    """
    if not makes_arrays:
        options["_nrt"] = False

    def decorate(function: Callable[..., Any]) -> Any:
        # Nobody calls a kernel from C: without numba's wrapper for that it compiles sooner.
        compiled = numba.njit(nogil=True, no_cfunc_wrapper=True, **options)(function)
        # With NUMBA_DISABLE_JIT the function comes back as it is.
        if compiled is not function:
            folder = cache_folder(function.__module__, Path(function.__code__.co_filename))
            if folder is not None:
                compiled._cache = _Cache(function, folder)
                _in_use[function.__module__] = folder
        return compiled

    return decorate


def folders_in_use() -> dict[str, Path]:
    """Where the kernels are kept of each module with kernels that this process has imported."""
    return dict(_in_use)


def source_of(module: str) -> Path | None:
    """The file of a module of this project, if there is one; its package was imported."""
    file = _file_of(module)
    return None if file is None else Path(file)


@cache
def cache_folder(module: str, file: Path) -> Path | None:
    """Where the kernels of a module are kept; None if there is no such place.

    It lies under NUMBA_CACHE_DIR where that is set, else under the user's cache folder or, where
    that cannot be written, the package's own. A folder that is full already may be read-only.
    """
    try:
        name = f"{module}-{_digest(module, file)}"
    except OSError:
        return None
    for base in _bases():
        folder = base / name
        with suppress(OSError):
            new = not folder.exists()
            folder.mkdir(parents=True, exist_ok=True)
            if new:
                _forget_old(base, module)
            elif os.access(folder, os.W_OK):
                os.utime(folder)
            if os.access(folder, os.W_OK) or any(folder.iterdir()):
                return folder
    return None


def _bases() -> Iterator[Path]:
    """The folders that may hold the cache, the best first."""
    told = numba.config.CACHE_DIR
    if told:
        yield Path(told) / "visref"
        return
    if sys.platform == "win32":
        users = os.environ.get("LOCALAPPDATA", "")
    elif sys.platform == "darwin":
        users = os.path.expanduser("~/Library/Caches")
    else:
        users = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    # `~` stays where nobody knows the user's home.
    if os.path.isabs(users):
        yield Path(users) / "visref" / "kernels"
    yield Path(__file__).parent / "__pycache__" / "kernels"


def _digest(module: str, file: Path) -> str:
    """A digest of all source that a kernel of this module can be made of, and of the compiler."""
    digest = hashlib.blake2b(digest_size=16)
    digest.update(f"{numba.__version__} {platform.python_version()}".encode())
    found = {module: str(file)}
    waiting = [module]
    while waiting:
        _, imported = _source(found[waiting.pop()])
        waiting += [name for name in imported if name not in found]
        found |= imported
    for name in sorted(found):
        digest.update(f"\0{name}\0".encode() + _source(found[name])[0])
    return digest.hexdigest()


@cache
def _source(file: str) -> tuple[bytes, dict[str, str]]:
    """A file's digest, and the modules of this project that it imports, with their files."""
    text = Path(file).read_bytes()
    names = set(_IMPORT.findall(text))
    for origin, taken in _FROM.findall(text):
        names.add(origin)
        names.update(origin + b"." + part for part in _NAME.findall(taken))
    files = {name: _file_of(name) for name in sorted(map(bytes.decode, names))}
    digest = hashlib.blake2b(text, digest_size=16).digest()
    return digest, {name: found for name, found in files.items() if found is not None}


@cache
def _file_of(module: str) -> str | None:
    """The source of a module of this project, if a module of this name is there."""
    top, *rest = module.split(".")
    package = getattr(sys.modules.get(top), "__file__", None)
    if package is None:
        return None
    folder = os.path.join(os.path.dirname(package), *rest[:-1])
    if not rest:
        return str(package)
    if f"{rest[-1]}.py" in _entries(folder):
        return os.path.join(folder, f"{rest[-1]}.py")
    inside = os.path.join(folder, rest[-1])
    if rest[-1] in _entries(folder) and "__init__.py" in _entries(inside):
        return os.path.join(inside, "__init__.py")
    return None


@cache
def _entries(folder: str) -> frozenset[str]:
    try:
        return frozenset(os.listdir(folder))
    except OSError:
        return frozenset()


def _forget_old(base: Path, module: str) -> None:
    """Remove all but the last used folders of a module. Who still reads one compiles again."""
    # A digest holds no `-`, and a module's name neither.
    folders = sorted(base.glob(f"{module}-*"), key=lambda folder: -folder.stat().st_mtime_ns)
    for folder in folders[_KEPT:]:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """An interrupt that comes in it takes effect at its end: one that is raised while llvmlite
    calls back into Python ends the process by SIGSEGV."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    came: list[FrameType | None] = []
    signal.signal(signal.SIGINT, lambda _, frame: came.append(frame))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if came:
            before(signal.SIGINT, came[-1])


class _Locator(InTreeCacheLocator):  # type: ignore[misc]
    """Says to numba which folder it is."""

    def __init__(self, function: Any, folder: Path) -> None:
        super().__init__(function, function.__code__.co_filename)
        self._cache_path = str(folder)

    def get_source_stamp(self) -> str:
        # The folder's name says it.
        return ""


class _Implementation(CompileResultCacheImpl):  # type: ignore[misc]
    """numba's own, but for the search of a folder, which ends in an exception."""

    def __init__(self, function: Any, folder: Path) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._locator = _Locator(function, folder)
        self._filename_base = self.get_filename_base(
            function.__qualname__, getattr(sys, "abiflags", "")
        )


class _File(IndexDataCacheFile):  # type: ignore[misc]
    """Names the file of a signature by the signature: numba counts, and of two processes that add
    one at a time each takes the same number for another signature."""

    def save(self, key: Any, data: Any) -> None:
        number = int.from_bytes(hashlib.blake2b(repr(key).encode(), digest_size=8).digest())
        name = self._data_name(number)
        self._save_data(name, data)
        try:
            overloads = self._load_index()
        except OSError:
            raise
        except Exception:
            # It was cut short or spoilt, and is begun anew.
            overloads = {}
        overloads[key] = name
        self._save_index(overloads)


class _Cache(FunctionCache):  # type: ignore[misc]
    """A cache in a given folder, whose failures are a cache that is empty."""

    def __init__(self, function: Any, folder: Path) -> None:
        self._impl_class = partial(_Implementation, folder=folder)
        super().__init__(function)
        self._cache_file = _File(
            cache_path=str(folder), filename_base=self._impl.filename_base, source_stamp=""
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        # Files that were cut short or spoilt raise whatever pickle raises.
        with interrupts_held():
            try:
                return super().load_overload(sig, target_context)
            except Exception:
                return None

    def save_overload(self, sig: Any, data: Any) -> None:
        # A full disk, a folder that is read-only or was removed.
        with suppress(OSError):
            super().save_overload(sig, data)
