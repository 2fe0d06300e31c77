"""visref objects: list a scene's object ids and names."""

from __future__ import annotations

import argparse
from itertools import chain

import numpy as np

from visref.cli.arguments import add_memory_argument, memory_of
from visref.cli.terminal import OUT
from visref.inputs import open_scene
from visref.judging.status import Exit

HEADINGS = ("id", "triangles", "name")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", metavar="SCENE")
    parser.add_argument("--json", action="store_true", help="for programs")
    add_memory_argument(parser)


def run(given: argparse.Namespace) -> Exit:
    scene, _, _ = open_scene(given.scene, max_memory=memory_of(given))
    sizes = np.diff(scene.object_offsets).tolist()
    objects = enumerate(zip(scene.names, sizes, strict=True))
    if given.json:
        OUT.json_rows({"id": id_, "name": name, "triangles": size} for id_, (name, size) in objects)
    else:
        # Names come last, and rows as they are read: no name decides how wide a column is.
        widths = [
            max(len(HEADINGS[0]), len(str(len(sizes)))),
            max(len(HEADINGS[1]), len(str(max(sizes, default=0)))),
            0,
        ]
        rows = ((str(id_), str(size), name) for id_, (name, size) in objects)
        OUT.columns(chain([HEADINGS], rows), widths, left=(False, False, True))
    # Its output is all that it does.
    return Exit.NO_VIOLATION if OUT.whole else Exit.BAD_INPUT
