"""The small scenes that convict broken lazy grids."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.mutants.lazy_grid.contract import SUITE
from visref.camera import Camera
from visref.conformance.scenes import Case, box, camera, case, panel, pixel_panel
from visref.conformance.scenes import together as merged
from visref.scene import Alpha

# Orthographic cameras have a world unit per pixel and the image's middle at the origin.


def flat(width: int = 64, height: int = 48, **changes: Any) -> Camera:
    values: dict[str, Any] = {"near": 1.0, "far": 100.0, "ymag": height / 2, **changes}
    return camera(width=width, height=height, **values)


@SUITE.scene("draws the poster before a slanted wall whose near end is nearer than the poster")
def poster_before_a_slanted_wall(rng: np.random.Generator) -> Case:
    wall = (
        np.array([[-30, -20, -4], [30, -20, -60], [30, 20, -60], [-30, 20, -4]], float),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    return case([("wall", wall), ("poster", panel((10, 20), (-5, 5), -20.0))], [flat()])


@SUITE.scene("draws what shows through a hole in a cell that is otherwise covered")
def behind_a_sieve(rng: np.random.Generator) -> Case:
    strips = [panel((-32 + 4 * k, -30 + 4 * k), (-24, 24), -5.0) for k in range(16)]
    return case([("sieve", merged(*strips)), ("wall", panel((-32, 32), (-24, 24), -9))], [flat()])


@SUITE.scene("forgets a wall that the next frame has turned away from")
def wall_that_goes_away(rng: np.random.Generator) -> Case:
    wall, poster = panel((-32, 32), (-24, 24), -5.0), panel((100, 110), (-5, 5), -9.0)
    return case(
        [("wall", wall), ("behind", panel((-9, 9), (-9, 9), -9)), ("poster", poster)],
        [flat(), camera((105.0, 0.0, 0.0), near=1.0, far=100.0, ymag=24.0)],
    )


@SUITE.scene("draws what shows in a corner of a cell after a box in its other corner was hidden")
def two_corners_of_a_cell(rng: np.random.Generator) -> Case:
    cells = [(x, y) for x in range(-32, 32, 8) for y in range(-24, 24, 8)]
    covers = [panel((x, x + 4), (y, y + 8), -5.0) for x, y in cells]
    hidden = [(f"hidden{x},{y}", panel((x + 1, x + 3), (y + 1, y + 7), -10.0)) for x, y in cells]
    seen = [(f"seen{x},{y}", panel((x + 5, x + 7), (y + 1, y + 7), -20.0)) for x, y in cells]
    return case([("covers", merged(*covers)), *hidden, *seen], [flat()])


@SUITE.scene("draws what shows in the last columns and rows of an image that ends within a cell")
def image_ends_within_a_cell(rng: np.random.Generator) -> Case:
    view = flat(61, 45)
    wall = pixel_panel(view, (-1.0, 55.5), (-1.0, 39.5), 5.0)
    right = pixel_panel(view, (57.0, 60.0), (3.0, 30.0), 9.0)
    low = pixel_panel(view, (3.0, 30.0), (41.0, 44.0), 9.0)
    behind = pixel_panel(view, (3.0, 50.0), (3.0, 30.0), 9.0)
    return case([("wall", wall), ("right", right), ("low", low), ("behind", behind)], [view])


@SUITE.scene("does not take glass for a wall")
def behind_glass(rng: np.random.Generator) -> Case:
    objects = [
        ("glass", panel((-32, 32), (-24, 24), -5.0)),
        ("poster", panel((-9, 9), (-9, 9), -9.0)),
    ]
    return case(objects, [flat()], alpha={"glass": Alpha.BLEND})


@SUITE.scene("draws a poster before a wall, in a cell where a box from nearer on was hidden")
def box_hidden_by_its_far_end(rng: np.random.Generator) -> Case:
    view = camera()
    # The wall goes first by its near corner. The box's side runs away from the eye: in the cell
    # from (40, 16) to (47, 23) it lies behind the wall, two cells on before it.
    wall = merged(panel((-7, 7), (-6, 6), -8.0), panel((-1.0, -0.9), (-0.9, -0.8), -2.0))
    side = box((3.0, -1.0, -40.0), (3.5, 1.0, -5.0))
    poster = pixel_panel(view, (41.0, 46.5), (17.0, 22.5), 6.0)
    return case([("wall", wall), ("side", side), ("poster", poster)], [view])
