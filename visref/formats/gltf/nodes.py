"""A glTF file's node hierarchy (section 3.5): order, transforms, and what it places where."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.formats.gltf.document import Document
from visref.formats.gltf.levels import read_levels
from visref.formats.gltf.values import Items, Json
from visref.formats.placed import compose
from visref.scene import Float64, Int64


@dataclass(frozen=True, eq=False)
class Nodes:
    """The nodes that the file's scene reaches.

    `order`: node indices depth-first, children in file order. `parent`: node -> parent, -1
    for a root. `translation` (n, 3), `rotation` (n, 4) as x y z w, `scale` (n, 3) float64 of
    every node in the file; `matrices`: (m, 4, 4) float64 of the nodes `with_matrix`, (m,) int64, in
    place of these where the file gives one. `visible`: (n,) bool, what KHR_node_visibility says of
    each node itself; `hidden`: those that it hides, with all below them. `levels`: the nodes of
    MSFT_lod's coarser levels of each node that has some, finest first; their parent is that node's,
    and they follow its subtree.
    """

    order: list[int]
    parent: list[int]
    translation: Float64
    rotation: Float64
    scale: Float64
    with_matrix: Int64
    matrices: Float64
    visible: NDArray[np.bool_]
    hidden: set[int]
    levels: dict[int, list[int]]

    @cached_property
    def matrix(self) -> dict[int, Float64]:
        """Node -> (4, 4) float64, where the file gives one."""
        return dict(zip(self.with_matrix.tolist(), self.matrices, strict=True))

    @cached_property
    def generations(self) -> list[Int64]:
        """The reached nodes by their distance from the root, each generation ascending."""
        parent = np.array(self.parent, np.int64)
        # Each round doubles how far up `above` looks, and `depth` counts the way there.
        above, depth = parent, (parent >= 0).astype(np.int64)
        while (above >= 0).any():
            depth = depth + np.where(above >= 0, depth[above], 0)
            above = np.where(above >= 0, above[above], -1)
        reached = np.zeros(len(parent), np.bool_)
        reached[self.order] = True
        depth = np.where(reached, depth, -1)
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
        if not nodes:
            return result
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
        result[self.with_matrix] = self.matrices
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
    while waiting:
        node = waiting.pop()
        order.append(node)
        if node in levels:
            waiting.extend(reversed(levels[node]))
        if node in children:
            waiting.extend(reversed(children[node]))
    visible = np.ones(len(nodes), np.bool_)
    for node in order:
        if "extensions" in nodes.values[node]:
            visible[node] = _visible(nodes[node])
    hidden = set()
    if not visible.all():
        for node in order:
            if parent[node] in hidden or not visible[node]:
                hidden.add(node)
    own = _transforms_at_once(nodes.values, order) or _transforms(nodes, order)
    return Nodes(order, parent, *own, visible, hidden, levels)


# translation, rotation, scale, with_matrix and matrices, as in `Nodes`.
_Transforms = tuple[Float64, Float64, Float64, Int64, Float64]
_SIZES = {"matrix": 16, "translation": 3, "rotation": 4, "scale": 3}
# What `Json.numbers` takes as it is.
_PLAIN_BELOW = 1e300


def _still(count: int) -> tuple[Float64, Float64, Float64]:
    """Translation, rotation and scale that change nothing, of so many nodes."""
    rotation = np.tile((0.0, 0.0, 0.0, 1.0), (count, 1))
    return np.zeros((count, 3)), rotation, np.ones((count, 3))


def _transforms_at_once(values: list[Any], order: list[int]) -> _Transforms | None:
    """What the nodes of `order` say of themselves, a property of all nodes at once; None where
    anything is not as it should be, which `_transforms` names, or bears."""
    said: dict[str, tuple[list[int], list[Any]]] = {name: ([], []) for name in _SIZES}
    matrix, *others = said.items()
    for node in order:
        value = values[node]
        # A matrix stands in place of the others, which nobody looks at then.
        for name, (some, lists) in (matrix,) if "matrix" in value else others:
            if name in value:
                some.append(node)
                lists.append(value[name])
    found: dict[str, tuple[Int64, Float64]] = {}
    for name, (some, lists) in said.items():
        if not ({list}.issuperset(map(type, lists)) and {_SIZES[name]}.issuperset(map(len, lists))):
            return None
        if not {int, float}.issuperset(map(type, chain.from_iterable(lists))):
            return None
        try:
            numbers = np.fromiter(chain.from_iterable(lists), np.float64)
        except OverflowError:
            return None
        if not (np.abs(numbers) < _PLAIN_BELOW).all():
            return None
        found[name] = np.array(some, np.int64), numbers.reshape(-1, _SIZES[name])
    translation, rotation, scale = _still(len(values))
    for name, target in (("translation", translation), ("rotation", rotation), ("scale", scale)):
        target[found[name][0]] = found[name][1]
    matrices = found["matrix"][1].reshape(-1, 4, 4).transpose(0, 2, 1)
    if not have_length(found["rotation"][1]) or (matrices[:, 3] != (0.0, 0.0, 0.0, 1.0)).any():
        return None
    return translation, rotation, scale, found["matrix"][0], matrices


def _transforms(nodes: Items, order: list[int]) -> _Transforms:
    """What the nodes of `order` say of themselves, node by node. Raises InputError naming the
    first place that is wrong."""
    translation, rotation, scale = _still(len(nodes))
    matrices = {}
    for node in order:
        value = nodes.values[node]
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
    own = np.array(list(matrices.values())).reshape(-1, 4, 4)
    return translation, rotation, scale, np.array(list(matrices), np.int64), own


def _children(document: Document, nodes: Items) -> tuple[dict[int, list[int]], list[int]]:
    children: dict[int, list[int]] = {}
    count = len(nodes)
    parent = [-1] * count
    for index, value in enumerate(nodes.values):
        if type(value) is dict and "children" not in value:
            continue
        listed = nodes[index]["children"]
        below = children[index] = []
        for place, child in enumerate(listed.items().values):
            if type(child) is not int or not 0 <= child < count or parent[child] >= 0:
                reference = listed.items()[place]
                document.entry("nodes", reference)
                child = reference.integer()
                if parent[child] >= 0:
                    reference.fail(f"nodes[{child}] has a parent already: nodes[{parent[child]}]")
            parent[child] = index
            below.append(child)
    _refuse_cycle(nodes, parent)
    return children, parent


def _refuse_cycle(nodes: Items, parent: list[int]) -> None:
    """A node is in a cycle if following parents never reaches a root."""
    above = np.array(parent, np.int64)
    # After k rounds `above` is the ancestor 2^k generations up: nobody has more than there are.
    for _ in range(len(parent).bit_length()):
        above = np.where(above >= 0, above[above], -1)
        if not (above >= 0).any():
            return
    endless = np.flatnonzero(above >= 0)
    if not len(endless):
        return
    seen: set[int] = set()
    node = int(endless[0])
    while node not in seen:
        seen.add(node)
        node = parent[node]
    nodes[node].fail("the node graph has a cycle: it is its own ancestor")


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
