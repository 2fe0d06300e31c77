"""A glTF file's node hierarchy (section 3.5): order, transforms, and what it places where."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.formats.gltf.document import Document
from visref.formats.gltf.levels import read_levels
from visref.formats.gltf.values import Json
from visref.formats.placed import compose
from visref.scene import Float64, Int64


@dataclass(frozen=True, eq=False)
class Nodes:
    """The nodes that the file's scene reaches.

    `order`: node indices depth-first, children in file order. `parent`: node -> parent, -1
    for a root. `translation` (n, 3), `rotation` (n, 4) as x y z w, `scale` (n, 3) float64 of
    every node in the file; `matrix`: node -> (4, 4), in place of these where the file gives
    one. `visible`: (n,) bool, what KHR_node_visibility says of each node itself; `hidden`: those
    that it hides, with all below them. `levels`: the nodes of MSFT_lod's coarser levels of each
    node that has some, finest first; their parent is that node's, and they follow its subtree.
    """

    order: list[int]
    parent: list[int]
    translation: Float64
    rotation: Float64
    scale: Float64
    matrix: dict[int, Float64]
    visible: NDArray[np.bool_]
    hidden: set[int]
    levels: dict[int, list[int]]

    @cached_property
    def generations(self) -> list[Int64]:
        """The reached nodes by their distance from the root, each generation ascending."""
        depth = np.full(len(self.parent), -1)
        for node in self.order:
            depth[node] = depth[self.parent[node]] + 1 if self.parent[node] >= 0 else 0
        by_depth = np.argsort(depth, kind="stable")
        starts = np.searchsorted(depth[by_depth], np.arange(depth.max(initial=-1) + 2))
        return [by_depth[start:end] for start, end in pairwise(starts)]

    @cached_property
    def subtrees(self) -> tuple[Int64, Int64]:
        """Where in `order` each node's subtree starts and ends, (n,) each; -1 where the scene does
        not reach it. MSFT_lod's coarser levels are in their parent's subtree."""
        starts = np.full(len(self.parent), -1)
        starts[self.order] = np.arange(len(self.order))
        sizes = [1] * len(self.parent)
        for node in reversed(self.order):
            if self.parent[node] >= 0:
                sizes[self.parent[node]] += sizes[node]
        return starts, np.where(starts >= 0, starts + np.array(sizes, np.int64), -1)

    def and_below(self, nodes: Collection[int]) -> NDArray[np.bool_]:
        """(n,) bool: the given nodes with all below them, as far as the scene reaches them."""
        result = np.zeros(len(self.parent), np.bool_)
        starts, ends = self.subtrees
        chosen = np.array([node for node in nodes if starts[node] >= 0], np.int64)
        if not len(chosen):
            return result
        edges = np.zeros(len(self.order) + 1, np.int64)
        np.add.at(edges, starts[chosen], 1)
        np.add.at(edges, ends[chosen], -1)
        result[self.order] = np.cumsum(edges)[:-1] > 0
        return result

    def parent_from_node(self) -> Float64:
        """(n, 4, 4) float64, each node's own transform."""
        result = trs_matrices(self.translation, self.rotation, self.scale)
        for node, matrix in self.matrix.items():
            result[node] = matrix
        return result

    def world_from_node(self) -> Float64:
        """(n, 4, 4) float64; identity for nodes that the scene does not reach."""
        local = self.parent_from_node()
        result = np.tile(np.eye(4), (len(self.parent), 1, 1))
        parent = np.array(self.parent, np.int64)
        for distance, nodes in enumerate(self.generations):
            above = result[parent[nodes]] if distance else result[nodes]
            result[nodes] = compose(above, local[nodes])
        return result

    def chain(self, node: int) -> list[int]:
        """The node and its ancestors, root first."""
        result = [node]
        while self.parent[result[-1]] >= 0:
            result.append(self.parent[result[-1]])
        return result[::-1]


