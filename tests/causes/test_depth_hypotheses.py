"""Wrong tests of what hides things: which objects of small scenes each would drop."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from math import sqrt

import numpy as np
import pytest

from tests.causes.small import (
    Stage,
    at,
    block,
    cases_of,
    check,
    claims,
    named,
    names,
    plain,
    sheet,
    straight,
    wide,
)
from visref.camera import look_at
from visref.causes.sights import OWN_TOO
from visref.conformance.building import box, case, panel, pixel_panel, together
from visref.scene import Alpha

# Which depth is compared.


def before_a_wall():
    """The wall stands at 10. 'deep' is from 8 to 14, its centre at 11; 'shallow' from 8 to 11, its
    centre at 9.5; 'thin' from 8 to 9; 'beside' reaches farther, where no wall is."""
    view = plain()
    return Stage(
        case(
            [
                ("wall", sheet(view, (1, 24), (1, 22), 10.0)),
                ("deep", block(view, (4.7, 8.3), (4.7, 8.3), (8.0, 14.0))),
                ("shallow", block(view, (12.7, 16.3), (4.7, 8.3), (8.0, 11.0))),
                ("thin", block(view, (4.7, 8.3), (12.7, 16.3), (8.0, 9.0))),
                ("beside", block(view, (27.7, 30.3), (4.7, 8.3), (8.0, 30.0))),
            ],
            [view],
        )
    )


def aside_of_the_axis():
    """The wall stands at 10, everything else at 9 to 9.5.

    'aside': its nearest point is (6, 0, 9), sqrt(117) = 10.8 away, its centre 11.3; there the wall
    is sqrt(1 + 0.63^2) = 1.18 times as far away as it is deep, and 10 / 1.18 < 9.
    'across': nearest (0, 2, 9), 9.2 away, its centre 9.6, its nearest corner (6, 2, 9), 11; where x
    is 0 the wall is 1.03 times as far as deep, and 10 / 1.03 > 9.
    'ahead': all within 9.6."""
    return Stage(
        case(
            [
                ("wall", panel((-20.0, 20.0), (-20.0, 20.0), -10.0)),
                ("aside", straight((6.0, 7.0), (-0.5, 0.5), (9.0, 9.5))),
                ("across", straight((-6.0, 6.0), (2.0, 3.0), (9.0, 9.5))),
                ("ahead", straight((-0.5, 0.5), (-0.5, 0.5), (9.0, 9.5))),
            ],
            [wide()],
        )
    )


def turned_fence():
    """Seen 30 degrees to the right of -Z; depth is x / 2 - z sqrt(3) / 2. The screen is at 6.3. The
    fence's left end, at (-3, -8.2), is at 5.6; its nearest point (0, 0, -8.2) is 8.2 away, and its
    depth is 7.1."""
    ahead, right = np.array([0.5, 0.0, -sqrt(0.75)]), np.array([sqrt(0.75), 0.0, 0.5])
    view = replace(wide(96, 48), world_from_camera=look_at((0, 0, 0), tuple(ahead)))
    up = np.array([0.0, 20.0, 0.0])
    corners = [
        6.3 * ahead + a * 20.0 * right + b * up for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return Stage(
        case(
            [
                ("screen", (np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]))),
                ("fence", box((-3.0, -1.0, -8.6), (8.0, 1.0, -8.2))),
                ("lamp", box((0.9, 0.3, -3.2), (1.2, 0.7, -2.9))),
            ],
            [view],
        )
    )


def touching():
    """'poster' lies in the plane of a wall that is larger, 'backdrop' fills the image, and
    nothing is behind it."""
    view = plain()
    return Stage(
        case(
            [
                ("backdrop", sheet(view, (0, 31), (0, 23), 50.0)),
                ("wall", sheet(view, (2, 16), (2, 16), 10.0)),
                ("poster", sheet(view, (5, 9), (5, 9), 10.0)),
                ("post", sheet(view, (22, 25), (5, 9), 10.0)),
            ],
            [view],
        )
    )


def nothing_drawn():
    """Something crosses the near plane, and is all that was drawn."""
    objects = [
        ("ground", straight((-5.0, 5.0), (-2.0, -1.0), (-3.0, 20.0))),
        ("post", straight((-1.0, 1.0), (0.0, 1.0), (5.0, 6.0))),
    ]
    return Stage(case(objects, [wide()]), drawn={(0, ""): ["ground"]})


def something_drawn():
    return replace(nothing_drawn(), drawn={(0, ""): ["ground", "post"]})


DEPTHS = [
    *claims(
        before_a_wall,
        "centre-depth: -> deep",
        "farthest-depth: -> deep shallow",
        # All but the last are before the wall wherever they are.
        "depth-not-compared: -> deep shallow thin",
        "euclidean-depth: against far ->",
    ),
    *claims(
        aside_of_the_axis,
        "euclidean-depth: nearest point; nearest point, whole pixels; centre -> aside",
        "euclidean-depth: occluders -> aside",
        "euclidean-depth: nearest corner -> aside across",
        "euclidean-depth: depth of the nearest point ->",
        "euclidean-depth: depth of the nearest point, whole pixels ->",
    ),
    *claims(
        turned_fence,
        "euclidean-depth: depth of the nearest point -> fence",
        "euclidean-depth: depth of the nearest point, whole pixels -> fence",
        "euclidean-depth: nearest point -> fence",
    ),
    *claims(touching, "own-depth: own -> backdrop poster", "own-depth: equal -> poster"),
    *claims(nothing_drawn, "own-depth: samples -> post"),
    *claims(something_drawn, "own-depth: samples -> post"),
]


# Which samples are asked.


def windows():
    """The wall hides what is behind it but for windows. Each thing is 5 by 5 pixels and its
    rectangle, rounded outward, 7 by 7.

    'edge' shows in its last column, 'middle' in its midmost pixel, 'rest' in a pixel that is
    neither in a corner of the rectangle nor its middle, 'open' all over."""
    view = plain()
    holes = [((6, 7), (1, 7)), ((14, 14), (4, 4)), ((23, 23), (3, 3)), ((2, 8), (14, 20))]
    places = {"edge": (2, 2), "middle": (12, 2), "rest": (22, 2), "open": (3, 15)}
    things = [
        (name, pixel_panel(view, (x - 0.3, x + 4.3), (y - 0.3, y + 4.3), 20.0))
        for name, (x, y) in places.items()
    ]
    return Stage(case([("wall", sheet(view, (0, 31), (0, 23), 10.0, but=holes)), *things], [view]))


def at_the_rim():
    """The wall leaves the last row and the last column of the image free: there, and only there,
    'low' and 'right' show, which reach beyond it. 'front' stands before the wall."""
    view = plain()
    return Stage(
        case(
            [
                ("wall", sheet(view, (0, 30), (0, 22), 10.0)),
                ("low", pixel_panel(view, (2.7, 6.3), (18.7, 30.3), 20.0)),
                ("right", pixel_panel(view, (27.7, 40.3), (2.7, 6.3), 20.0)),
                ("front", pixel_panel(view, (12.7, 16.3), (5.7, 9.3), 5.0)),
            ],
            [view],
        )
    )


def between_samples():
    """'sliver' holds no sample: its rectangle of whole pixels is empty."""
    view = plain()
    objects = [
        ("sliver", pixel_panel(view, (4.2, 4.8), (4.7, 9.3), 9.0)),
        ("sheet", pixel_panel(view, (8.2, 12.8), (4.7, 9.3), 9.0)),
    ]
    return Stage(case(objects, [view]))


def margins():
    """'wide', 13 pixels across, shows in the two at its right; the half of it about its middle are
    the pixels 5 to 10."""
    view = plain()
    wall = sheet(view, (0, 31), (0, 23), 10.0, but=[((12, 13), (1, 8)), ((20, 26), (1, 8))])
    return Stage(
        case(
            [
                ("wall", wall),
                ("wide", pixel_panel(view, (1.7, 13.3), (2.7, 6.3), 20.0)),
                ("open", pixel_panel(view, (20.7, 24.3), (2.7, 6.3), 20.0)),
            ],
            [view],
        )
    )


def diagonal():
    """'block' reaches from (-4, -4) to (4, 4), from depth 5 to 20: its face to either side to
    0.8 of the depth, its least corner, at the back, to -0.2. A screen at 4 leaves all left of
    -0.4 free, which is 14 of the 48 pixels."""
    view = wide()
    return Stage(
        case(
            [
                ("screen", pixel_panel(view, (13.9, 60.0), (-9.0, 60.0), 4.0)),
                ("block", straight((-4.0, 4.0), (-4.0, 4.0), (5.0, 20.0))),
                ("front", straight((0.5, 1.0), (0.5, 1.0), (2.0, 3.0))),
            ],
            [view],
        )
    )


SAMPLES = [
    *claims(
        windows,
        "few-samples: middle -> edge rest",
        "few-samples: corners -> middle rest",
        "few-samples: five -> rest",
        # The pixels wholly within a thing are its 3 by 3 midmost.
        "rectangle-too-small: inward -> edge",
        "rectangle-too-small: a row less; a column less; both less; rounded; two corners ->",
    ),
    *claims(
        at_the_rim,
        "rectangle-too-small: a row less -> low",
        "rectangle-too-small: a column less -> right",
        "rectangle-too-small: both less -> low right",
    ),
    *claims(between_samples, "rectangle-too-small: rounded -> sliver", seen=False),
    *claims(margins, "rectangle-too-small: half; upper left quarter; lower left quarter -> wide"),
    *claims(diagonal, "rectangle-too-small: two corners -> block"),
]


# Texels. `n` pixels a side each, of an image of 64 by 64 pixels unless it is odd.

SIZES = (2, 4, 8, 16)


@cache
def stage(make, *args):
    """The same function for the same arguments, by a name that says them."""
    built = partial(make, *args)
    built.__name__ = "_".join([make.__name__, *map(str, args)])
    return built


def slit(n, column, depth=20.0, side=64):
    """A wall at 10 with a slit of one column, counted from texel 2, through which 'upper' shows;
    before 'lower' whole texels of it are missing."""
    view = plain(side, 64)
    at_column = 2 * n + column
    wall = sheet(
        view, (0, side - 1), (0, 63), 10.0, but=[((at_column,) * 2, (2, 28)), ((16, 47), (32, 63))]
    )
    return Stage(
        case(
            [
                ("wall", wall),
                ("upper", pixel_panel(view, (1.7, side - 2.7), (1.7, 28.3), depth)),
                ("lower", pixel_panel(view, (1.7, side - 2.7), (33.7, 60.3), depth)),
            ],
            [view],
        )
    )


def narrow_slit(n):
    """The slit is 0.6 of a pixel wide, about the samples of a column. Those of an image of 1/n
    lie at n i + (n - 1) / 2, between columns."""
    view = plain(64, 64)
    column = 2 * n
    wall = together(
        pixel_panel(view, (-1.0, column - 0.3), (-1.0, 31.5), 10.0),
        pixel_panel(view, (column + 0.3, 65.0), (-1.0, 31.5), 10.0),
    )
    return Stage(
        case(
            [
                ("wall", wall),
                ("upper", pixel_panel(view, (1.7, 61.3), (1.7, 28.3), 20.0)),
                ("lower", pixel_panel(view, (1.7, 61.3), (33.7, 60.3), 20.0)),
            ],
            [view],
        )
    )


def last_tile():
    """Tiles of 4 end at column 68 and row 64, those of 8, 16, 32 and 64 at 64. 'edge' shows in the
    last two columns, 'foot' in the last row, 'head' in the first, 'across' from the middle to the
    last column."""
    view = plain(70, 65)
    return Stage(
        case(
            [
                ("edge", sheet(view, (68, 69), (3, 9), 10.0)),
                ("foot", sheet(view, (3, 9), (64, 64), 10.0)),
                ("head", sheet(view, (3, 9), (0, 0), 10.0)),
                ("across", sheet(view, (40, 69), (20, 29), 10.0)),
            ],
            [view],
        )
    )


def whole_tiles():
    return Stage(case([("sheet", sheet(plain(64, 64), (63, 63), (3, 9), 9.0))], [plain(64, 64)]))


def odd_side(n):
    """The image is 67 pixels wide, of which 3 (of texels of 2: 1) are no whole texel; 'upper'
    shows in the last."""
    view = plain(67, 64)
    wall = sheet(view, (0, 66), (0, 63), 10.0, but=[((66, 66), (0, 31)), ((16, 47), (32, 63))])
    return Stage(
        case(
            [
                ("wall", wall),
                ("upper", pixel_panel(view, (30.7, 80.0), (1.7, 28.3), 20.0)),
                ("lower", pixel_panel(view, (1.7, 61.3), (33.7, 60.3), 20.0)),
            ],
            [view],
        )
    )


def bars(n):
    """Every n-th column of 'upper', and so a pixel of each row of each texel, is behind a bar."""
    view = plain(64, 64)
    grid = together(*(sheet(view, (x, x), (0, 31), 10.0) for x in range(0, 64, n)))
    return Stage(
        case(
            [
                ("bars", grid),
                ("upper", pixel_panel(view, (1.7, 61.3), (1.7, 28.3), 20.0)),
                ("lower", pixel_panel(view, (1.7, 61.3), (33.7, 60.3), 20.0)),
            ],
            [view],
        )
    )


def shown_at_an_end(n, column):
    """'square' is 1.7 to 3 n + 2.3 across: wholly within it are the texels 1 and 2 (of 2: 2 and 3).
    One column of the wall is missing."""
    view = plain(64, 64)
    wall = sheet(view, (0, 63), (0, 63), 10.0, but=[((column, column), (0, 63))])
    square = pixel_panel(view, (1.7, 3 * n + 2.3), (1.7, 3 * n + 2.3), 20.0)
    return Stage(case([("wall", wall), ("square", square)], [view]))


def begins_past_the_middle(n, column):
    """'square' begins just before pixel n / 2 of the first texel: rounded, its rectangle begins
    with the second."""
    view = plain(64, 64)
    wall = sheet(view, (0, 63), (0, 63), 10.0, but=[((column, column), (0, 63))])
    side = (n / 2 - 0.3, 3 * n + 0.3)
    return Stage(case([("wall", wall), ("square", pixel_panel(view, side, side, 20.0))], [view]))


def too_small_an_image():
    view = plain(24, 24)
    return Stage(case([("sheet", sheet(view, (3, 9), (3, 9), 9.0))], [view]))


TEXELS = [
    claim
    for n in SIZES
    for claim in [
        *(
            claim
            for how, own in (("first", 0), ("middle", n // 2), ("last", n - 1))
            for column in sorted({0, n // 2, n - 1})
            for claim in claims(
                stage(slit, n, column),
                f"coarse-depth-1/{n}: {how} -> {'' if column == own else 'upper'}",
            )
        ),
        # The mean of 10, n - 1 times, and the 60 of what shows: at most 35.
        *claims(
            stage(slit, n, 0, 60.0), f"coarse-depth-1/{n}: mean; mean of window depth -> upper"
        ),
        *claims(stage(narrow_slit, n), f"coarse-depth-1/{n}: smaller image -> upper"),
        *claims(stage(odd_side, n), f"odd-size-pyramid: texels of {n} -> upper"),
        *claims(stage(slit, n, 0), f"odd-size-pyramid: texels of {n} -> says nothing"),
        *claims(
            stage(bars, n),
            f"nearest-of-region: texels of {n} -> upper",
            "nearest-of-region: rectangle -> upper",
        ),
        *claims(
            stage(shown_at_an_end, n, 3 * n + 2),
            f"rectangle-too-small: texels of {n} inward -> square",
        ),
        *claims(stage(shown_at_an_end, n, 2 * n), f"rectangle-too-small: texels of {n} inward ->"),
        *claims(
            stage(begins_past_the_middle, n, n // 2),
            f"rectangle-too-small: texels of {n} rounded -> square",
        ),
        *claims(
            stage(begins_past_the_middle, n, 2 * n),
            f"rectangle-too-small: texels of {n} rounded ->",
        ),
    ]
] + claims(
    too_small_an_image,
    "coarse-depth-1/16: first; middle; last; mean; smaller image -> says nothing",
)


# Depths that are mirrored, rounded, spread or not there.


def one_quarter():
    """A wall in the upper left quarter, and a sheet in each of the others that nothing hides."""
    view = plain()
    return Stage(
        case(
            [
                ("wall", sheet(view, (0, 15), (0, 11), 10.0)),
                ("upper_right", sheet(view, (22, 26), (3, 7), 20.0)),
                ("lower_left", sheet(view, (5, 9), (16, 20), 20.0)),
                ("lower_right", sheet(view, (22, 26), (16, 20), 20.0)),
                ("front", sheet(view, (5, 9), (3, 7), 5.0)),
            ],
            [view],
        )
    )


def depth_of(step, bits, near=0.1, far=100.0):
    """The depth whose window depth, 0 at near and 1 at far, is so many of 2^bits - 1 steps."""
    window = step / (2**bits - 1)
    return 1.0 / (1.0 / near - window * (1.0 / near - 1.0 / far))


def steps(bits, step):
    """Walls 0.4 and 0.6 of a step behind a whole one, each with a sheet 0.2 behind it: rounded down
    both walls come before their sheets, rounded to the nearest the first alone."""
    view = wide(far=100.0)
    sides = {"down": ((2.7, 21.3), 0.6), "both": ((26.7, 45.3), 0.4)}
    objects = [("front", pixel_panel(view, (20.7, 27.3), (30.7, 40.3), depth_of(step - 3, bits)))]
    for name, (columns, share) in sides.items():
        first, last = columns
        objects += [
            (f"{name}_wall", pixel_panel(view, columns, (2.7, 45.3), depth_of(step + share, bits))),
            (
                name,
                pixel_panel(view, (first + 4, last - 4), (6.7, 20.3), depth_of(step + 0.2, bits)),
            ),
        ]
    return Stage(case(objects, [view]))


def no_near_plane_to_round_from():
    return Stage(case([("sheet", sheet(plain(), (3, 9), (3, 9), 9.0))], [plain()]))


def gaps():
    """'narrow' shows through a gap of two columns, each beside the wall; 'wider' through five."""
    view = plain()
    wall = sheet(view, (0, 31), (0, 23), 10.0, but=[((6, 7), (0, 11)), ((16, 20), (0, 11))])
    return Stage(
        case(
            [
                ("wall", wall),
                ("narrow", pixel_panel(view, (2.7, 11.3), (2.7, 8.3), 20.0)),
                ("wider", pixel_panel(view, (14.7, 22.3), (2.7, 8.3), 20.0)),
            ],
            [view],
        )
    )


def in_the_crook():
    """The corner's box, though not the corner, lies before 'nook'."""
    view = plain()
    corner = together(sheet(view, (1, 4), (1, 20), 10.0), sheet(view, (5, 20), (17, 20), 10.0))
    return Stage(
        case(
            [
                ("corner", corner),
                ("nook", sheet(view, (9, 14), (5, 11), 20.0)),
                ("beside", sheet(view, (24, 28), (5, 11), 20.0)),
            ],
            [view],
        )
    )


