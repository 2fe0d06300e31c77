"""Levels of detail by MSFT_lod: a node, its finest level, names those that may stand in for it."""

from __future__ import annotations

from visref.formats.gltf.document import Document

_LEVELS = "MSFT_lod"


def read_levels(
    document: Document, children: dict[int, list[int]], parent: list[int]
) -> dict[int, list[int]]:
    """The level nodes of each node that has some, finest first.

    A level node stands at the parent of the node that it is a level of; `parent`, of each node,
    and `children` are changed so that it stands nowhere else. Raises InputError naming the place
    where it would stand in two.
    """
    nodes = document.entries("nodes")
    levels: dict[int, list[int]] = {}
    finest_of: dict[int, int] = {}
    for finest, value in enumerate(nodes.values):
        if "extensions" not in value:
            continue
        extension = nodes[finest].extension(_LEVELS)
        if extension is None:
            continue
        levels[finest] = []
        for reference in extension["ids"].items():
            document.entry("nodes", reference)
            level = reference.integer()
            if level == finest:
                reference.fail("the node is a level of detail of itself")
            if level in finest_of:
                reference.fail(f"nodes[{level}] is a level of nodes[{finest_of[level]}] already")
            finest_of[level] = finest
            if parent[level] not in (-1, parent[finest]):
                reference.fail(
                    f"nodes[{level}] stands in the hierarchy too, below nodes[{parent[level]}]",
                    "give the level a node of its own",
                )
            levels[finest].append(level)
    for level, finest in finest_of.items():
        if level in levels:
            nodes[level].fail(f"it is a level of nodes[{finest}] and has levels of its own")
        if parent[level] >= 0:
            children[parent[level]].remove(level)
        parent[level] = parent[finest]
    return levels
