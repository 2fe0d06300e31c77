"""What Python compiles of each module when it is first imported, kept for the next process.

An installer mostly sees to that. Not so of a checkout that is installed as it lies, by installers
that leave it to the first run, and where PYTHONDONTWRITEBYTECODE is set, as it is in many
containers: then each process compiles all modules anew, which takes longer than all the rest of its
start.
"""

from __future__ import annotations

import compileall
import py_compile
import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from visref.registry import CULLERS, ENGINES, SCENES, available


def keep_packages() -> None:
    """Compile all modules of visref, and of the packages that its cullers, engines and scenes are
    in, but for those that are as they were."""
    groups = (CULLERS, ENGINES, SCENES)
    points = [point for group in groups for point in available(group).values()]
    for name in sorted({"visref", *(point.module.partition(".")[0] for point in points)}):
        with suppress(ImportError, ValueError):
            spec = find_spec(name)
            for folder in (spec and spec.submodule_search_locations) or ():
                compileall.compile_dir(folder, quiet=2)


def keep_loaded() -> None:
    """Compile the modules that this process has loaded and that have no bytecode yet."""
    for module in list(sys.modules.values()):
        source, kept = getattr(module, "__file__", None), getattr(module, "__cached__", None)
        if source and kept and source.endswith(".py") and not Path(kept).exists():
            # Where it cannot be kept, each process compiles it.
            with suppress(OSError, py_compile.PyCompileError):
                py_compile.compile(source, kept, doraise=True)