def before_nothing():
    view = plain()
    return Stage(
        case(
            [
                ("wall", sheet(view, (1, 12), (1, 20), 10.0)),
                ("front", sheet(view, (4, 8), (5, 9), 5.0)),
                ("alone", sheet(view, (20, 25), (5, 9), 5.0)),
            ],
            [view],
        )
    )


CHANGED = [
    *claims(
        one_quarter,
        "flipped: y -> lower_left",
        "flipped: x -> upper_right",
        "flipped: both -> lower_right",
    ),
    *(
        claim
        for bits, step in ((8, 253), (16, 65500))
        for claim in claims(
            stage(steps, bits, step),
            f"quantised-depth: {bits} bits, down -> down both",
            f"quantised-depth: {bits} bits, nearest -> both",
            # What is rounded alike stays in its order.
            f"quantised-depth: {bits} bits, down, box too; {bits} bits, nearest, box too ->",
        )
    ),
    *claims(
        gaps,
        "occluders-too-large: dilated -> narrow",
        "nearest-of-region: rectangle -> narrow wider",
    ),
    *claims(
        in_the_crook,
        "occluders-too-large: boxes; boxes before boxes -> nook",
        "occluders-too-large: dilated ->",
    ),
    # Behind the wall nothing is either, nor about 'front', but the wall.
    *claims(before_nothing, "empty-hides: -> wall alone", "depth-not-compared: -> front"),
]


