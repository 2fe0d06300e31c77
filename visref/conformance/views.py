"""Conformance scenes that several cameras see at once while nothing moves: two eyes, the sides of
a cube, a picture and its map. `moving` has those in which something does."""

from __future__ import annotations

import numpy as np

from visref.camera_path import CameraPath, Frame
from visref.conformance.building import (
    Case,
    Mesh,
    Point,
    SceneMaker,
    box,
    camera,
    case,
    city,
    panel,
    register_in,
)

VIEWS: list[SceneMaker] = []

_scene = register_in(VIEWS)


def _seen_by(objects: list[tuple[str, Mesh]], frames: list[Frame]) -> Case:
    scene = case(objects, [frames[0].cameras[0]]).scene
    return Case(scene, CameraPath(frames, "conformance"))


@_scene(
    "what one eye alone sees is drawn for it", "both eyes culled by one of them, or between them"
)
def two_eyes(rng: np.random.Generator) -> Case:
    """Close to a board, each eye sees past another side of it; what stands there, the eye between
    them does not see."""
    objects: list[tuple[str, Mesh]] = [
        ("board", panel((-0.1, 0.1), (-0.4, 0.4), -0.6)),
        ("backdrop", panel((-9.0, 9.0), (-6.0, 6.0), -12.0)),
    ]
    for number in range(6):
        y = 0.3 * number - 0.8 + float(rng.uniform(-0.05, 0.05))
        # Behind the board as the middle has it, and beyond its edge as one of the eyes has it.
        x = 0.56 if number % 2 else -0.56
        objects.append(("aside", panel((x - 0.04, x + 0.04), (y - 0.1, y + 0.1), -3.6)))
    objects.append(("hidden", box((-0.05, -0.3, -2.0), (0.05, 0.3, -1.6))))
    frames = []
    for step in range(3):
        y = 0.02 * step
        eyes = [
            camera((x, y, 0.0), (x, y, -1.0), view=name, near=0.05)
            for name, x in (("left", -0.032), ("right", 0.032))
        ]
        frames.append(Frame(tuple(eyes)))
    return _seen_by(objects, frames)


_SIDES: dict[str, Point] = {
    "px": (1.0, 0.0, 0.0),
    "nx": (-1.0, 0.0, 0.0),
    "py": (0.0, 1.0, 0.0),
    "ny": (0.0, -1.0, 0.0),
    "pz": (0.0, 0.0, 1.0),
    "nz": (0.0, 0.0, -1.0),
}


@_scene("each side of a cube map misses nothing", "one side's occluders or frustum for another")
def sides_of_a_cube(rng: np.random.Generator) -> Case:
    objects: list[tuple[str, Mesh]] = []
    for _ in range(60):
        way = rng.normal(size=3)
        centre = way / np.linalg.norm(way) * rng.uniform(3.0, 9.0)
        half = rng.uniform(0.2, 1.2, 3)
        objects.append(("box", box(centre - half, centre + half)))
    for axis in _SIDES.values():
        # On each axis one thing close by, and one that it hides.
        near, far = 1.5 * np.array(axis), 2.6 * np.array(axis)
        objects.append(("near", box(near - 0.4, near + 0.4)))
        objects.append(("hidden", box(far - 0.2, far + 0.2)))
    cameras = tuple(
        camera(
            target=axis, view=name, width=32, height=32, yfov=float(np.pi / 2), far=float(np.inf)
        )
        for name, axis in _SIDES.items()
    )
    return _seen_by(objects, [Frame(cameras)])


@_scene("a picture and its map from above, of another size, miss nothing", "one lens for all views")
def picture_and_map(rng: np.random.Generator) -> Case:
    frames = []
    for step in range(3):
        z = 20.0 - 9.0 * step
        ahead = camera((0.3, 1.6, z), (0.1, 1.5, z - 1.0), view="picture")
        above = camera((0.0, 40.0, z), (0.0, 0.0, z), ymag=9.0, view="map", width=40, height=40)
        frames.append(Frame((ahead, above)))
    return _seen_by(city(rng), frames)
