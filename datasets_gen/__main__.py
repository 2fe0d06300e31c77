"""python -m visref_datasets_gen NAME --out DIR: write a generated data set as GLB and path JSON."""

from __future__ import annotations

import argparse
import inspect
import sys
from pathlib import Path

from visref.errors import InputError
from visref.generators import find_generator, options_of
from visref.registry import SCENES, available
from visref.wording import did_you_mean
from visref_datasets_gen.dataset import Dataset


def main(arguments: list[str] | None = None) -> int:
    """Write the data set that the command line names; returns the exit status."""
    known = available(SCENES)
    parser = argparse.ArgumentParser(prog="python -m visref_datasets_gen", description=__doc__)
    parser.add_argument("name", metavar="NAME[:option=value,…]", help=f"one of: {', '.join(known)}")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--seed", type=int, help="of everything random (default 0)")
    parser.add_argument("--scale", type=float, help="size of the scene (default 1)")
    parser.add_argument("--frames", type=int, help="length of the path")
    parser.add_argument("--width", type=int, help="pixels; with --height")
    parser.add_argument("--height", type=int, help="pixels; with --width")
    given = parser.parse_args(arguments)
    try:
        generator = find_generator(given.name)
        if generator is None:
            name = given.name.partition(":")[0]
            raise InputError(f"no data set is called '{name}'", fix=did_you_mean(name, known))
        settings = generator.given | {
            name: value
            for name in ("seed", "scale", "frames")
            if (value := getattr(given, name)) is not None
        }
        if settings.get("seed", 0) < 0:
            raise InputError(f"the seed is {settings['seed']}", place="seed", fix="give 0 or more")
        if (given.width is None) != (given.height is None):
            raise InputError(
                "a width and a height belong together", fix="give --width and --height"
            )
        unknown = settings.keys() - inspect.signature(generator.make).parameters.keys()
        if unknown:
            options = ", ".join(options_of(generator.make)) or "none"
            raise InputError(
                f"'{generator.name}' has no {min(unknown)}", fix=f"its options are {options}"
            )
        made = generator.make(**settings)
        for dataset in made if isinstance(made, list) else [made]:
            _write(dataset, given.out, given.width, given.height)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _write(dataset: Dataset, out: Path, width: int | None, height: int | None) -> None:
    if width is not None and height is not None:
        dataset = dataset.resized(width, height)
    for file in dataset.write(out):
        print(file)


if __name__ == "__main__":
    sys.exit(main())
