"""visref objects: list a scene's object ids and names."""

from __future__ import annotations

import argparse
import json

import numpy as np
from rich.markup import escape
from rich.table import Table

from visref.cli.arguments import add_memory_argument, memory_of
from visref.cli.terminal import OUT
from visref.inputs import open_scene
from visref.judging.status import Exit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", metavar="SCENE")
    parser.add_argument("--json", action="store_true", help="for programs")
    add_memory_argument(parser)


def run(given: argparse.Namespace) -> Exit:
    scene, _, _ = open_scene(given.scene, max_memory=memory_of(given))
    sizes = np.diff(scene.object_offsets).tolist()
    if given.json:
        rows = [
            {"id": index, "name": name, "triangles": size}
            for index, (name, size) in enumerate(zip(scene.names, sizes, strict=True))
        ]
        OUT.print_json(json.dumps(rows))
        return Exit.NO_VIOLATION
    table = Table("id", "name", "triangles", box=None)
    for index, (name, size) in enumerate(zip(scene.names, sizes, strict=True)):
        table.add_row(str(index), escape(name), str(size))
    OUT.print(table)
    return Exit.NO_VIOLATION
