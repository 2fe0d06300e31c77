"""Writing without halves: everything is written beside its place, then renamed into it."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from visref.errors import InputError


def _refuse(path: Path, reason: str, mend: str) -> InputError:
    return InputError(f"cannot write here: {reason}", source=str(path), mend=mend)


@contextmanager
def replacing_file(path: Path | str) -> Iterator[Path]:
    """Yields a path beside `path`; renames it there when the block ends well."""
    target = Path(path)
    if target.is_dir():
        raise _refuse(target, "it is a folder", "name a file")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=f".{target.name}.") as beside:
            written = Path(beside) / target.name
            yield written
            written.replace(target)
    except (PermissionError, FileExistsError, NotADirectoryError, FileNotFoundError) as error:
        raise _refuse(target, error.strerror or "no access", "name another place") from error


@contextmanager
def replacing_folder(path: Path | str, *, marker: str) -> Iterator[Path]:
    """Yields a new folder beside `path`; renames it there when the block ends well.

    An existing folder is replaced only if it is empty or holds `marker`, a file that says
    that it is one of ours.
    """
    target = Path(path)
    if target.is_file():
        raise _refuse(target, "it is a file", "name a folder")
    if target.is_dir() and any(target.iterdir()) and not (target / marker).is_file():
        raise _refuse(target, f"the folder is not empty and has no {marker}", "name a new folder")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        beside = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
    except OSError as error:
        raise _refuse(target, error.strerror or "no access", "name another place") from error
    try:
        beside.chmod(0o755)
        yield beside
        if target.is_dir():
            shutil.rmtree(target)
        beside.rename(target)
    finally:
        if beside.is_dir():
            shutil.rmtree(beside)
