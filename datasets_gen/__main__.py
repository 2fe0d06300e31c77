"""python -m datasets_gen NAME --out DIR: write a generated data set as GLB and path JSON."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path

from visref.errors import InputError
from visref_datasets_gen.dataset import Dataset

GROUP = "visref.scenes"


def main(arguments: list[str] | None = None) -> int:
    """Write the data set that the command line names; returns the exit status."""
    known = {point.name: point for point in entry_points(group=GROUP)}
    parser = argparse.ArgumentParser(prog="python -m datasets_gen", description=__doc__)
    parser.add_argument("name", metavar="NAME", help=f"one of: {', '.join(sorted(known))}")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--seed", type=int, default=0, help="of everything random (default 0)")
    parser.add_argument("--scale", type=float, default=1.0, help="size of the scene (default 1)")
    parser.add_argument("--frames", type=int, help="length of the path")
    parser.add_argument("--width", type=int, help="pixels; with --height")
    parser.add_argument("--height", type=int, help="pixels; with --width")
    given = parser.parse_args(arguments)
    try:
        if given.name not in known:
            raise InputError(
                f"no data set is called '{given.name}'",
                fix=f"choose from {', '.join(sorted(known))}",
            )
        if given.seed < 0:
            raise InputError(f"the seed is {given.seed}", place="--seed", fix="give 0 or more")
        if (given.width is None) != (given.height is None):
            raise InputError(
                "a width and a height belong together", fix="give --width and --height"
            )
        settings = {"seed": given.seed, "scale": given.scale}
        if given.frames is not None:
            settings["frames"] = given.frames
        made = known[given.name].load()(**settings)
        for dataset in made if isinstance(made, list) else [made]:
            _write(dataset, given.out, given.width, given.height)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _write(dataset: Dataset, out: Path, width: int | None, height: int | None) -> None:
    if width is not None and height is not None:
        if dataset.expected is not None:
            raise InputError(
                f"'{dataset.name}' has a verdict for its own image size",
                fix="leave out --width and --height",
            )
        dataset = replace(dataset, path=dataset.path.resized(width, height))
    for file in dataset.write(out):
        print(file)


if __name__ == "__main__":
    sys.exit(main())