# What counts as hiding.


def through_a_mask():
    """Half of a mask's texels might be holes, for all that is known of it."""
    view = plain()
    objects = [
        ("fence", sheet(view, (1, 12), (1, 20), 10.0)),
        ("behind", sheet(view, (4, 8), (5, 9), 20.0)),
        ("beside", sheet(view, (20, 25), (5, 9), 20.0)),
    ]
    return Stage(case(objects, [view], alpha={"fence": Alpha.MASK}))


def through_glass():
    view = plain()
    objects = [
        ("pane", sheet(view, (1, 12), (1, 20), 10.0)),
        ("behind", sheet(view, (4, 8), (5, 9), 20.0)),
        ("beside", sheet(view, (20, 25), (5, 9), 20.0)),
    ]
    return Stage(case(objects, [view], alpha={"pane": Alpha.BLEND}))


def before_near():
    """The lid is between the eye and the near plane, and cut away."""
    view = wide(near=1.0)
    return Stage(
        case(
            [
                ("lid", panel((-0.3, 0.0), (-0.3, 0.3), -0.5)),
                ("behind", panel((-3.0, -1.0), (-2.0, 2.0), -8.0)),
                ("beside", panel((1.0, 3.0), (-2.0, 2.0), -8.0)),
                ("far_wall", panel((-30.0, 30.0), (-30.0, 30.0), -20.0)),
            ],
            [view],
        )
    )


