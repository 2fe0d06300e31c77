"""visref objects: list a scene's objects: ids, sizes, bounds, glTF nodes, names, paths, groups."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import chain
from typing import Any

import numpy as np

from visref.cli.arguments import add_memory_argument, memory_of
from visref.cli.terminal import OUT
from visref.inputs import open_scene
from visref.judging.status import Exit
from visref.scene import Scene

HEADINGS = ("id", "triangles", "node", "least corner", "greatest corner", "name")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", metavar="SCENE")
    parser.add_argument("--json", action="store_true", help="for programs")
    add_memory_argument(parser)


def run(given: argparse.Namespace) -> Exit:
    scene, _, _ = open_scene(given.scene, max_memory=memory_of(given))
    if given.json:
        OUT.json_rows(_rows(scene))
    else:
        # Names come last, and rows as they are read: no name decides how wide a column is.
        widths = [
            len(heading) if width is None else max(len(heading), width)
            for heading, width in zip(HEADINGS, _widths(scene), strict=True)
        ]
        left = [heading not in ("id", "triangles", "node") for heading in HEADINGS]
        OUT.columns(chain([HEADINGS], map(_cells, _rows(scene))), [*widths[:-1], 0], left=left)
    return Exit.NO_VIOLATION


def _rows(scene: Scene) -> Iterator[dict[str, Any]]:
    sizes = np.diff(scene.object_offsets)
    groups: dict[int, list[str]] = {}
    for group in scene.groups:
        for member in group.objects:
            groups.setdefault(member, []).append(group.name)
    for index, name in enumerate(scene.names):
        bounds = scene.object_bounds[index]
        yield {
            "id": index,
            "name": name,
            "path": scene.paths[index],
            "node": _node(scene, index),
            "triangles": int(sizes[index]),
            # In world space; of what has no triangles, or is not there, there are none.
            "bounds": (bounds + scene.origin).tolist() if np.isfinite(bounds).all() else None,
            "groups": groups.get(index, []),
        }


def _node(scene: Scene, index: int) -> int | None:
    if scene.nodes is None or scene.nodes[index] < 0:
        return None
    return int(scene.nodes[index])


def _widths(scene: Scene) -> list[int | None]:
    longest = max(np.diff(scene.object_offsets).tolist(), default=0)
    node = None if scene.nodes is None else len(str(int(scene.nodes.max(initial=0))))
    # Three numbers of four digits, at the longest -1.234e+38 each.
    return [len(str(len(scene.names))), len(str(longest)), node, 32, 32, None]


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    bounds = row["bounds"]
    corners = ["-", "-"]
    if bounds is not None:
        corners = [" ".join(f"{value:.4g}" for value in corner) for corner in bounds]
    name = row["name"]
    if row["path"] != name:
        name += f"  (path {row['path']})"
    if row["groups"]:
        name += f"  (in {', '.join(row['groups'])})"
    node = "-" if row["node"] is None else str(row["node"])
    return str(row["id"]), str(row["triangles"]), node, *corners, name
