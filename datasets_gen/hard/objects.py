"""Hard cases of objects, transforms, bad vertices and cameras that move."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera_path import CameraPath
from visref_datasets_gen.graph import Mesh, Node, Primitive
from visref_datasets_gen.hard.stage import (
    ONE_SIDED,
    QUAD,
    TWO_SIDED,
    HardCase,
    Stage,
    perspective,
    seen,
    turned,
)

Float64 = NDArray[np.float64]

# At depth 8 a pixel is one unit wide, and pixel (x, y) is at (x - 3.5, 3.5 - y).
CARD = [(0.75, -1.25, -8.0), (2.75, -1.25, -8.0), (2.75, 1.75, -8.0), (0.75, 1.75, -8.0)]


def _mesh(name: str, points: Any, faces: Any) -> Mesh:
    primitive = Primitive(np.array(points, np.float32), np.array(faces, np.uint32), TWO_SIDED)
    return Mesh(name, (primitive,))


def _scaled(x: float, y: float, z: float) -> Float64:
    return np.diag([x, y, z, 1.0])


def _rotated(angle: float) -> Float64:
    result = np.eye(4)
    result[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    return result


def transforms() -> Iterator[HardCase]:
    stage = Stage(perspective())
    stage.wall("wall", 16.0)
    stage.add("mirrored", CARD, QUAD, material=ONE_SIDED, matrix=_scaled(-1, 1, 1))
    yield stage.case(
        "mirrored",
        """A card at columns 5 and 6 of its own space, mirrored to columns 1 and 2. Mirroring
        turns the winding and the flip turns it back: with back faces culled it still faces the
        camera.""",
        seen("wall"),
        seen("mirrored", x=(1, 2), y=(2, 4)),
        cull_backfaces=True,
    )

    for name, cull in (("two-sided", False), ("culled", True)):
        stage = Stage(perspective())
        stage.wall("wall", 16.0)
        behind = np.multiply(CARD, (1.0, 1.0, -1.0))
        stage.add("negated", behind, QUAD, material=ONE_SIDED, matrix=_scaled(-1, -1, -1))
        shown = [] if cull else [seen("negated", x=(1, 2), y=(3, 5))]
        yield stage.case(
            f"negative-scale-{name}",
            """A card that faces the camera's way from behind it, scaled by -1 through the eye:
            it lands before the camera, upside down, and faces away. Its box comes from where
            its vertices are.""",
            seen("wall"),
            *shown,
            cull_backfaces=cull,
        )

    stage = Stage(perspective())
    stage.wall("wall", 16.0)
    stage.add("point", CARD, QUAD, matrix=_scaled(0, 0, 0))
    stage.add("line", CARD, QUAD, matrix=_scaled(1, 0, 1))
    deep = [*CARD, *np.add(CARD, (0.0, 0.0, 4.0))]
    flat = _scaled(1, 1, 0)
    flat[2, 3] = -8.0
    stage.add("flat", deep, [*QUAD, *np.add(QUAD, 4), [0, 1, 5], [0, 5, 4]], matrix=flat)
    yield stage.case(
        "zero-scale",
        """A card scaled to a point and one scaled to a line are degenerate and never visible. A
        box scaled flat keeps its front and back, in one plane: it is as visible as a card.""",
        seen("wall"),
        seen("flat", x=(5, 6), y=(2, 4)),
    )

    # A rotation, a stretch and another rotation make the shear x += y (its singular values are
    # the golden ratio and its inverse).
    stretch = (1.0 + math.sqrt(5.0)) / 2.0
    before, after = -0.5 * math.atan2(2.0, -1.0), 0.5 * math.atan2(2.0, 1.0)
    points = [(-1.75, -3.75, -8.0), (0.25, -3.75, -8.0), (0.25, 3.75, -8.0), (-1.75, 3.75, -8.0)]
    child = Node("skewed", _mesh("skewed", points, QUAD), _rotated(before))
    stretched = _rotated(after) @ _scaled(stretch, 1.0 / stretch, 1.0)
    stage = Stage(perspective())
    stage.wall("wall", 16.0)
    stage.nodes.append(Node("stretch", None, stretched, (child,)))
    yield stage.case(
        "skewed",
        """A rotated child of a stretched parent: together they shear a strip of two columns by
        a column a row. Its sides lie a quarter of a pixel from the samples.""",
        seen("wall"),
        *(seen("skewed", x=(max(6 - y, 0), 7 - y), y=(y, y)) for y in range(8)),
    )


def counts() -> Iterator[HardCase]:
    stage = Stage(perspective())
    stage.wall("wall", 16.0)
    stage.nodes.append(Node("empty", _mesh("empty", [(0, 0, -8)], np.zeros((0, 3)))))
    stage.card("card", 8.0, (1.5, 3.5), (1.5, 3.5))
    yield stage.case(
        "empty-object",
        "An object without triangles keeps its id and is never visible.",
        seen("wall"),
        seen("card", x=(2, 3), y=(2, 3)),
    )

    stage = Stage(perspective())
    stage.nodes.append(Node("empty", _mesh("empty", [(0, 0, -8)], np.zeros((0, 3)))))
    yield stage.case(
        "empty-scene",
        "A scene without a triangle: every sample is background.",
    )

    stage = Stage(perspective())
    stage.pixels("one", [(-1, -1, 8), (-1, 8.5, 8), (8.5, -1, 8)], [[0, 1, 2]])
    yield stage.case(
        "one-triangle",
        "One triangle: the samples on and above the line x + y = 7.5 are its own.",
        *(seen("one", x=(0, 7 - y), y=(y, y)) for y in range(8)),
    )

    side = 64
    stage = Stage(perspective(side, side))
    mesh = _mesh("speck", [(-0.25, -0.25, 0), (0.25, -0.25, 0), (0, 0.25, 0)], [[0, 1, 2]])
    for y in range(side):
        for x in range(side):
            # At depth 16 a pixel is a quarter wide; the speck covers its own sample alone.
            matrix = np.diag([0.25, 0.25, 1.0, 1.0])
            matrix[:3, 3] = stage.point(x, y, 16.0)
            stage.nodes.append(Node(f"speck-{x:02d}-{y:02d}", mesh, matrix))
    yield stage.case(
        "many-objects-of-one-triangle",
        "4,096 objects of one triangle, each about one sample: all are visible.",
        *(
            seen(f"speck-{x:02d}-{y:02d}", x=(x, x), y=(y, y))
            for y in range(side)
            for x in range(side)
        ),
    )


def not_finite() -> Iterator[HardCase]:
    for name, value in (("nan", math.nan), ("infinite", math.inf)):
        stage = Stage(perspective())
        stage.wall("wall", 16.0)
        stage.add("broken", [(0, 0, -8), (1, 0, -8), (0, value, -8)], [[0, 1, 2]])
        yield stage.case(
            f"{name}-vertex",
            "A vertex that is not finite is a clear error that names the object.",
            error=("NaN or infinite", "object 'broken'"),
        )


def motion() -> Iterator[HardCase]:
    def square(name: str, centre: Sequence[float], across: Sequence[float], half: float) -> Node:
        middle, side, up = np.array(centre), half * np.array(across), half * np.array([0, 1, 0])
        corners = [middle - side - up, middle + side - up, middle + side + up, middle - side + up]
        return Node(name, _mesh(name, corners, QUAD))

    x, z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    nodes = (
        square("north", (0, 0, -8), x, 8.0),
        square("beyond-north", (0, 0, -24), x, 32.0),
        square("east", (8, 0, 0), z, 8.0),
        square("south", (0, 0, 8), x, 8.0),
        square("beyond-south", (0, 0, 24), x, 32.0),
    )
    start = perspective()
    jumped = perspective(eye=(0.0, 0.0, -16.0))
    south = ((-1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    frames = (
        (start, "north"),
        (turned(start, (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)), "east"),
        (turned(start, *south), "south"),
        (start, "north"),
        (replace(jumped, cut=True), "beyond-north"),
        (turned(jumped, *south), "north"),
        (replace(turned(perspective(eye=(0.0, 0.0, 16.0)), *south), cut=True), "beyond-south"),
        (start, "north"),
    )
    yield HardCase(
        "turns-and-cuts",
        """Quarter and half turns between two frames, and jumps past what hid the view (with and
        without a cut mark): each frame is as any other, whatever the frame before showed. Each
        square covers the whole view from where it is seen.""",
        nodes,
        CameraPath(tuple(camera for camera, _ in frames)),
        tuple((seen(name),) for _, name in frames),
    )
