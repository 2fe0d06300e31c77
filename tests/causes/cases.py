"""Six faults that public bug reports tell of, each on a scene of a few objects.

The cullers share nothing with `tests.wrong_cullers` and are made as plug-ins often are: the depth
of the whole scene is there first, cast sample by sample, and each box is held against it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from tests.causes.fault import Fault, Input
from visref.camera import Camera
from visref.conformance.building import Case, Mesh, box, camera, case, panel
from visref.culler import Culler, DrawnSet


def nearest_hits(scene, view: Camera):
    """(height, width) float64 view depths, inf for none, and the objects there, int32, -1."""
    corners = scene.vertices[scene.triangles].astype(np.float64)
    aside = (
        view.column_a[None, :, None] * view.right_step + view.row_b[:, None, None] * view.up_step
    )
    start, way = view.eye, view.forward + aside
    best = np.full(way.shape[:2], np.inf)
    owner = np.full(way.shape[:2], -1, np.int32)
    for (a, b, c), object_id in zip(corners, scene.object_of_triangle, strict=True):
        normal = np.cross(b - a, c - a)
        slope = way @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = ((a - start) @ normal) / slope
            point = start + depth[..., None] * way
            inside = (depth >= view.near) & (depth <= view.far) & (slope != 0.0)
            for p, q in ((a, b), (b, c), (c, a)):
                inside &= np.cross(q - p, point - p) @ normal >= 0.0
        nearer = inside & (depth < best)
        best[nearer], owner[nearer] = depth[nearer], object_id
    return best, owner


class Plain(Culler):
    """Boxes against the sides of the view."""

    name = "plain"

    def prepare(self, scene):
        self.scene, self.boxes = scene, scene.object_bounds
        return scene.object_units()

    def cull(self, view):
        self.look(view)
        kept = [o for o in range(self.scene.object_count) if self.keeps(view, self.boxes[o])]
        return DrawnSet(np.array(kept, np.int32))

    def look(self, view):
        """What is found out once a frame."""

    def keeps(self, view, bounds):
        x, y, depth = self.seen(view, bounds)
        if depth.min() < view.near:
            return True
        return x.max() >= -1 and x.min() <= 1 and y.max() >= -1 and y.min() <= 1

    def shift(self, view):
        """Of the lens, in half widths and half heights; up is positive."""
        return 2.0 * view.shift_x_px / view.width, -2.0 * view.shift_y_px / view.height

    def seen(self, view, bounds):
        """Of the eight corners, (8,) each: from -1 to 1 across the view and up it, and depth."""
        corners = np.array(
            [[bounds[i, 0], bounds[j, 1], bounds[k, 2]] for i, j, k in np.ndindex(2, 2, 2)]
        )
        right, up, back = view.world_from_camera[:3, :3].T
        depth = (view.eye - corners) @ back
        half = np.tan(view.yfov / 2.0)
        moved = self.shift(view)
        x = (corners - view.eye) @ right / (depth * half * view.width / view.height) - moved[0]
        y = (corners - view.eye) @ up / (depth * half) - moved[1]
        return x, y, depth


class OneCornerInView(Plain):
    """Keeps a box if one of its corners projects into the view."""

    def keeps(self, view, bounds):
        x, y, depth = self.seen(view, bounds)
        return bool(((abs(x) <= 1) & (abs(y) <= 1) & (depth >= view.near)).any())


class NothingBehindNear(Plain):
    """Leaves a box out that has a corner before the near plane."""

    def keeps(self, view, bounds):
        return super().keeps(view, bounds) and self.seen(view, bounds)[2].min() >= view.near


class SymmetricView(Plain):
    """Tests the view without its lens shift."""

    def shift(self, view):
        return 0.0, 0.0


class AgainstDepth(Plain):
    """The farthest depth of the rectangle around a box, and the least of the box."""

    def look(self, view):
        self.depth, self.owner = nearest_hits(self.scene, view)

    def least(self, view, bounds):
        return self.seen(view, bounds)[2].min()

    def keeps(self, view, bounds):
        x, y, depth = self.seen(view, bounds)
        if depth.min() < view.near or not super().keeps(view, bounds):
            return depth.min() < view.near
        height, width = self.depth.shape
        column = np.clip(np.floor((x + 1.0) / 2.0 * width), 0, width - 1).astype(int)
        row = np.clip(np.floor((1.0 - y) / 2.0 * height), 0, height - 1).astype(int)
        found = self.depth[row.min() : row.max() + 1, column.min() : column.max() + 1]
        return bool(found.max() >= self.least(view, bounds) - 1e-9)


class StraightestPoint(AgainstDepth):
    """Compares the depth of the box's point that is nearest to the eye by straight distance."""

    def least(self, view, bounds):
        return (np.clip(view.eye, bounds[0], bounds[1]) - view.eye) @ view.forward


class FrameLate(AgainstDepth):
    """Draws what it found in the frame before; in the first everything."""

    found = None

    def cull(self, view):
        now = super().cull(view)
        before, self.found = self.found, now
        return before or DrawnSet(np.arange(self.scene.object_count, dtype=np.int32))


class UnderEight(AgainstDepth):
    """Draws what owns eight samples or more."""

    def cull(self, view):
        self.look(view)
        owned = np.bincount(self.owner[self.owner >= 0], minlength=self.scene.object_count)
        return DrawnSet(np.flatnonzero(owned >= 8).astype(np.int32))


