"""The scenes of `visref.conformance`: small, seeded, each built around one way to go wrong.

Every scene is made of plain arrays and needs no file. In each (but the empty ones) something
is visible, and in most something is hidden, so that no check passes for lack of a question.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.scene import Alpha, Float64, Scene

WIDTH, HEIGHT = 64, 48

Mesh = tuple[NDArray[Any], NDArray[Any]]
Point = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Case:
    """A scene and the path it is seen along."""

    scene: Scene
    path: CameraPath


@dataclass(frozen=True)
class SceneMaker:
    """A named scene. `claim` says what a safe culler does on it, `trap` what goes wrong."""

    name: str
    claim: str
    trap: str
    build: Callable[[np.random.Generator], Case]


SCENES: list[SceneMaker] = []


Build = Callable[..., Case]


def register_in(scenes: list[SceneMaker]) -> Callable[[str, str], Callable[[Build], Build]]:
    """A decorator that puts scenes into a list, with their claim and the usual trap."""

    def scene(claim: str, trap: str) -> Callable[[Build], Build]:
        def register(build: Build) -> Build:
            scenes.append(SceneMaker(build.__name__, claim, trap, build))
            return build

        return register

    return scene


_scene = register_in(SCENES)


# Meshes, cameras and how they make a case.

_BOX_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5],
        [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
        [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def box(low: Point | Float64, high: Point | Float64) -> Mesh:
    """A closed box, its faces counter-clockwise seen from outside."""
    corners = np.array([[(i >> 2) & 1, (i >> 1) & 1, i & 1] for i in range(8)], np.float64)
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    return low + corners * (high - low), _BOX_FACES


def panel(x: tuple[float, float], y: tuple[float, float], z: float) -> Mesh:
    """An upright rectangle that faces +Z."""
    corners = np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]])
    return corners, np.array([[0, 1, 2], [0, 2, 3]])


def together(*meshes: Mesh) -> Mesh:
    """Several meshes as one object."""
    bases = np.cumsum([0, *(len(points) for points, _ in meshes)])
    faces = [faces + base for (_, faces), base in zip(meshes, bases[:-1], strict=True)]
    return np.concatenate([points for points, _ in meshes]), np.concatenate(faces)


def camera(eye: Point = (0.0, 0.0, 0.0), target: Point | None = None, **changes: Any) -> Camera:
    """Perspective, 64 by 48, yfov 1.0, near 0.1, far 200; looks down -Z unless told where."""
    pose = look_at(eye, (eye[0], eye[1], eye[2] - 1.0) if target is None else target)
    values: dict[str, Any] = {"width": WIDTH, "height": HEIGHT, "near": 0.1, "far": 200.0}
    if "ymag" not in changes:
        values["yfov"] = 1.0
    return Camera(pose, **{**values, **changes})


def rolled(view: Camera, angle: float) -> Camera:
    """The camera turned about its own axis by `angle` radians."""
    turn = np.eye(4)
    turn[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    return replace(view, world_from_camera=view.world_from_camera @ turn)


def pixel_point(view: Camera, x: float, y: float, depth: float) -> Float64:
    """The world point that falls on pixel coordinates (x, y), integers being centres."""
    a = 2.0 * x + 1.0 - view.width
    b = view.height - 2.0 * y - 1.0
    step = depth if view.is_perspective else 1.0
    point: Float64 = view.eye + depth * view.forward
    return point + step * (a * view.right_step + b * view.up_step)


def pixel_panel(view: Camera, x: tuple[float, float], y: tuple[float, float], depth: float) -> Mesh:
    """A rectangle facing the camera, given by its sides in pixel coordinates."""
    corners = [(x[0], y[1]), (x[1], y[1]), (x[1], y[0]), (x[0], y[0])]
    points = np.array([pixel_point(view, cx, cy, depth) for cx, cy in corners])
    return points, np.array([[0, 1, 2], [0, 2, 3]])


def case(
    objects: list[tuple[str, Mesh]],
    cameras: list[Camera],
    *,
    alpha: dict[str, Alpha] | None = None,
    one_sided: tuple[str, ...] = (),
) -> Case:
    """Put a case together; materials are given by object name."""
    scene = Scene.from_objects([(name, *mesh) for name, mesh in objects], source="conformance")
    first_names = [name for name, _ in objects]
    alphas = np.array([int((alpha or {}).get(name, Alpha.OPAQUE)) for name in first_names])
    sided = np.array([name in one_sided for name in first_names])
    owner = scene.object_of_triangle
    if len(owner):
        scene = replace(scene, alpha=alphas[owner].astype(np.uint8), one_sided=sided[owner])
    return Case(scene, CameraPath(tuple(cameras), "conformance"))


def _city(rng: np.random.Generator, side: int = 6) -> list[tuple[str, Mesh]]:
    """Houses on a square grid, 8 apart, and the ground below them; streets run at 0, 8, ..."""
    objects = [("ground", box((-80.0, -1.0, -80.0), (80.0, 0.0, 80.0)))]
    for i in range(side):
        for j in range(side):
            centre = np.array([8.0 * (i - side / 2) + 4.0, 0.0, 8.0 * (j - side / 2) + 4.0])
            half = rng.uniform(1.2, 3.4, 3) * (1.0, 0.0, 1.0)
            height = np.array([0.0, rng.uniform(1.5, 9.0), 0.0])
            objects.append(("house", box(centre - half, centre + half + height)))
    return objects


def _walk(rng: np.random.Generator, frames: int, **changes: Any) -> list[Camera]:
    """A walk along a street of the city at eye height, looking about."""
    views = []
    for frame in range(frames):
        z = 20.0 - 5.0 * frame
        aside = rng.uniform(-0.6, 0.6)
        views.append(camera((0.3, 1.6, z), (0.3 + aside, 1.6 + 0.2 * aside, z - 1.0), **changes))
    return views


# What most cullers meet every day.


@_scene("a walk through a city misses no house", "any")
def walk_through_a_city(rng: np.random.Generator) -> Case:
    return case(_city(rng), _walk(rng, 6))


@_scene("no box of a crowd is missed, however few of its pixels show", "results out of step")
def crowd(rng: np.random.Generator) -> Case:
    objects = []
    for _ in range(120):
        centre = rng.uniform((-9.0, -7.0, -24.0), (9.0, 7.0, -6.0))
        half = rng.uniform(0.2, 1.3, 3)
        objects.append(("box", box(centre - half, centre + half)))
    return case(objects, [camera((x, 0.5 * x, 0.0)) for x in (-1.0, 0.0, 1.0)])


@_scene("a view with a rolled, pitched camera misses nothing", "y flipped, up assumed")
def rolled_and_pitched_camera(rng: np.random.Generator) -> Case:
    eyes = [((0.3, 14.0, 22.0), 0.6), ((20.0, 25.0, 3.0), -2.5), ((0.0, 40.0, 0.1), 1.2)]
    return case(_city(rng), [rolled(camera(eye, (0.0, 2.0, 0.0)), angle) for eye, angle in eyes])


@_scene("a moved lens and a changing field of view miss nothing", "off-centre frustum")
def lens_shift_and_zoom(rng: np.random.Generator) -> Case:
    views = _walk(rng, 4)
    shifts = [(7.25, 0.0), (-20.0, 11.5), (0.5, -0.5), (0.0, 30.0)]
    fovs = [0.7, 1.0, 2.2, 0.8]
    views = [
        replace(view, shift_x_px=sx, shift_y_px=sy, yfov=fov)
        for view, (sx, sy), fov in zip(views, shifts, fovs, strict=True)
    ]
    return case(_city(rng), views)


@_scene("an orthographic view behind touching occluders misses nothing", "perspective assumed")
def orthographic_camera(rng: np.random.Generator) -> Case:
    objects = _city(rng)
    # A wall of touching boxes, one brick missing.
    for column in range(12):
        for row in range(3):
            if (column, row) != (5, 1):
                low = np.array([3.0 * column - 18.0, 3.0 * row, 27.0])
                objects.append(("brick", box(low, low + 3.0)))
    views = [
        camera((0.0, 5.0, 60.0), (0.0, 5.0, 0.0), ymag=12.0),
        camera((30.0, 40.0, 30.0), (0.0, 0.0, 0.0), ymag=14.0),
        camera((0.0, 60.0, 0.0), (0.0, 0.0, 0.0), ymag=25.0),
    ]
    return case(objects, views)


# Where the camera stands.


@_scene("an object around the eye is drawn", "back-face culled query with the eye inside")
def eye_inside_an_object(rng: np.random.Generator) -> Case:
    objects = [
        ("hall", box((-10.0, -4.0, -10.0), (10.0, 4.0, 10.0))),
        ("outside", box((-3.0, -2.0, -20.0), (3.0, 2.0, -12.0))),
        ("cage", box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))),
        # Its box, but none of its triangles, is around the eye of most views.
        (
            "gate",
            together(
                box((-2.5, -2.0, 3.0), (-2.0, 2.0, 3.5)), box((2.0, -2.0, 5.5), (2.5, 2.0, 6.0))
            ),
        ),
    ]
    for _ in range(8):
        centre = rng.uniform((-8.0, -3.0, -9.0), (8.0, 3.0, -3.0))
        objects.append(("crate", box(centre - 0.6, centre + 0.6)))
    views = [
        camera(),  # inside the cage, which hides all else
        camera((0.0, 0.0, 5.0)),  # inside the hall alone
        camera((0.0, 0.0, 10.0)),  # on the hall's wall
        camera((2.0, 1.0, 4.0), (-2.0, 0.0, 9.0)),
    ]
    return case(objects, views)


@_scene("an object that crosses the near plane is drawn", "corners behind the eye projected")
def object_crossing_the_near_plane(rng: np.random.Generator) -> Case:
    objects = [
        ("left wall", box((-2.2, -1.0, -30.0), (-2.0, 1.0, 10.0))),
        ("right wall", box((2.0, -1.0, -30.0), (2.2, 1.0, 10.0))),
        ("floor", box((-2.0, -1.2, -30.0), (2.0, -1.0, 10.0))),
        # Hides where the walls' far ends and the mirror images of their near ends project.
        ("door", panel((-1.6, 1.6), (-0.9, 0.9), -4.0)),
        ("behind the door", box((-1.0, -0.5, -8.0), (1.0, 0.5, -6.0))),
        ("pole", box((-0.12, -0.3, -0.14), (-0.06, 0.3, -0.05))),
        ("plate", panel((0.02, 0.09), (-0.05, 0.03), -0.1)),  # exactly on the near plane
        ("too near", panel((-0.2, 0.2), (-0.2, 0.2), -0.05)),
    ]
    views = [camera(), camera((1.2, 0.1, 2.0)), camera((-0.5, 0.2, 1.0), (-1.9, 0.0, 0.0))]
    views += [camera((float(rng.uniform(-1.5, 1.5)), 0.0, 5.0), near=1.0) for _ in range(2)]
    return case(objects, views)


@_scene("a camera that cuts to another place misses nothing there", "last frame's depth or set")
def jump_cuts(rng: np.random.Generator) -> Case:
    eyes: list[Point] = [(0.3, 1.6, 20.0), (12.0, 30.0, 12.0), (0.3, 1.6, -21.0), (-8.0, 1.0, 0.5)]
    views = [camera(eye, (0.0, 1.0, 0.0), cut=True) for eye in eyes]
    return case(_city(rng), [*views, views[0]])


@_scene("a fast turn misses nothing, though no cut is announced", "last frame's depth or set")
def fast_turn(rng: np.random.Generator) -> Case:
    objects = _city(rng)
    # A blind right before the first view: what it hides must not stay hidden.
    objects.append(("blind", panel((-0.2, 0.8), (1.3, 1.9), 19.0)))
    eye = (0.3, 1.6, 20.0)
    angles = [0.0, 0.5, math.pi / 2, math.pi, 1.7 * math.pi, 0.0]
    views = [
        camera(eye, (eye[0] - math.sin(turn), eye[1], eye[2] - math.cos(turn))) for turn in angles
    ]
    # And a step round the blind.
    views.append(camera((0.3, 1.6, 18.5)))
    return case(objects, views)


@_scene("a scene a million units from the origin misses nothing", "float32 world coordinates")
def far_from_the_origin(rng: np.random.Generator) -> Case:
    shift = np.array([1.0e6, 2.5e5, -7.0e5])
    objects = [(name, (points + shift, faces)) for name, (points, faces) in _city(rng)]
    views = []
    for view in _walk(rng, 3):
        pose = view.world_from_camera.copy()
        pose[:3, 3] += shift
        views.append(replace(view, world_from_camera=pose))
    return case(objects, views)


@_scene("viewports of one pixel, one row and odd sides miss nothing", "sides rounded to tiles")
def odd_viewports(rng: np.random.Generator) -> Case:
    # The middle of the view is on a house.
    view = camera((0.3, 1.6, 20.0), (3.9, 1.2, 12.0))
    sizes = [(1, 1), (1, 64), (64, 1), (61, 47), (3, 5), (33, 17), (127, 2), (65, 33), (2, 2)]
    views = [replace(view, width=width, height=height) for width, height in sizes]
    return case(_city(rng), views)


# What lies before what.


@_scene("what peeks out behind an occluder by one pixel is drawn", "rectangle rounded inward")
def peeking_by_a_pixel(rng: np.random.Generator) -> Case:
    view = camera()
    objects = []
    for column in range(4):
        for row in range(3):
            # The occluder covers columns x ... x + 8 and rows y ... y + 8, its edges anywhere
            # between those and the next; what peeks out owns the next one.
            x, y = 3.0 + 16.0 * column, 3.0 + 16.0 * row
            before, after = rng.uniform(0.02, 0.98, 2), rng.uniform(0.02, 0.98, 2)
            wide, high = (x - before[0], x + 8.0 + after[0]), (y - before[1], y + 8.0 + after[1])
            # It hangs on a flag near the eye, so that it comes first from front to back.
            flag = pixel_panel(view, (x + 4.0, x + 4.4), (y + 4.0, y + 4.4), 1.0)
            objects.append(("occluder", together(pixel_panel(view, wide, high, 5.0), flag)))
            objects.append(("hidden", pixel_panel(view, (x + 1, x + 7), (y + 1, y + 7), 9.0)))
            sides = np.array([x + 2.0, x + 6.5, y + 2.0, y + 6.5])
            side, out = (column + row) % 4, rng.uniform(0.02, 0.4)
            sides[side] = [x - 1.0 - out, x + 9.0 + out, y - 1.0 - out, y + 9.0 + out][side]
            left, right, top, bottom = sides.tolist()
            objects.append(("peeks", pixel_panel(view, (left, right), (top, bottom), 7.0)))
    return case(objects, [view, rolled(view, math.pi / 2), rolled(view, math.pi)])


@_scene("what shows in the first or last row or column is drawn", "last row left out")
def rows_and_columns_at_the_border(rng: np.random.Generator) -> Case:
    view = camera()
    w, h = float(WIDTH), float(HEIGHT)
    screen = pixel_panel(view, (0.4, w - 1.4), (0.4, h - 1.4), 5.0)
    objects = [
        ("screen", together(screen, pixel_panel(view, (30.0, 30.3), (20.0, 20.3), 1.0))),
        ("hidden", pixel_panel(view, (10.0, 50.0), (10.0, 40.0), 9.0)),
        ("left", pixel_panel(view, (-0.4, 12.0), (8.0, 20.0), 7.0)),
        ("right", pixel_panel(view, (w - 12.0, w - 0.6), (10.0, 30.0), 7.0)),
        ("top", pixel_panel(view, (9.0, 30.0), (-0.4, 12.0), 8.0)),
        ("bottom", pixel_panel(view, (25.0, 44.0), (h - 14.0, h - 0.6), 6.0)),
        ("last column", pixel_panel(view, (w - 1.3, w - 0.6), (2.0, 8.0), 6.0)),
        ("last row", pixel_panel(view, (4.0, 9.0), (h - 1.3, h - 0.6), 6.0)),
    ]
    return case(objects, [view, rolled(view, math.pi)])


@_scene("what shows through a gap of a pixel is drawn", "low-resolution depth")
def gap_narrower_than_a_texel(rng: np.random.Generator) -> Case:
    view = camera()
    objects, views = [], [view]
    for row in range(6):
        y = (8.0 * row - 0.45, 8.0 * row + 7.55)
        gap, wide = float(rng.integers(8, 56)), float(rng.uniform(0.3, 1.4))
        left = pixel_panel(view, (-1.0, gap - 0.3), y, 5.0)
        right = pixel_panel(view, (gap + wide, 65.0), y, 5.0)
        flag = pixel_panel(view, (5.0, 5.3), (y[0] + 3.0, y[0] + 3.3), 1.0)
        objects.append(("occluders", together(left, right, flag)))
        middle = (y[0] + 2.0, y[0] + 6.0)
        objects.append(("in the gap", pixel_panel(view, (gap - 5.0, gap + 6.0), middle, 8.0)))
        objects.append(("hidden", pixel_panel(view, (gap + 3.0, gap + 9.0), middle, 9.0)))
    return case(objects, [*views, rolled(view, math.pi / 2)])


@_scene("what shows beside a stack of half-covering sheets is drawn", "last batch of queries lost")
def stacks_of_sheets(rng: np.random.Generator) -> Case:
    view = camera()
    objects = []
    for column in range(4):
        for row in range(3):
            left, top = 16.0 * column + 1.2, 16.0 * row + 1.2
            right, bottom = left + 13.0, top + 13.0
            # Triangles that all leave the lower right half open, though their rectangles do not.
            for sheet in range(7):
                depth = 4.0 + 0.5 * sheet + rng.uniform(0.0, 0.4)
                inset = 0.2 * sheet
                corners = [(left + inset, top + inset), (left + inset, bottom - inset)]
                corners.append((right - inset, top + inset))
                points = np.array([pixel_point(view, x, y, depth) for x, y in corners])
                objects.append(("sheet", (points, np.array([[0, 1, 2]]))))
            x, y = rng.uniform((left + 8.0, top + 8.0), (left + 9.0, top + 9.0))
            seen = pixel_panel(view, (x, x + 2.0), (y, y + 2.0), 9.0)
            objects.append(("beside", seen))
    return case(objects, [view, rolled(view, math.pi)])


@_scene("a large object at the screen's edge is drawn", "distance compared with depth")
def large_object_at_the_edge(rng: np.random.Generator) -> Case:
    # The walls hang on flags near the eye, so that they come first from front to back; their
    # nearest corners are less far away than the objects before them.
    flag = panel((-0.2, 0.2), (-0.2, 0.2), -1.0)
    objects = [
        ("wall", together(panel((-30.0, -1.0), (-6.5, 6.5), -10.0), flag)),
        ("wall", together(panel((1.0, 30.0), (-6.5, 6.5), -10.0), flag)),
        ("post", box((-9.2, -1.0, -7.5), (-8.8, 1.0, -7.0))),
        ("left", box((-16.0, -5.0, -9.5), (-11.0, 5.0, -8.5))),
        ("right", panel((10.5, 15.0), (-5.0, 5.0), -9.0)),
        ("corner", panel((-15.0, -12.0), (4.5, 5.5), -9.9)),
        ("behind", box((3.0, -5.0, -15.0), (9.0, 5.0, -12.0))),
    ]
    views = [camera(yfov=1.8), camera(yfov=1.8, width=48, height=64)]
    return case(objects, [*views, rolled(views[0], 0.4)])


@_scene("posters just before a wall are drawn", "coarse or badly rounded depth")
def posters_on_a_wall(rng: np.random.Generator) -> Case:
    objects = []
    walls = [(15.5, (0.0, 20.0)), (60.0, (22.0, 41.0)), (150.0, (43.0, 63.0))]
    view = camera()
    for depth, (left, right) in walls:
        wall = pixel_panel(view, (left, right), (0.0, 47.0), depth)
        flag = pixel_panel(view, (left, left + 0.3), (0.0, 0.3), 2.0)
        objects.append(("wall", together(wall, flag)))
        for row in range(8):
            y = (6.0 * row + 0.6, 6.0 * row + 4.6)
            x = left + 2.0 + 0.4 * row
            before = depth * (1.0 - 10.0 ** rng.uniform(-3.5, -2.0))
            objects.append(("poster", pixel_panel(view, (x, x + 12.0), y, before)))
        hidden = pixel_panel(view, (left + 3.0, right - 3.0), (5.0, 40.0), 1.02 * depth)
        objects.append(("hidden", hidden))
    return case(objects, [view])


@_scene("an object of a single sample is drawn", "threshold above one sample, small objects cut")
def objects_of_one_sample(rng: np.random.Generator) -> Case:
    view = camera()
    wall = pixel_panel(view, (-1.0, 40.2), (-1.0, 48.0), 20.0)
    flag = pixel_panel(view, (0.6, 0.8), (0.6, 0.8), 1.0)
    objects = [("wall", together(wall, flag))]
    for _ in range(40):
        x, y = float(rng.integers(2, 62)), float(rng.integers(2, 46))
        r = rng.uniform(0.1, 0.4)
        depth = float(rng.choice([6.0, 12.0, 30.0]))
        objects.append(("dot", pixel_panel(view, (x - r, x + r), (y - r, y + r), depth)))
    return case(objects, [view])


@_scene("slivers are drawn where they own a sample", "thin objects dropped")
def slivers(rng: np.random.Generator) -> Case:
    view = camera()
    objects = [
        ("shield", panel((-2.0, 0.5), (-1.5, 0.8), -6.0)),
        ("backdrop", panel((-30.0, 30.0), (-20.0, 20.0), -30.0)),
    ]
    for _ in range(30):
        a, b = rng.uniform((2.0, 2.0), (62.0, 46.0), (2, 2))
        across = np.array([a[1] - b[1], b[0] - a[0]])
        c = a + across / np.linalg.norm(across) * rng.uniform(0.02, 0.3)
        depth = rng.choice([4.0, 10.0, 20.0])
        points = np.array([pixel_point(view, p[0], p[1], depth) for p in (a, b, c)])
        objects.append(("sliver", (points, np.array([[0, 1, 2]]))))
    return case(objects, [view, camera((0.5, 0.3, 2.0))])


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
    return case(objects, [camera(), camera((1.0, 0.4, 1.0))], alpha=materials)


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


@_scene("plates turned and mirrored show beyond their occluder", "two corners transformed")
def rotated_and_mirrored_plates(rng: np.random.Generator) -> Case:
    flag = panel((-0.05, 0.05), (-0.05, 0.05), -1.0)
    objects = [("pole", together(panel((-0.5, 0.5), (-8.0, 8.0), -6.0), flag))]
    for index, angle in enumerate((math.pi / 4, -math.pi / 4, math.pi / 4 + 0.1)):
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        points, faces = panel((-1.5, 1.5), (-1.5, 1.5), -8.0 - index)
        points[:, :2] = points[:, :2] @ turn.T + (0.0, 3.5 * index - 3.5)
        if index == 1:
            points[:, 0], faces = -points[:, 0], faces[:, ::-1]
        objects.append(("plate", (points, faces)))
    objects.append(("hidden", panel((-0.4, 0.4), (-1.0, 1.0), -9.0)))
    return case(objects, [camera(), rolled(camera(), math.pi / 4)])


@_scene("of objects at one depth, one is drawn at every sample", "strict test against own depth")
def coplanar_ties(rng: np.random.Generator) -> Case:
    objects = [
        ("twin", box((-3.0, -1.0, -8.0), (-1.0, 1.0, -6.0))),
        ("twin", box((-3.0, -1.0, -8.0), (-1.0, 1.0, -6.0))),
        ("tile", panel((0.0, 2.0), (-1.0, 1.0), -6.0)),
        ("tile", panel((1.0, 3.0), (-0.5, 1.5), -6.0)),
        ("tile", panel((0.5, 1.5), (-0.5, 0.5), -6.0)),
        ("touching", box((-1.0, -1.0, -8.0), (0.0, 1.0, -6.0))),
        ("hidden", box((-2.5, -0.5, -12.0), (2.0, 0.5, -9.0))),
    ]
    return case(objects, [camera(), camera((0.5, 0.2, 1.0))])


@_scene("objects that pierce each other are drawn", "whole objects ordered by depth")
def interpenetrating_objects(rng: np.random.Generator) -> Case:
    # With a flag near the eye, so that it comes first from front to back.
    core = together(
        box((-1.5, -1.5, -9.5), (1.5, 1.5, -6.5)), panel((0.0, 0.02), (0.0, 0.02), -1.0)
    )
    objects = [("core", core)]
    objects.append(("swallowed", box((-1.0, -1.0, -9.0), (1.0, 1.0, -7.0))))
    for axis in range(3):
        for sign in (-1.0, 1.0):
            low, high = np.full(3, -0.4), np.full(3, 0.4)
            reach = rng.uniform(1.6, 2.5)
            low[axis], high[axis] = min(0.0, sign * reach), max(0.0, sign * reach)
            centre = np.array([0.0, 0.0, -8.0])
            objects.append(("spike", box(centre + low, centre + high)))
    views = [camera((0.13, 0.07, 0.0)), camera((5.0, 4.0, -2.0), (0.0, 0.0, -8.0))]
    return case(objects, views)


@_scene("a grazing view over one huge triangle misses nothing", "enormous, behind the eye")
def huge_grazing_triangle(rng: np.random.Generator) -> Case:
    corners = np.array([[-1.0e5, 0.0, 1.0e5], [1.0e5, 0.0, 1.0e5], [0.0, 0.0, -2.0e5]])
    objects = [("plain", (corners, np.array([[0, 1, 2]])))]
    for _ in range(10):
        x, z = rng.uniform(-12.0, 12.0), rng.uniform(-40.0, -8.0)
        objects.append(("stone", box((x - 0.5, 0.0, z - 0.5), (x + 0.5, 0.6, z + 0.5))))
        objects.append(("buried", box((x, -2.0, z), (x + 0.5, -0.5, z + 0.5))))
    views = [camera((0.0, height, 0.0)) for height in (0.05, 1.0, 3.0)]
    return case(objects, views)


@_scene("nothing is missed from a millimetre to a thousand kilometres", "depth resolution")
def huge_depth_range(rng: np.random.Generator) -> Case:
    view = camera(near=1.0e-3, far=1.0e6)
    objects = []
    for index in range(9):
        depth = 3.0e-3 * 10.0**index if index < 8 else 9.0e5
        x = 7.0 * index
        objects.append(("near", pixel_panel(view, (x, x + 4.0), (4.0, 40.0), depth)))
        aside = 2.0 * (index % 2)
        behind = pixel_panel(view, (x + 1.0, x + 3.0 + aside), (10.0, 39.0), 1.1 * depth)
        objects.append(("behind", behind))
    return case(objects, [view, replace(view, far=math.inf)])


@_scene("what lies exactly on the far plane is drawn, what lies beyond is not asked", "open range")
def exactly_at_the_far_plane(rng: np.random.Generator) -> Case:
    view = camera(near=1.0, far=64.0)
    objects = [
        ("before", pixel_panel(view, (4.0, 20.0), (4.0, 40.0), 32.0)),
        ("on far", panel((-4.0, 20.0), (-20.0, 20.0), -64.0)),
        ("across far", box((-30.0, -10.0, -70.0), (-20.0, 10.0, -60.0))),
        ("beyond far", box((-3.0, -3.0, -90.0), (3.0, 3.0, -80.0))),
    ]
    return case(objects, [view])


@_scene("a scene without objects draws nothing and breaks nothing", "division by no objects")
def empty_scene(rng: np.random.Generator) -> Case:
    return case([], [camera(), camera((1.0, 0.0, 0.0))])


@_scene("objects without area or triangles harm nobody", "infinite or inverted boxes")
def objects_without_triangles(rng: np.random.Generator) -> Case:
    nothing: Mesh = (np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    point: Mesh = (np.full((3, 3), -5.0), np.array([[0, 1, 2]]))
    objects = [
        ("nothing", nothing),
        ("seen", box((-1.0, -1.0, -6.0), (1.0, 1.0, -4.0))),
        ("point", point),
        ("edge-on", (np.array([[0.0, 0.0, -3.0], [0, 0, -4], [0, 1, -4]]), np.array([[0, 1, 2]]))),
        ("nothing", nothing),
        ("one triangle", (np.array([[2.0, 0, -5], [3, 0, -5], [2, 1, -5]]), np.array([[0, 1, 2]]))),
    ]
    return case(objects, [camera()])