def trs_matrices(translation: Float64, rotation: Float64, scale: Float64) -> Float64:
    """(n, 4, 4) float64 of translation (n, 3), unit quaternion (n, 4) x y z w, scale (n, 3).

    Quaternions are normalised first: files round them to float32 or less.
    """
    x, y, z, w = (rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).T
    result = np.zeros((len(translation), 4, 4))
    result[:, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    result[:, 0, 1] = 2.0 * (x * y - z * w)
    result[:, 0, 2] = 2.0 * (x * z + y * w)
    result[:, 1, 0] = 2.0 * (x * y + z * w)
    result[:, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    result[:, 1, 2] = 2.0 * (y * z - x * w)
    result[:, 2, 0] = 2.0 * (x * z - y * w)
    result[:, 2, 1] = 2.0 * (y * z + x * w)
    result[:, 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    result[:, :3, :3] *= scale[:, None, :]
    result[:, :3, 3] = translation
    result[:, 3, 3] = 1.0
    return result


def have_length(rotation: Float64) -> bool:
    """Whether every quaternion, (n, 4), can be normalised."""
    lengths = np.linalg.norm(rotation, axis=1)
    return bool(np.all((lengths > 0.0) & (lengths < np.inf)))


def read_nodes(document: Document) -> Nodes:
    """Read the hierarchy. Raises InputError for a cycle, or a node with two parents."""
    nodes = document.entries("nodes")
    children, parent = _children(document, nodes)
    levels = read_levels(document, children, parent)
    if levels:
        _refuse_cycle(nodes, parent)
    order = []
    finest = {level: node for node, coarser in levels.items() for level in coarser}
    roots = _roots(document, parent)
    # A level that is listed beside its node stands there as a level alone.
    among = set(roots)
    waiting = [root for root in roots if parent[root] >= 0 or finest.get(root) not in among][::-1]
    for root in waiting:
        if parent[root] >= 0:
            nodes[root].fail("it is a root of the scene and another node's child")
    if len(set(waiting)) != len(waiting):
        raise InputError("a root is listed twice", place="scenes", fix="list each node once")
    hidden = set()
    visible = np.ones(len(nodes), np.bool_)
    while waiting:
        node = waiting.pop()
        order.append(node)
        waiting.extend(reversed(levels.get(node, [])))
        waiting.extend(reversed(children.get(node, [])))
        visible[node] = _visible(nodes[node])
        if parent[node] in hidden or not visible[node]:
            hidden.add(node)
    translation, scale = np.zeros((len(nodes), 3)), np.ones((len(nodes), 3))
    rotation = np.tile((0.0, 0.0, 0.0, 1.0), (len(nodes), 1))
    matrices = {}
    for node in order:
        value = nodes[node].value
        if "matrix" in value:
            matrices[node] = _matrix(nodes[node]["matrix"])
            continue
        if "translation" in value:
            translation[node] = nodes[node]["translation"].numbers(3)
        if "scale" in value:
            scale[node] = nodes[node]["scale"].numbers(3)
        if "rotation" in value:
            member = nodes[node]["rotation"]
            rotation[node] = member.numbers(4)
            if not have_length(rotation[node][None]):
                member.fail("a rotation of zero or infinite length")
    return Nodes(order, parent, translation, rotation, scale, matrices, visible, hidden, levels)


def _children(document: Document, nodes: list[Json]) -> tuple[dict[int, list[int]], list[int]]:
    children: dict[int, list[int]] = {}
    parent = [-1] * len(nodes)
    for index, node in enumerate(nodes):
        listed = node.get("children")
        if listed is None:
            continue
        children[index] = []
        for reference in listed.items():
            document.entry("nodes", reference)
            child = reference.integer()
            if parent[child] >= 0:
                reference.fail(f"nodes[{child}] has a parent already: nodes[{parent[child]}]")
            parent[child] = index
            children[index].append(child)
    _refuse_cycle(nodes, parent)
    return children, parent


def _refuse_cycle(nodes: list[Json], parent: list[int]) -> None:
    """A node is in a cycle if following parents never reaches a root."""
    safe = bytearray(len(nodes))
    for start in range(len(nodes)):
        trail, node = [], start
        while node >= 0 and safe[node] == 0:
            safe[node] = 1
            trail.append(node)
            node = parent[node]
        if node >= 0 and safe[node] == 1:
            nodes[node].fail("the node graph has a cycle: it is its own ancestor")
        for node in trail:
            safe[node] = 2


def _roots(document: Document, parent: list[int]) -> list[int]:
    """The nodes of the file's scene, of its first scene, or all that nobody's child is."""
    chosen = document.root.get("scene")
    scenes = document.entries("scenes")
    if chosen is not None:
        scene = document.entry("scenes", chosen)
    elif scenes:
        scene = scenes[0]
    else:
        return [node for node, above in enumerate(parent) if above < 0]
    listed = scene.get("nodes")
    roots = []
    for reference in listed.items() if listed is not None else []:
        document.entry("nodes", reference)
        roots.append(reference.integer())
    return roots


def _visible(node: Json) -> bool:
    if "extensions" not in node.value:
        return True
    extension = node["extensions"].get("KHR_node_visibility")
    visible = extension.get("visible") if extension is not None else None
    return visible is None or visible.flag()


def _matrix(member: Json) -> Float64:
    """glTF writes matrices column by column."""
    matrix = np.array(member.numbers(16)).reshape(4, 4).T
    if not np.array_equal(matrix[3], (0.0, 0.0, 0.0, 1.0)):
        member.fail("the matrix's last row is not 0 0 0 1")
    return matrix
