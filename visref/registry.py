"""Finding cullers by name, and reading `NAME:option=value,…` (engines are named so too).

A name comes from the entry-point group `visref.cullers`, or is `module:Class` for a culler
that nobody installed.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from difflib import get_close_matches
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from visref.culler import Culler, Option
from visref.errors import InputError

CULLERS = "visref.cullers"
SCENES = "visref.scenes"


def available(group: str) -> dict[str, EntryPoint]:
    """Installed entry points of a group, by name, sorted."""
    return {point.name: point for point in sorted(entry_points(group=group), key=lambda p: p.name)}


def load_entry(group: str, name: str, *, kind: str) -> object:
    """The object behind an entry point. Raises InputError naming the known names."""
    points = available(group)
    if name not in points:
        near = get_close_matches(name, points, n=1)
        hint = f"did you mean '{near[0]}'?" if near else f"known are {', '.join(points) or 'none'}"
        raise InputError(f"no {kind} is named '{name}'", fix=hint)
    return points[name].load()


def make_culler(spec: str) -> Culler:
    """A culler from its spec: `NAME[:option=value,…]` or `module:Class[:option=value,…]`.

    Raises InputError for an unknown name, option or value.
    """
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
    return found(**read_options(spec, found.options, rest))


def _import(module: str, attribute: str) -> object:
    # As `python -m` does: a culler in the current folder needs no installation.
    if str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
    try:
        return getattr(importlib.import_module(module), attribute)
    except ModuleNotFoundError as error:
        if error.name is not None and module.startswith(error.name):
            known = ", ".join(available(CULLERS))
            raise InputError(
                f"no culler and no module is named '{module}'", fix=f"known cullers are {known}"
            ) from error
        raise InputError(f"module '{module}' does not import: {error}") from error
    except AttributeError as error:
        raise InputError(f"module '{module}' has no '{attribute}'", fix="check the name") from error


def read_options(
    spec: str, known: Mapping[str, Option], text: str
) -> dict[str, bool | int | float | str]:
    """The options `text`, `option=value,…`, that `spec` ends in; those not given are left out.

    Raises InputError for an unknown option and for a value that the option cannot be.
    """
    values: dict[str, bool | int | float | str] = {}
    for part in filter(None, text.split(",")):
        name, equals, value = part.partition("=")
        if not equals:
            raise InputError(f"'{part}' in '{spec}' is not option=value", fix="write option=value")
        if name not in known:
            raise InputError(
                f"'{spec}' has no option '{name}'",
                fix=f"known are {', '.join(known) or 'none'}",
            )
        if name in values:
            raise InputError(f"option '{name}' comes twice in '{spec}'", fix="keep one")
        values[name] = _value(spec, name, value, known[name])
    return values


_TRUTHS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}


def _value(spec: str, name: str, text: str, option: Option) -> bool | int | float | str:
    kind = type(option.default)
    value: bool | int | float | str
    try:
        value = _TRUTHS[text.lower()] if kind is bool else kind(text)
    except (KeyError, ValueError) as error:
        raise InputError(
            f"'{name}={text}' in '{spec}' is not a {kind.__name__}",
            fix=f"the default is {option.default}",
        ) from error
    if option.choices and value not in option.choices:
        allowed = ", ".join(map(str, option.choices))
        raise InputError(f"'{name}={text}' in '{spec}' is not a choice", fix=f"give {allowed}")
    return value