def before_the_clip_plane():
    """Only z < -5 counts: -z - 5 >= 0."""
    view = plain(clip_plane=(0.0, 0.0, -1.0, -5.0))
    objects = [
        ("lid", sheet(view, (1, 12), (1, 20), 3.0)),
        ("behind", sheet(view, (4, 8), (5, 9), 20.0)),
        ("beside", sheet(view, (20, 25), (5, 9), 20.0)),
    ]
    return Stage(case(objects, [view]))


def turned_round():
    """A one-sided screen that faces away hides nothing."""
    view = plain()
    points, faces = sheet(view, (1, 12), (1, 20), 10.0)
    objects = [
        ("screen", (points, faces[:, ::-1])),
        ("behind", sheet(view, (4, 8), (5, 9), 20.0)),
        ("beside", sheet(view, (20, 25), (5, 9), 20.0)),
    ]
    return Stage(case(objects, [view], one_sided=("screen",)))


OCCLUDERS = [
    *claims(
        through_a_mask,
        "masks-solid: boxes; samples -> behind",
        "glass-solid: boxes; samples -> says nothing",
        "back-faces: hide, by boxes; hide, by samples -> says nothing",
    ),
    *claims(
        through_glass,
        "glass-solid: boxes; samples -> behind",
        "masks-solid: boxes; samples -> says nothing",
    ),
    # The lid lies outside the view, whatever hides what.
    *claims(
        before_near, "wrong-occluder-clip: near, boxes; near, samples -> behind lid", seen=False
    ),
    *claims(
        before_the_clip_plane,
        "wrong-occluder-clip: clip plane, boxes; clip plane, samples -> behind",
    ),
    *claims(turned_round, "back-faces: hide, by boxes; hide, by samples -> behind"),
]