def big_floor() -> Case:
    """All corners of the floor lie far beyond the sides of the view, or behind the eye."""
    floor = (
        np.array(
            [
                [-300.0, -1.4, -260.0],
                [280.0, -1.4, -260.0],
                [280.0, -1.4, 310.0],
                [-300.0, -1.4, 310.0],
            ]
        ),
        np.array([[0, 2, 1], [0, 3, 2]]),
    )
    objects = [("floor", floor), ("stool", box((-0.6, -1.4, -7.0), (0.1, -0.5, -6.3)))]
    return case(objects, [camera(), camera((0.8, 0.0, -1.0), (0.4, -0.3, -8.0))])


def hedge_beside_the_eye() -> Case:
    """It runs from behind the eye into the view."""
    objects: list[tuple[str, Mesh]] = [
        ("hedge", box((-1.1, -0.8, -15.0), (-0.7, 0.7, 6.0))),
        ("gate", panel((-3.0, 3.5), (-2.0, 2.0), -18.0)),
        ("shed", box((1.0, -0.8, -12.0), (2.2, 0.9, -10.5))),
    ]
    return case(objects, [camera(), camera((0.3, 0.1, -2.0))])


def fence_behind_a_screen() -> Case:
    """Seen 30 degrees to the right of the fence's normal, its left end comes before the screen. Its
    point straight ahead of its plane lies at a depth of 8.2 cos 30, which is behind it."""
    view = camera(
        target=(0.5, 0.0, -np.sqrt(0.75)), width=120, height=60, yfov=2.0 * np.arctan(0.75)
    )
    right, ahead = view.world_from_camera[:3, 0], view.forward
    middle, up = 6.3 * ahead, np.array([0.0, 1.0, 0.0])
    screen = (
        np.array(
            [middle + 12.0 * (a * right + b * up) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        ),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    objects = [
        ("screen", screen),
        ("fence", box((-3.0, -1.0, -8.6), (8.0, 1.0, -8.2))),
        ("lamp", box((0.9, 0.3, -3.2), (1.2, 0.7, -2.9))),
        ("hidden", box((2.0, -0.5, -14.0), (3.0, 0.5, -13.0))),
    ]
    return case(objects, [view])


def past_a_corner() -> Case:
    """The eye passes the wall's end, and one after the other what stands behind it shows."""
    objects: list[tuple[str, Mesh]] = [
        ("wall", panel((-12.0, 0.0), (-7.0, 7.0), -3.5)),
        ("ground", box((-25.0, -8.0, -24.0), (25.0, -7.5, -6.0))),
        ("bench", box((-2.4, -0.6, -9.0), (-1.5, 0.3, -8.2))),
        ("sign", panel((-5.0, -4.2), (0.4, 1.3), -10.0)),
    ]
    eyes = (-5.0, -3.4, -1.9, -0.6, 0.5, 1.4, 2.2)
    return case(objects, [camera((x, 0.0, 0.0), yfov=1.1) for x in eyes])


def beside_the_axis() -> Case:
    """The post and the plaque lie where only the shift of the lens brings them into view."""
    objects: list[tuple[str, Mesh]] = [
        ("backdrop", panel((-45.0, 45.0), (-40.0, 40.0), -26.0)),
        ("post", box((-8.4, -0.9, -10.0), (-7.7, 1.2, -9.3))),
        ("plaque", panel((-6.9, -6.4), (3.2, 3.9), -9.0)),
        ("middle", box((-2.5, -0.5, -9.0), (-1.6, 0.5, -8.0))),
    ]
    return case(objects, [camera(width=96, height=64, yfov=0.8, shift_x_px=-34.0, shift_y_px=-9.0)])


def rivets_on_a_plate() -> Case:
    """From less than a sample's size to some four by four."""
    view = camera(width=160, height=90)
    objects: list[tuple[str, Mesh]] = [("plate", panel((-25.0, 25.0), (-25.0, 25.0), -16.0))]
    for number in range(9):
        side = 0.05 + 0.05 * number
        x = -4.6 + 1.1 * number
        objects.append((f"rivet {number}", box((x, -side / 2, -8.2), (x + side, side / 2, -8.0))))
    return case(objects, [view])


CASES: dict[str, tuple[str, Callable[[], Case], type[Culler]]] = {
    "05-big-floor": ("one corner in the view", big_floor, OneCornerInView),
    "06-near-plane": ("corners behind the eye", hedge_beside_the_eye, NothingBehindNear),
    "07-euclid-vs-depth": ("distance for depth", fence_behind_a_screen, StraightestPoint),
    "10-one-frame-late": ("answer a frame late", past_a_corner, FrameLate),
    "12-off-axis": ("lens shift left out", beside_the_axis, SymmetricView),
    "34-small-threshold": ("threshold of samples", rivets_on_a_plate, UnderEight),
}


def cases() -> Iterator[Fault]:
    for name, (family, build, culler) in CASES.items():
        about = " ".join((culler.__doc__ or "").split())
        yield Fault(f"case/{name}", family, f"case/{name}", about, partial(_input, build, culler))


def _input(build: Callable[[], Case], culler: type[Culler]) -> Input:
    built = build()
    return Input(built.scene, built.path, culler())
