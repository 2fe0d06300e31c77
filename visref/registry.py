"""Finding cullers by name (engines, scenes and formats are found by `available` too).

A name comes from the entry-point group `visref.cullers`, or is `module:Class` for a culler
that nobody installed.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from functools import cache
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from pathlib import Path
from typing import TYPE_CHECKING

from visref.errors import InputError
from visref.options import OptionValue, read_options
from visref.wording import did_you_mean

if TYPE_CHECKING:
    from visref.culler import Culler

CULLERS = "visref.cullers"
ENGINES = "visref.engines"
SCENES = "visref.scenes"

# The engine that casts where nobody names another.
DEFAULT_ENGINE = "embree"


def available(group: str) -> dict[str, EntryPoint]:
    """Installed entry points of a group, by name, sorted."""
    return dict(_found(group, entry_points, tuple(sys.path)))


# Every package's metadata is a file: 8 ms, several times for each culler that is made. What is on
# the path may change, and who finds (in tests).
@cache
def _found(
    group: str, find: Callable[..., EntryPoints], path: tuple[str, ...]
) -> dict[str, EntryPoint]:
    return {point.name: point for point in sorted(find(group=group), key=lambda p: p.name)}


def load_entry(group: str, name: str, *, kind: str) -> object:
    """The object behind an entry point. Raises InputError naming the known names."""
    points = available(group)
    if name not in points:
        raise InputError(f"no {kind} is named '{name}'", fix=did_you_mean(name, points))
    return points[name].load()


def make_culler(spec: str) -> Culler:
    """A culler from its spec: `NAME[:option=value,…]` or `module:Class[:option=value,…]`, in this
    process.

    Raises InputError for an unknown name, option or value, and whatever its module or its
    constructor raises.
    """
    found, options = find_culler(spec)
    return found(**options)


def find_culler(spec: str) -> tuple[type[Culler], dict[str, OptionValue]]:
    """A culler's class and its constructor's arguments. Raises InputError for an unknown name,
    option or value, and whatever its module raises."""
    from visref.culler import Culler

    name, _, rest = spec.partition(":")
    if name in available(CULLERS):
        found = load_entry(CULLERS, name, kind="culler")
    elif rest and "=" not in rest.partition(":")[0]:
        attribute, _, rest = rest.partition(":")
        found = _import(name, attribute)
    else:
        found = load_entry(CULLERS, name, kind="culler")
    if not (isinstance(found, type) and issubclass(found, Culler)):
        raise InputError(f"'{spec}' is not a subclass of visref.culler.Culler", fix="derive it")
    return found, read_options(spec, found.options, rest)


def _import(module: str, attribute: str) -> object:
    # As `python -m` does: a culler in the current folder needs no installation. Once it is
    # imported, the folder stands last: whatever else is in it hides no library from us.
    here = str(Path.cwd())
    sys.path.insert(0, here)
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        # What a module that is there lacks itself is its own fault.
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):
            raise
        raise InputError(
            f"no culler and no module is named '{module}'",
            fix=did_you_mean(module, available(CULLERS)),
        ) from error
    finally:
        # An entry that was there before stays where it was.
        if here in sys.path:
            sys.path.remove(here)
        if here not in sys.path:
            sys.path.append(here)
    try:
        return getattr(found, attribute)
    except AttributeError as error:
        raise InputError(f"module '{module}' has no '{attribute}'", fix="check the name") from error
