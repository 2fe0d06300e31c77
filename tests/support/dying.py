"""A process that dies, or is interrupted, at a chosen one of the steps it takes in the file system,
and folders told from each other."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable
from pathlib import Path

DIED, WENT_ON, FAILED = 86, 0, 1

# What a process tells its audit hooks before it touches a name.
_STEPS = ("os.rename", "os.mkdir", "os.rmdir", "os.remove", "open", "os.listdir", "os.scandir",
          "ctypes.dlsym", "shutil.rmtree")  # fmt: skip


def dies_at(step: int, action: Callable[[], object], *, interrupt: bool = False) -> int:
    """Do `action` in a process of its own that ends without a word before its `step`-th step (or
    there has a KeyboardInterrupt, once). `DIED` if it came to that, `WENT_ON` if it ended before,
    `FAILED` if it failed otherwise."""
    child = os.fork()
    if child == 0:
        left, died = step, False

        def hook(event: str, arguments: object) -> None:
            nonlocal left, died
            if event in _STEPS:
                left -= 1
                if left == 0:
                    if not interrupt:
                        os._exit(DIED)
                    died = True
                    raise KeyboardInterrupt

        sys.addaudithook(hook)
        try:
            action()
            os._exit(WENT_ON)
        except KeyboardInterrupt:
            os._exit(DIED if died else FAILED)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(FAILED)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def content(folder: Path) -> dict[str, bytes | str]:
    """All that stands in a folder, by path: a file's bytes, where a link leads, "" for others."""
    found: dict[str, bytes | str] = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink():
            found[name] = str(path.readlink())
        elif path.is_file():
            found[name] = path.read_bytes()
        else:
            found[name] = ""
    return found
