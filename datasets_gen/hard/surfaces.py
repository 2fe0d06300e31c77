"""Hard cases of surfaces: coincidence, shared borders, slivers, soups, enormous triangles."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from visref_datasets_gen.hard.stage import (
    QUAD,
    HardCase,
    Stage,
    orthographic,
    perspective,
    seen,
)

FLOAT32_BEFORE_8 = 8.0 - 2.0**-21
THIRD = float(np.float32(1.0 / 3.0))  # 9.9e-9 above 1/3


def coincidences() -> Iterator[HardCase]:
    stage = Stage(perspective())
    stage.wall("first", 8.0)
    stage.wall("second", 8.0)
    stage.wall("behind", 16.0)
    yield stage.case(
        "coplanar-duplicates",
        "Two objects with the same vertices are tied at every sample; what is behind is hidden.",
        seen("first", "second"),
    )

    stage = Stage(perspective())
    stage.card("left", 8.0, (-1.0, 4.5), (-1.0, 8.0))
    stage.card("right", 8.0, (2.5, 8.0), (-1.0, 8.0))
    yield stage.case(
        "coplanar-overlap",
        "Two cards in one plane are tied where both cover a sample, and alone elsewhere.",
        seen("left", x=(0, 2)),
        seen("left", "right", x=(3, 4)),
        seen("right", x=(5, 7)),
    )

    # The plane z = -8 - y / 2; every corner and the middle lie in it exactly.
    corners = [(-8.0, -8.0, -4.0), (8.0, -8.0, -4.0), (8.0, 8.0, -12.0), (-8.0, 8.0, -12.0)]
    stage = Stage(perspective())
    stage.add("slash", corners, QUAD)
    stage.add("backslash", corners, [[0, 1, 3], [1, 2, 3]])
    quarters = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    stage.add("quartered", [*corners, (0.0, 0.0, -8.0)], quarters)
    yield stage.case(
        "coplanar-tilted",
        """Three triangulations of one tilted plane through exact points are the same plane:
        all three are tied at every sample.""",
        seen("slash", "backslash", "quartered"),
    )

    stage = Stage(perspective())
    stage.wall("wall", 8.0)
    stage.card("front", FLOAT32_BEFORE_8, (1.5, 5.5), (1.5, 5.5), rounded=True)
    yield stage.case(
        "z-fighting",
        """A card one float32 step before a wall is in front of it, whatever a depth buffer can
        tell apart; its sides lie half a pixel from the samples.""",
        seen("wall"),
        seen("front", x=(2, 5), y=(2, 5)),
    )

    for name, low, high, first, last in (
        ("between-samples", 1.5, 5.5, 2, 5),
        ("on-samples", 2.0, 5.0, 2, 5),
    ):
        stage = Stage(perspective())
        stage.wall("wall", 32.0)
        stage.card("front", 8.0, (low, high), (low, high))
        stage.card("back", 16.0, (low, high), (low, high))
        yield stage.case(
            f"coinciding-silhouettes-{name}",
            """The back card's outline falls exactly on the front card's, seen from the eye: it
            is exposed nowhere, and its border samples are covered by the front card too.""",
            seen("wall"),
            seen("front", x=(first, last), y=(first, last)),
        )


def junctions() -> Iterator[HardCase]:
    # One edge along the image's diagonal, x = y, through eight samples.
    stage = Stage(perspective())
    stage.pixels("lower", [(-4, -4, 8), (-4, 12, 8), (12, 12, 8)], [[0, 1, 2]])
    stage.pixels(
        "upper", [(-4, -4, 8), (4, 4, 8), (12, 12, 8), (12, -4, 8)], [[0, 1, 3], [1, 2, 3]]
    )
    stage.wall("behind", 16.0)
    diagonal = [
        patch
        for k in range(8)
        for patch in (
            seen("lower", x=(0, 7), y=(k, k)),
            seen("upper", x=(k, 7), y=(k, k)),
            seen("lower", "upper", x=(k, k), y=(k, k)),
        )
    ]
    yield stage.case(
        "t-junction-exact",
        """The upper side has a middle vertex that lies exactly on the lower side's edge, and
        exactly on a sample: no gap. Samples on the edge belong to both; nothing shows through.""",
        *diagonal,
    )

    # The edge from (0, 0) to (3, 1) passes (1, 1/3); the vertex there was rounded up.
    eye = (1.0, 1.0 / 3.0 + 5e-9, 0.0)
    stage = Stage(orthographic(1, 3, ymag=3e-8, eye=eye))
    stage.add("lower", [(0, 0, -8), (3, -4, -8), (3, 1, -8)], [[0, 1, 2]])
    upper = [(0, 0, -8), (1, THIRD, -8), (3, 1, -8), (0.5, 5, -8)]
    stage.add("upper", upper, [[0, 1, 3], [1, 2, 3]])
    stage.add("behind", [(-9, -9, -16), (9, -9, -16), (9, 9, -16), (-9, 9, -16)], QUAD)
    yield stage.case(
        "t-junction-gap",
        """The upper side's middle vertex, (1, 1/3) rounded to float32, lies 9.9e-9 above the
        lower side's edge. The samples lie 2.5e-8 above, 5e-9 above and 1.5e-8 below the edge:
        the middle one is in the real gap, and what is behind owns it.""",
        seen("upper", y=(0, 0)),
        seen("behind", y=(1, 1)),
        seen("lower", y=(2, 2)),
    )

    stage = Stage(perspective())
    stage.card("left", 8.0, (-1.0, 3.0), (-1.0, 8.0))
    stage.card("right", 8.0, (3.0, 8.0), (-1.0, 8.0))
    stage.wall("behind", 16.0)
    yield stage.case(
        "edge-on-samples",
        "Two objects share an edge through a column of samples: tied there, and no hole.",
        seen("left"),
        seen("right", x=(3, 7)),
        seen("left", "right", x=(3, 3)),
    )

    ring = [(-9, -9), (2, -9), (12, -9), (12, 3), (12, 12), (3, 12), (-9, 12), (-9, 4)]
    stage = Stage(perspective())
    fan = [[k, 8, (k + 1) % 8] for k in range(8)]
    stage.pixels("fan", [*((x, y, 8.0) for x, y in ring), (3, 3, 8)], fan)
    stage.wall("behind", 16.0)
    yield stage.case(
        "vertex-on-sample",
        "Eight triangles of one object meet exactly at a sample: one owner, and no hole.",
        seen("fan"),
    )

    stage = Stage(perspective())
    for name, x, y in (
        ("north-west", (-1.0, 3.0), (-1.0, 3.0)),
        ("north-east", (3.0, 8.0), (-1.0, 3.0)),
        ("south-west", (-1.0, 3.0), (3.0, 8.0)),
        ("south-east", (3.0, 8.0), (3.0, 8.0)),
    ):
        stage.card(name, 8.0, x, y)
    stage.wall("behind", 16.0)
    yield stage.case(
        "vertex-of-four-objects",
        "Four objects meet at a vertex exactly on a sample: all four are tied there.",
        seen("north-west", x=(0, 2), y=(0, 2)),
        seen("north-east", x=(4, 7), y=(0, 2)),
        seen("south-west", x=(0, 2), y=(4, 7)),
        seen("south-east", x=(4, 7), y=(4, 7)),
        seen("north-west", "north-east", x=(3, 3), y=(0, 2)),
        seen("south-west", "south-east", x=(3, 3), y=(4, 7)),
        seen("north-west", "south-west", x=(0, 2), y=(3, 3)),
        seen("north-east", "south-east", x=(4, 7), y=(3, 3)),
        seen("north-west", "north-east", "south-west", "south-east", x=(3, 3), y=(3, 3)),
    )

    for name, seam, tie in (("on-samples", 3.0, True), ("between-samples", 3.5, False)):
        stage = Stage(orthographic())
        stage.card("left", 8.0, (-1.0, seam), (-1.0, 8.0))
        stage.card("right", 8.0, (seam, 8.0), (-1.0, 8.0))
        stage.wall("behind", 16.0)
        at_seam = [seen("left", "right", x=(3, 3))] if tie else []
        yield stage.case(
            f"orthographic-touching-{name}",
            "Occluders that touch leave no gap under an orthographic camera either.",
            seen("left", x=(0, 3)),
            seen("right", x=(4, 7)),
            *at_seam,
        )


def tessellations(rng: np.random.Generator) -> Iterator[HardCase]:
    for name, offset, scale in (
        ("at-origin", (0.0, 0.0, 0.0), 1.0),
        ("tiny", (0.0, 0.0, 0.0), 2.0**-10),
        ("huge", (0.0, 0.0, 0.0), 2.0**10),
        ("shifted", (1000.25, -500.5, 2000.0), 1.0),
        ("far-away", (1e6, -1e6, 1e6), 16.0),
    ):
        stage = Stage(perspective(near=0.5 * scale, far=64.0 * scale, eye=offset))
        ticks = np.arange(-2.0, 9.5, 0.5)
        x, y = (grid.ravel() for grid in np.meshgrid(ticks, ticks))
        # Vertices at samples stay exactly there; the others wander.
        free = (x % 1.0 != 0.0) | (y % 1.0 != 0.0)
        x, y = (grid + free * rng.uniform(-0.2, 0.2, len(x)) for grid in (x, y))
        depth = 8.0 + free * rng.uniform(0.0, 1.0, len(x))
        here = np.arange(len(ticks) - 1)
        first = (here[:, None] * len(ticks) + here).ravel()[:, None]
        down = len(ticks)
        faces = np.concatenate(
            [np.add(first, (0, down, down + 1)), np.add(first, (0, down + 1, 1))]
        )
        stage.pixels("wall", np.stack([x, y, depth * scale], axis=1), faces, rounded=True)
        stage.wall("behind", 16.0 * scale, rounded=True)
        yield stage.case(
            f"tessellated-wall-{name}",
            """A sheet of 968 triangles whose vertices are shared, 64 of them aimed at by samples,
            and whose rim lies outside the image. However its vertices are rounded it stays one
            sheet, so it covers every sample; the object behind is hidden.""",
            seen("wall"),
        )


def slivers() -> Iterator[HardCase]:
    stage = Stage(perspective())
    stage.wall("wall", 16.0)
    stage.pixels("sliver", [(3.5, -1, 8), (3.5, 8, 8), (3.515625, 8, 8)], [[0, 1, 2]])
    yield stage.case(
        "sliver-between-samples",
        "A sliver 1/64 of a pixel wide passes between two columns of samples and owns none.",
        seen("wall"),
        between=("sliver",),
    )

    stage = Stage(perspective())
    stage.wall("wall", 16.0)
    corners = [(2.984375, -1, 8), (3, 8.5, 8), (3.015625, -1, 8)]
    stage.pixels("sliver", corners, [[0, 1, 2]])
    yield stage.case(
        "sliver-on-samples",
        "A sliver at most 1/32 of a pixel wide about a column of samples owns that column.",
        seen("wall"),
        seen("sliver", x=(3, 3)),
    )

    stage = Stage(perspective())
    stage.wall("wall", 16.0)
    corners = [(-1, -1, 8), (9, 9, 8), (9, 9 - 2.0**-18, 8)]
    stage.pixels("sliver", corners, [[0, 1, 2]])
    yield stage.case(
        "sliver-edge-on-samples",
        """The longest edge of a sliver runs exactly through the samples of the diagonal; its
        width there is under 2^-18 of a pixel. The triangle is closed, so it owns them.""",
        seen("wall"),
        *(seen("sliver", x=(k, k), y=(k, k)) for k in range(8)),
    )

    for name, low, high in (("between-samples", 3.25, 3.5), ("on-sample", 2.9375, 3.0625)):
        stage = Stage(perspective())
        stage.wall("wall", 16.0)
        stage.card("speck", 8.0, (low, high), (low, high))
        on = name == "on-sample"
        yield stage.case(
            f"sub-pixel-{name}",
            "An object much smaller than a pixel owns a sample only where it covers one.",
            seen("wall"),
            *([seen("speck", x=(3, 3), y=(3, 3))] if on else []),
            between=() if on else ("speck",),
        )


def degenerates() -> Iterator[HardCase]:
    stage = Stage(perspective())
    stage.wall("wall", 16.0)
    corners = [(3, 3, 8), (3, 3, 8), (3, 5, 8), (3, 7, 4)]
    stage.pixels("degenerate", corners, [[0, 0, 0], [0, 1, 2], [2, 2, 3]])
    stage.add("line", [(0.5, 0.5, -8), (1.5, 1.5, -8), (-2.5, -2.5, -8)], [[0, 1, 2]])
    yield stage.case(
        "degenerate",
        """Triangles of a repeated vertex, and of three vertices on a line, some exactly at
        samples: they have no area, cover nothing and hide nothing.""",
        seen("wall"),
    )

    stage = Stage(perspective(7, 7))
    stage.wall("wall", 16.0, rounded=True)
    stage.add("sheet", [(-8, 0, -1), (8, 0, -1), (8, 0, -12), (-8, 0, -12)], QUAD)
    yield stage.case(
        "edge-on-row",
        "A sheet in the plane of the eye and a row of samples is seen exactly edge-on.",
        seen("wall"),
    )

    stage = Stage(perspective())
    stage.wall("wall", 16.0)
    stage.add("sheet", [(-4, -4, -8), (4, 4, -8), (3, 3, -2)], [[0, 1, 2]])
    yield stage.case(
        "edge-on-diagonal",
        "A sheet in the plane x = y of the eye and a diagonal of samples is seen edge-on.",
        seen("wall"),
    )

    stage = Stage(orthographic())
    stage.wall("wall", 16.0)
    x = float(stage.point(3, 0, 0)[0])
    stage.add("sheet", [(x, -8, -1), (x, 8, -1), (x, 8, -12), (x, -8, -12)], QUAD)
    yield stage.case(
        "edge-on-orthographic",
        "A sheet that contains the parallel rays of a column of samples is seen edge-on.",
        seen("wall"),
    )


def soups() -> Iterator[HardCase]:
    # z = -8 + x / 2 and z = -8 - x / 2 cross at x = 0.
    first = [(-8, -8, -12), (8, -8, -4), (8, 8, -4), (-8, 8, -12)]
    second = [(-8, -8, -4), (8, -8, -12), (8, 8, -12), (-8, 8, -4)]
    for width, tie in ((8, False), (7, True)):
        stage = Stage(perspective(width, width))
        stage.add("rising", first, QUAD)
        stage.add("falling", second, QUAD)
        half = width // 2
        yield stage.case(
            "interpenetrating-with-tie" if tie else "interpenetrating",
            """Two sheets cross at x = 0: each is visible where it is the nearer, and where a
            column of samples looks exactly along the crossing, both are.""",
            seen("falling"),
            seen("rising", x=(half, width - 1)),
            *([seen("falling", "rising", x=(half, half))] if tie else []),
        )

    # Three of a card's four quarters, wound at random, and a fin on a shared edge that the eye
    # sees edge-on.
    ticks = (-1.0, 3.5, 8.0)
    corners = [(x, y, 8.0) for y in ticks for x in ticks]
    faces = [[0, 1, 4], [0, 4, 3], [1, 4, 2], [2, 4, 5], [3, 7, 4], [3, 6, 7], [1, 4, 8]]
    stage = Stage(perspective())
    stage.pixels("soup", [*corners[:8], (3.5, 1.0, 4.0)], faces)
    stage.wall("behind", 16.0)
    yield stage.case(
        "open-and-badly-wound",
        """An open sheet, its triangles wound either way, three of them on one edge: a triangle
        soup that hides what it covers, and nothing where its quarter is missing.""",
        seen("soup"),
        seen("behind", x=(4, 7), y=(4, 7)),
    )


def enormous() -> Iterator[HardCase]:
    for name, size in (("1e7", 1e7), ("1e30", 1e30)):
        stage = Stage(perspective())
        corners = [(-size, -size, -16.0), (3 * size, -size, -16.0), (-size, 3 * size, -16.0)]
        stage.add("enormous", corners, [[0, 1, 2]], rounded=True)
        stage.card("front", 8.0, (1.5, 3.5), (1.5, 3.5))
        stage.wall("behind", 32.0)
        yield stage.case(
            f"enormous-triangle-{name}",
            "A triangle of that size is as any other: it covers the image at its depth.",
            seen("enormous"),
            seen("front", x=(2, 3), y=(2, 3)),
        )