# How little is too little.


def holes():
    """Things of 5 by 5 pixels behind holes of 1, 3, 7 and 9."""
    view = plain()
    shapes = {
        "one": (2, [((3, 3), (3, 3))]),
        "three": (10, [((11, 13), (3, 3))]),
        "seven": (18, [((19, 21), (3, 4)), ((20, 20), (5, 5))]),
        "nine": (26, [((26, 28), (3, 5))]),
    }
    every = [hole for _, some in shapes.values() for hole in some]
    things = [
        (name, pixel_panel(view, (x - 0.3, x + 4.3), (1.7, 6.3), 20.0))
        for name, (x, _) in shapes.items()
    ]
    return Stage(case([("wall", sheet(view, (0, 31), (0, 23), 10.0, but=every)), *things], [view]))


FEW = claims(
    holes,
    "too-few-samples: 2 owned; 2 passing -> one",
    "too-few-samples: 4 owned; 4 passing -> one three",
    "too-few-samples: 8 owned; 8 passing -> one three seven",
)

TILES = [
    *claims(
        last_tile,
        "odd-size-pyramid: tiles of 4; tiles of 8; tiles of 16 -> edge foot",
        "odd-size-pyramid: tiles of 32; tiles of 64 -> edge foot",
        # From below the first row is left out in place of the last.
        "odd-size-pyramid: tiles of 4, from below; tiles of 8, from below -> edge head",
        "odd-size-pyramid: tiles of 16, from below; tiles of 32, from below -> edge head",
        "odd-size-pyramid: tiles of 64, from below -> edge head",
    ),
    *claims(whole_tiles, "odd-size-pyramid: tiles of 4; tiles of 32; tiles of 64 -> says nothing"),
]


