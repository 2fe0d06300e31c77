"""Hard cases of numbers: near and far planes, huge ratios and offsets, the eye on or in things."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from visref_datasets_gen.hard.stage import (
    ONE_SIDED,
    QUAD,
    HardCase,
    Stage,
    orthographic,
    perspective,
    seen,
)

BOX = [
    *([0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]),
    *([2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]),
]


def offsets() -> Iterator[HardCase]:
    for name, offset in (("1e5", 1e5), ("1e6", 1e6), ("1e7", 1e7)):
        unit = float(np.spacing(np.float32(offset)))
        eye = np.full(3, offset)
        stage = Stage(perspective(near=unit, far=1024 * unit, eye=(offset,) * 3))
        for title, depth, half_x, half_y in (
            ("wall", 64, (-64, 64), (-64, 64)),
            ("front", 63, (0, 32), (-16, 16)),
            ("back", 65, (0, 32), (-16, 16)),
        ):
            x, y = half_x, half_y
            corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
            points = [eye + unit * np.array([*corner, -depth]) for corner in corners]
            stage.add(title, points, QUAD)
        yield stage.case(
            f"far-from-origin-{name}",
            """In units of one float32 step at that distance: a wall at depth 64, a card one step
            before it and a card one step behind it. The front card reaches from 0 to 8.1 half
            pixels right of the middle and 4.06 up and down. The vertices are judged as given:
            it is in front.""",
            seen("wall"),
            seen("front", x=(4, 7), y=(2, 5)),
        )


def planes() -> Iterator[HardCase]:
    stage = Stage(perspective(near=1e-3, far=1e7))
    far_off = 2.0**20
    stage.card("at-2e-3", 2.0**-9, (-1.0, 1.5), (-1.0, 8.0))
    stage.card("at-1", 1.0, (1.5, 3.5), (-1.0, 8.0))
    stage.card("at-1e6", far_off, (3.5, 5.5), (-1.0, 8.0))
    stage.card("one-step-behind", far_off + 0.125, (3.75, 5.25), (-0.5, 7.5), rounded=True)
    stage.wall("at-8e6", 2.0**23)
    yield stage.case(
        "near-far-ratio-1e10",
        """Depths from 2e-3 to 8e6 under near 1e-3 and far 1e7; at 1e6 one card lies a float32
        step (1/8) behind another and is hidden by it, however coarse a depth buffer is there.""",
        seen("at-2e-3", x=(0, 1)),
        seen("at-1", x=(2, 3)),
        seen("at-1e6", x=(4, 5)),
        seen("at-8e6", x=(6, 7)),
    )

    for kind, camera in (
        ("perspective", perspective(near=4.0, far=16.0)),
        ("orthographic", orthographic(near=4.0, far=16.0)),
    ):
        stage = Stage(camera)
        rows = (-1.0, 8.0)
        stage.card("at-near", 4.0, (-1.0, 1.5), rows)
        stage.card("before-near", 4.0 - 2.0**-22, (1.75, 3.25), rows, rounded=True)
        stage.card("inside", 8.0, (1.5, 3.5), rows)
        stage.card("at-far", 16.0, (3.5, 5.5), rows)
        stage.card("beyond-far", 16.0 + 2.0**-19, (5.75, 7.25), rows, rounded=True)
        yield stage.case(
            f"at-near-and-far-{kind}",
            """The range is closed: cards exactly at near and at far count; one float32 step
            outside they do not, and hide nothing.""",
            seen("at-near", x=(0, 1)),
            seen("inside", x=(2, 3)),
            seen("at-far", x=(4, 5)),
        )

    # Row b of the image meets the floor at depth 16 / |b| times its distance below the eye.
    stage = Stage(perspective(far=8192.0))
    sheet = [(-4096.0, 0.0, -0.0625), (4096.0, 0.0, -0.0625)]
    sheet += [(4096.0, 0.0, -4096.0), (-4096.0, 0.0, -4096.0)]
    for name, y in (("cellar", -0.25 - 2.0**-25), ("floor", -0.25)):
        stage.add(name, np.add(sheet, (0.0, y, 0.0)), QUAD, rounded=True)
    yield stage.case(
        "grazing-floor",
        """A floor from under the eye to 4096 away, and another a float32 step below it. The
        rows under the horizon meet the floor at depths 4, 4/3, 4/5, 4/7, and then only the
        lower one.""",
        seen("floor", y=(4, 7)),
    )

    stage = Stage(perspective(near=1.0))
    floor = [(-64, -0.25, 64), (64, -0.25, 64), (64, -0.25, -64), (-64, -0.25, -64)]
    stage.add("floor", floor, QUAD)
    stage.wall("wall", 8.0)
    yield stage.case(
        "near-plane-crossing",
        """A floor that reaches from behind the eye to far before it meets the rows under the
        horizon at depths 4, 4/3, 4/5, 4/7; near is 1, so the last two see the wall behind.""",
        seen("wall"),
        seen("floor", y=(4, 5)),
    )

    stage = Stage(perspective(near=1.0))
    corners = [(-0.25, -0.25, -2.0), (0.25, -0.25, -2.0), (0.0, -0.25, 62.0)]
    stage.add("mostly-behind", corners, [[0, 1, 2]])
    stage.wall("wall", 8.0)
    yield stage.case(
        "near-plane-crossing-narrow",
        """A triangle in the plane y = -1/4, from depth 2 to far behind the eye. Of the rows
        under the horizon (depths 4, 4/3, 4/5, 4/7) only the second is beyond near, 1, and
        within the triangle; there it is 0.247 wide on each side, and the columns lie at odd
        multiples of 1/12: the middle two are its only samples.""",
        seen("wall"),
        seen("mostly-behind", x=(3, 4), y=(5, 5)),
    )


def eyes() -> Iterator[HardCase]:
    stage = Stage(perspective(near=2.0**-10))
    stage.add("facing", [(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)], QUAD)
    stage.add("tilted", [(-4, -4, 4), (4, -4, 4), (4, 4, -4), (-4, 4, -4)], QUAD)
    stage.wall("wall", 8.0)
    yield stage.case(
        "eye-on-surface",
        """The eye lies on two sheets, one facing it and one tilted; every ray meets them at
        depth 0, before near, or not at all.""",
        seen("wall"),
    )

    corners = [(x, y, z) for z in (-4, 4) for y in (-4, 4) for x in (-4, 4)]
    for name, cull in (("two-sided", False), ("culled", True)):
        stage = Stage(perspective())
        stage.add("box", corners, BOX, material=ONE_SIDED)
        stage.wall("outside", 16.0)
        what = (
            "The eye is inside a box whose back faces are culled: it neither shows nor hides."
            if cull
            else "The eye is inside a two-sided box: its inside is all that is seen."
        )
        yield stage.case(
            f"eye-inside-{name}", what, seen("outside" if cull else "box"), cull_backfaces=cull
        )


def viewports() -> Iterator[HardCase]:
    stage = Stage(perspective(1, 1))
    stage.card("dot", 8.0, (-0.25, 0.25), (-0.25, 0.25))
    stage.wall("behind", 16.0)
    yield stage.case("viewport-1x1", "One sample, owned by a card about it.", seen("dot"))

    stage = Stage(perspective(1, 4096))
    for k in range(16):
        stage.card(f"step-{k:02d}", 8.0 + k, (-1.0, 1.0), (256 * k - 0.5, 256 * k + 255.5))
    yield stage.case(
        "viewport-1x4096",
        "Sixteen cards of 256 rows each, none at the same depth, in a column of samples.",
        *(seen(f"step-{k:02d}", y=(256 * k, 256 * k + 255)) for k in range(16)),
    )

    stage = Stage(perspective(641, 479))
    stage.wall("wall", 16.0, rounded=True)
    for name, x, y in (
        ("middle", (99.5, 540.5), (99.5, 378.5)),
        ("last-column", (639.5, 700.0), (-1.0, 479.0)),
        ("last-row", (-1.0, 300.5), (477.5, 500.0)),
    ):
        stage.card(name, 8.0, x, y, rounded=True)
    yield stage.case(
        "viewport-641x479",
        """Cards whose sides lie half a pixel from any sample, in an image of odd sides: one in
        the middle, one on the last column, one on the last row.""",
        seen("wall"),
        seen("middle", x=(100, 540), y=(100, 378)),
        seen("last-column", x=(640, 640)),
        seen("last-row", x=(0, 300), y=(478, 478)),
    )


def classics() -> Iterator[HardCase]:
    stage = Stage(perspective(64, 64))
    stage.card("left", 8.0, (-1.0, 31.5), (-1.0, 64.0))
    stage.card("right", 8.0, (32.5, 64.0), (-1.0, 64.0))
    stage.card("behind", 16.0, (31.75, 32.25), (39.75, 40.25))
    yield stage.case(
        "narrow-gap",
        """A gap of one column between two occluders, far narrower than a low-resolution
        buffer's texel; the small object seen through it owns one sample.""",
        seen("left", x=(0, 31)),
        seen("right", x=(33, 63)),
        seen("behind", x=(32, 32), y=(40, 40)),
    )

    stage = Stage(perspective(64, 64))
    for name, x, y in (
        ("above", (-1.0, 64.0), (-1.0, 20.5)),
        ("below", (-1.0, 64.0), (21.5, 64.0)),
        ("left", (-1.0, 40.5), (20.5, 21.5)),
        ("right", (41.5, 64.0), (20.5, 21.5)),
    ):
        stage.card(name, 8.0, x, y)
    stage.wall("behind", 16.0)
    yield stage.case(
        "pinhole",
        "Four occluders leave a hole of one sample, through which the object behind is seen.",
        seen("above", y=(0, 20)),
        seen("below", y=(22, 63)),
        seen("left", x=(0, 40), y=(21, 21)),
        seen("right", x=(42, 63), y=(21, 21)),
        seen("behind", x=(41, 41), y=(21, 21)),
    )

    stage = Stage(perspective(32, 8))
    stage.card("large", 4.0, (28.5, 200.0), (-50.0, 58.0))
    stage.card("small", 5.0, (27.5, 32.0), (-1.0, 8.0))
    yield stage.case(
        "large-object-at-edge",
        """A large object at view depth 4 reaches in from the right; a small one at depth 5 lies
        about its visible part. Its nearest point in sight is 7.6 from the eye, so whoever
        compares that distance with depth 5 culls it; by view depth it is in front.""",
        seen("small", x=(28, 28)),
        seen("large", x=(29, 31)),
    )


def lens_shift() -> Iterator[HardCase]:
    stage = Stage(perspective())
    stage.card("card", 8.0, (1.5, 4.5), (2.5, 5.5))
    stage.camera = replace(stage.camera, shift_x_px=0.75, shift_y_px=-0.25)
    yield stage.case(
        "lens-shift",
        """A card from 1.5 to 4.5 and 2.5 to 5.5 in pixels, seen through a lens shifted by 0.75
        and -0.25: samples lie at x + 0.75 and y - 0.25.""",
        seen("card", x=(1, 3), y=(3, 5)),
    )
