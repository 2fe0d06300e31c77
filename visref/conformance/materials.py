"""Conformance scenes built around materials: glass, alpha masks, sides."""

from __future__ import annotations

import numpy as np

from visref.conformance.building import (
    Case,
    Cutout,
    SceneMaker,
    box,
    camera,
    case,
    cut_out,
    panel,
    pixel_panel,
    register_in,
)
from visref.scene import Alpha

MATERIALS: list[SceneMaker] = []

_scene = register_in(MATERIALS)

# Of a panel: lower left, lower right, upper right, upper left; v points down.
_CORNER_UV = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
_CHECKERED = ((np.indices((4, 4)).sum(axis=0) % 2 == 0) * np.uint8(255)).astype(np.uint8)


@_scene("what lies behind glass is drawn, and the glass too", "transparent occluder")
def glass(rng: np.random.Generator) -> Case:
    objects = [
        ("window", panel((-2.0, 2.0), (-1.5, 1.5), -4.0)),
        ("wall", panel((2.0, 6.0), (-3.0, 3.0), -4.5)),
        ("hidden", box((3.0, -1.0, -8.0), (4.0, 1.0, -7.0))),
        ("glass behind the wall", panel((2.6, 4.0), (-1.0, 1.0), -6.0)),
        ("mesh fence", panel((-6.0, -2.4), (-3.0, 0.0), -4.2)),
    ]
    for _ in range(6):
        centre = rng.uniform((-2.0, -1.0, -12.0), (1.0, 1.0, -6.0))
        objects.append(("vase", box(centre - 0.4, centre + 0.4)))
    materials = {
        "window": Alpha.BLEND,
        "glass behind the wall": Alpha.BLEND,
        "mesh fence": Alpha.MASK,
    }
    built = case(objects, [camera(), camera((1.0, 0.4, 1.0))], alpha=materials)
    # Texels far smaller than pixels: a sample of the fence may be solid, and may be a hole.
    return cut_out(built, {"mesh fence": Cutout(64.0 * _CORNER_UV, _CHECKERED[:2, :2], False)})


@_scene("a one-sided wall seen from behind hides nothing", "back faces as occluders")
def one_sided_walls(rng: np.random.Generator) -> Case:
    corners, faces = panel((-3.0, 3.0), (-2.0, 2.0), -5.0)
    objects = [
        ("away", (corners, faces[:, ::-1])),
        ("facing", panel((3.0, 8.0), (-3.0, 3.0), -6.0)),
        ("shell", box((-1.0, -1.0, -12.0), (1.0, 1.0, -9.0))),
        ("in the shell", box((-0.3, -0.3, -11.0), (0.3, 0.3, -10.0))),
        ("seen", box((-3.0, -1.0, -9.0), (-1.5, 1.0, -8.0))),
        ("hidden", box((4.0, -1.0, -9.0), (5.0, 1.0, -8.0))),
    ]
    views = [
        camera(),
        camera((0.0, 0.0, -20.0), (0.0, 0.0, 0.0)),
        camera((0.0, 0.6, -9.5), (0.0, 0.3, -14.0)),
    ]
    views.append(camera((0.0, 0.6, -11.4), (0.0, 0.0, 0.0)))
    return case(objects, views, one_sided=("away", "facing", "shell"))


@_scene("what shows through a mask's holes is drawn, and the mask too", "masks taken for solid")
def through_the_holes_of_a_mask(rng: np.random.Generator) -> Case:
    """A card of 4 by 4 texels, each 12 pixels by 9, every second one a hole."""
    view = camera()
    left, top, texel = 8.0, 6.0, np.array([12.0, 9.0])
    card = pixel_panel(view, (left, left + 48.0), (top, top + 36.0), 5.0)
    objects = [("card", card)]
    for row in range(4):
        for column in range(4):
            x, y = np.array([left, top]) + texel * (column, row) + texel / 2
            x, y = x + rng.uniform(-2.0, 2.0), y + rng.uniform(-1.0, 1.0)
            name = "in a hole" if (row + column) % 2 else "hidden"
            depth = 8.0 + rng.uniform(0.0, 4.0)
            objects.append((name, pixel_panel(view, (x - 2.0, x + 2.0), (y - 1.5, y + 1.5), depth)))
    built = case(objects, [view], alpha={"card": Alpha.MASK})
    return cut_out(built, {"card": Cutout(_CORNER_UV, _CHECKERED)})


@_scene(
    "what shows through two masks, one behind the other, is drawn",
    "the second mask taken for solid, or for what the first leaves",
)
def masks_behind_masks(rng: np.random.Generator) -> Case:
    """Columns of 16 pixels, each solid in one of two cards, in both, or in neither; a plate behind
    each column, and one before the second card."""
    view = camera()
    columns = np.array([[0, 255, 255, 0], [0, 0, 255, 255]], np.uint8)
    objects = []
    for number, name in enumerate(("front card", "rear card")):
        objects.append((name, pixel_panel(view, (-0.5, 63.5), (3.5, 43.5), 5.0 + 2.0 * number)))
    for column in range(4):
        x, y = 16.0 * column + rng.uniform(3.0, 6.0), rng.uniform(6.0, 30.0)
        plate = pixel_panel(view, (x, x + 6.0), (y, y + 6.0), 9.0)
        objects.append((f"behind column {column}", plate))
    objects.append(("between", pixel_panel(view, (3.0, 8.0), (33.5, 40.5), 6.0)))
    objects.append(("between, hidden", pixel_panel(view, (20.0, 25.0), (33.5, 40.5), 6.0)))
    built = case(objects, [view], alpha={"front card": Alpha.MASK, "rear card": Alpha.MASK})
    cards = {
        name: Cutout(_CORNER_UV, columns[number : number + 1])
        for number, name in enumerate(("front card", "rear card"))
    }
    return cut_out(built, cards)


@_scene(
    "one-sided walls at the side of the image show by the ray to them",
    "facing asked of the view's axis, or of the eye in an orthographic view",
)
def one_sided_walls_at_the_side(rng: np.random.Generator) -> Case:
    """Two walls that stand almost along the view and stray from it as they recede. One has its
    front inside and shows in perspective; the other has it outside and shows to parallel rays."""
    stray = rng.uniform(1.0, 1.3)
    z, y = np.array([-4.0, -9.0, -9.0, -4.0]), np.array([-1.0, -1.0, 1.0, 1.0])
    x = np.array([3.0, 3.0 + stray, 3.0 + stray, 3.0])
    # One order of corners does for both, since they are mirror images.
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    objects = [
        ("front inside", (np.stack([-x, y, z], axis=1), faces)),
        ("front outside", (np.stack([x, y, z], axis=1), faces)),
    ]
    views = [camera(), camera(ymag=4.0)]
    return case(objects, views, one_sided=("front inside", "front outside"))