def plugged():
    """'plug', from 8 to 12, fills a hole of 4 by 4 pixels in a wall at 9.5, behind which nothing
    is. Of its rectangle the rim is wall and the rest its own front, at 8: both lie before its
    middle. Without its own depth one sees through the hole."""
    view = plain()
    return Stage(
        case(
            [
                ("wall", sheet(view, (0, 31), (0, 23), 9.5, but=[((5, 8), (5, 8))])),
                ("plug", block(view, (4.5, 8.5), (4.5, 8.5), (8.0, 12.0))),
            ],
            [view],
        )
    )


OWN = [
    *claims(
        plugged,
        "centre-depth: -> ",
        "farthest-depth: -> ",
        f"centre-depth: {OWN_TOO} -> plug",
        f"farthest-depth: {OWN_TOO} -> plug",
        f"few-samples: middle{OWN_TOO} -> ",
    ),
]

CLAIMS = [*DEPTHS, *SAMPLES, *TEXELS, *TILES, *OWN, *CHANGED, *OCCLUDERS, *FEW]
UNSEEN = {"sliver", "lid", "screen"}


@pytest.mark.parametrize("claimed", cases_of(CLAIMS), ids=named)
def test_wrong_test_of_what_hides_drops_what_it_would(claimed):
    check(*claimed)


@pytest.mark.parametrize(
    "build", {c.build.__name__: c.build for c in CLAIMS}.values(), ids=lambda b: b.__name__
)
def test_every_object_of_these_scenes_shows(build):
    asked = at(build)
    assert names(asked, ~asked.now.seen) <= UNSEEN
