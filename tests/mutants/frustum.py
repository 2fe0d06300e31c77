"""View-frustum culling with one step broken."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tests.mutants.common import common
from tests.mutants.harness import Suite, Trace, mutant, not_here
from visref_culling.baselines import FrustumCulling
from visref_culling.lazy_grid.nodes import corners_of

SUITE = Suite(
    {
        "U1": "the last frame's frustum",
        "U2": "lens shift left out",
        "U3": "centre of a box in place of the box",
        "U4": "a box of which no corner is in the view taken for one outside it",
        "W5": "only the side planes tested",
        "W6": "boxes as large as their spheres",
    },
    watched=("walk_through_a_city", "crowd", "object_crossing_the_near_plane"),
)
FRUSTUM = (SUITE.method("frustum", FrustumCulling),)
SUITE.kept_by(*FRUSTUM)

# How far an inflated box may reach beyond its geometry: a part of a pixel, and of its distance.
SLACK_PX = 0.02
SLACK = 1e-5

common("G10", of=FRUSTUM, caught_by="walk_through_a_city")
common("M1 M2 M5 M6", of=FRUSTUM)
not_here("G15 M3 M4", FRUSTUM, "no depth is compared: what is drawn hides nothing")
not_here("G2 G9 G12 G14", FRUSTUM, "nothing is asked")
not_here("G3", FRUSTUM, "planes are tested: no rectangle is rounded")
not_here("G5 G6 G7 G8 G11 G13", FRUSTUM, "no depth is compared, and none kept")


@SUITE.contract
def what_lies_wholly_beyond_a_plane_is_not_drawn(trace: Trace) -> Iterator[str]:
    """By the samples' definition, corner by corner."""
    camera = trace.camera
    for unit in trace.drawn:
        corners = np.array(list(itertools.product(*trace.scene.object_bounds[unit].T)))
        places, depth = camera.pixel_of(corners)
        reach = float(np.abs(corners - camera.eye).max()) * SLACK
        beyond = [depth < camera.near - reach, depth > camera.far + reach]
        if depth.min() > camera.near:
            low, high = -0.5 - SLACK_PX, np.array([camera.width, camera.height]) - 0.5 + SLACK_PX
            beyond += [*(places < low).T, *(places > high).T]
        if any(side.all() for side in beyond):
            yield f"unit {unit} lies outside the view and is drawn"


def in_planes(method, view, points, planes):
    """The units of whose points, (u, k, 3), no plane has all behind it."""
    relative = points - view.camera.eye
    behind = relative @ planes[:, :3].T + planes[:, 3] < 0.0
    return np.intersect1d(method.tree.ids, np.flatnonzero(~behind.all(axis=1).any(axis=1)))


@mutant("G1", of=FRUSTUM, caught_by="object_crossing_the_near_plane")
class CornersBehindTheEye:
    """Corners are divided by their w whatever its sign, and the rectangle around them tested."""

    def in_frustum(self, view):
        at = view.camera.pixel_of(corners_of(self.unit_boxes).reshape(-1, 3))[0].reshape(-1, 8, 2)
        low, high = at.min(axis=1), at.max(axis=1)
        size = (view.camera.width, view.camera.height)
        seen = ((high >= -0.5) & (low <= np.array(size) - 0.5)).all(axis=1)
        return np.intersect1d(self.tree.ids, np.flatnonzero(seen))


@mutant("G4", of=FRUSTUM, caught_by="rows_and_columns_at_the_border")
class LastRowAndColumnLeftOut:
    """The view ends a pixel too early at each side."""

    def in_frustum(self, view):
        planes = view.planes.copy()
        planes[:4] += -2.0 / view.camera.width * view.clip_from_relative[3]
        return in_planes(self, view, corners_of(self.unit_boxes), planes)


@mutant("U1", of=FRUSTUM, caught_by="fast_turn")
class FrustumOfTheLastFrame:
    """What the frame before had in view is drawn."""

    last = None

    def in_frustum(self, view):
        found = super().in_frustum(view)
        last, self.last = self.last, found
        return found if last is None else last


@mutant("U2", of=FRUSTUM, caught_by="beside_the_unshifted_view")
class LensShiftLeftOut:
    """The frustum is symmetric, whatever the lens."""

    def in_frustum(self, view):
        straight = replace(view.camera, shift_x_px=0.0, shift_y_px=0.0)
        return super().in_frustum(replace(view, camera=straight))


@mutant("U3", of=FRUSTUM, caught_by="large_object_at_the_edge")
class CentresAlone:
    """A box is in the view if its centre is."""

    def in_frustum(self, view):
        return in_planes(self, view, self.unit_boxes.mean(axis=1)[:, None], view.planes)


@mutant("U4", of=FRUSTUM, caught_by="eye_inside_an_object")
class NoCornerInView:
    """A box is in the view if one of its corners is."""

    def in_frustum(self, view):
        relative = corners_of(self.unit_boxes) - view.camera.eye
        inside = (relative @ view.planes[:, :3].T + view.planes[:, 3] >= 0.0).all(axis=2)
        return np.intersect1d(self.tree.ids, np.flatnonzero(inside.any(axis=1)))


@mutant("W5", of=FRUSTUM, contract="what_lies_wholly_beyond_a_plane_is_not_drawn")
class SidePlanesAlone:
    """What lies before the near plane or beyond the far one is drawn."""

    def in_frustum(self, view):
        return in_planes(self, view, corners_of(self.unit_boxes), view.planes[:4])


@mutant("W6", of=FRUSTUM, contract="what_lies_wholly_beyond_a_plane_is_not_drawn")
class SpheresForBoxes:
    """The sphere around a box is tested in place of the box."""

    def unit_bounds(self, scene, units):
        bounds = super().unit_bounds(scene, units)
        middle = bounds.mean(axis=1)
        radius = 0.5 * np.linalg.norm(bounds[:, 1] - bounds[:, 0], axis=1)[:, None]
        return np.stack([middle - radius, middle + radius], axis=1)
