"""Scenes that a program makes: `NAME[:option=value,…]`, from the entry-point group `visref.scenes`.

A generator is a function (or any callable) whose options are its keyword arguments with a
default that is a bool, an int, a float or a string. It returns what can write itself, see
`Generated`; `visref_datasets_gen.dataset.Dataset` is one, made of the nodes and meshes of
`visref_datasets_gen.graph` and a `visref.camera_path.CameraPath`. The same options give the
same bytes. It raises InputError for a value that makes no scene.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, cast

from visref.errors import InputError
from visref.options import Option, OptionValue, read_options
from visref.registry import SCENES, available, load_entry


class Generated(Protocol):
    """What a scene generator returns."""

    def write(self, directory: Path) -> tuple[Path, Path]:
        """Write the scene, in any format that `visref.formats` reads, and its camera path.

        Returns the two files, the scene's first; the path's is written last.
        """
        ...


@dataclass(frozen=True)
class Generator:
    """A generator as a spec names it. `given`: the options in the spec."""

    name: str
    make: Callable[..., Any]
    given: dict[str, OptionValue]

    @property
    def settings(self) -> dict[str, OptionValue]:
        """Every option's value, defaults included."""
        defaults = {name: option.default for name, option in options_of(self.make).items()}
        return defaults | self.given

    def write(self, directory: Path) -> tuple[Path, Path]:
        """Generate, and write. Raises InputError where the generator does, or makes several."""
        made = self.make(**self.given)
        if isinstance(made, list):
            names = [one.name for one in made]
            raise InputError(
                f"this is a set of {len(names)} scenes ({names[0]}, …), not one",
                fix="write them with `python -m visref_datasets_gen NAME --out DIR` and name one",
            )
        return cast(Generated, made).write(directory)


def find_generator(spec: str) -> Generator | None:
    """The generator that a spec names; None where it names none.

    Raises InputError for an unknown option, and for a value that an option cannot be.
    """
    name, _, options = spec.partition(":")
    if name not in available(SCENES):
        return None
    make = cast(Callable[..., Any], load_entry(SCENES, name, kind="scene"))
    return Generator(name, make, read_options(spec, options_of(make), options))


def options_of(make: Callable[..., Any]) -> dict[str, Option]:
    """A generator's options, by name, in its own order."""
    return {
        name: Option(parameter.default, "")
        for name, parameter in inspect.signature(make).parameters.items()
        if isinstance(parameter.default, (bool, int, float, str))
    }
