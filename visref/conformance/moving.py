"""Conformance scenes in which things move, bend, appear and vanish, and which two cameras see.

What a culler keeps from one frame to the next is wrong here if it is not brought up to date: boxes,
depth, lists of what there is, and what a view has seen. Cullers without an `update` are for scenes
that stand still; of these scenes they are asked about those alone in which nothing moves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera_path import CameraPath, Frame
from visref.conformance.building import (
    Case,
    Mesh,
    SceneMaker,
    box,
    camera,
    case,
    city,
    panel,
    register_in,
    together,
)
from visref.rig import Moment, Motion, Rig
from visref.scene import Float32, Float64, Scene

MOVING: list[SceneMaker] = []

_scene = register_in(MOVING, moves=True)


@_scene("what a sliding door opens to is drawn, and what it shuts off may not be", "old depth")
def sliding_door(rng: np.random.Generator) -> Case:
    objects = [
        ("left wall", panel((-8.0, -1.5), (-6.0, 6.0), -6.0)),
        ("right wall", panel((1.5, 8.0), (-6.0, 6.0), -6.0)),
        ("above", panel((-1.5, 1.5), (1.5, 6.0), -6.0)),
        ("below", panel((-1.5, 1.5), (-6.0, -1.5), -6.0)),
        ("door", panel((-1.6, 1.6), (-1.6, 1.6), -5.9)),
    ]
    for _ in range(12):
        centre = rng.uniform((-1.6, -1.6, -11.0), (1.6, 1.6, -7.0))
        objects.append(("crate", box(centre - 0.25, centre + 0.25)))
    frames = [
        Frame((camera((0.1 * step, 0.0, 0.0)),), world_from_object={"door": moved(x=aside)})
        for step, aside in enumerate((0.0, 0.0, 1.0, 2.2, 3.2, 1.5, 0.0, -2.5))
    ]
    return posed(objects, frames)


@_scene("what is carried out of hiding or into the view is drawn there", "boxes of another frame")
def carried_about(rng: np.random.Generator) -> Case:
    objects = [
        ("wall", panel((-3.0, 3.0), (-3.0, 3.0), -8.0)),
        # All but the last start behind the wall or beside the view.
        ("lift", box((-0.5, -0.5, -12.0), (0.5, 0.5, -11.0))),
        ("cart", box((-1.5, -1.0, -10.0), (-0.5, 0.0, -9.0))),
        ("far cart", box((60.0, -1.0, -20.0), (61.0, 0.0, -19.0))),
        ("behind the eye", box((-0.4, -0.4, 5.0), (0.4, 0.4, 6.0))),
        ("drone", box((-0.2, -0.2, -6.4), (0.2, 0.2, -6.0))),
    ]
    frames = []
    for step in range(7):
        share = step / 6.0
        where = {
            "lift": moved(y=7.0 * share),
            "cart": moved(x=-8.0 * share),
            "far cart": moved(x=-54.0 * share),
            "behind the eye": moved(x=2.5, z=-13.0 * share),
            # It hides other parts of the wall in each frame.
            "drone": moved(x=2.0 * math.cos(step), y=2.0 * math.sin(step)),
        }
        frames.append(Frame((camera(),), world_from_object=where))
    return posed(objects, frames)


@_scene("what turns about is drawn wherever it sticks out", "boxes of another frame, two corners")
def turning_about(rng: np.random.Generator) -> Case:
    objects: list[tuple[str, Mesh]] = []
    for number in range(9):
        x, y = 3.0 * (number % 3) - 3.0, 2.4 * (number // 3) - 2.4
        objects.append((f"shield {number}", panel((x - 0.7, x + 0.7), (y - 0.6, y + 0.6), -7.0)))
        # Lies wholly behind its shield, along the view.
        objects.append(
            (f"plank {number}", box((x - 0.2, y - 0.1, -12.0), (x + 0.2, y + 0.1, -8.0)))
        )
    frames = []
    for step in range(6):
        where = {}
        for number in range(9):
            x, y = 3.0 * (number % 3) - 3.0, 2.4 * (number // 3) - 2.4
            turn = float(rng.uniform(0.2, 1.5)) * step / 5.0
            where[f"plank {number}"] = about((x, y, -10.0), turn, axis=number % 2)
        frames.append(Frame((camera((0.0, 0.0, 2.0)),), world_from_object=where))
    return posed(objects, frames)


@_scene("what a thing hid is drawn once it is gone, and what appears is", "old depth, no entry")
def appearing_and_vanishing(rng: np.random.Generator) -> Case:
    objects: list[tuple[str, Mesh]] = [("ground", box((-30.0, -3.0, -40.0), (30.0, -2.5, 10.0)))]
    names = []
    for number in range(8):
        x = 2.0 * number - 7.0
        objects.append((f"blind {number}", panel((x - 0.9, x + 0.9), (-2.0, 2.0), -8.0)))
        # Behind the middle of its blind, as the middle of the views has it.
        x = 0.6 + (x - 0.6) * 12.5 / 11.0
        objects.append((f"hidden {number}", box((x - 0.3, -0.3, -9.6), (x + 0.3, 0.3, -9.4))))
        names += [f"blind {number}", f"hidden {number}"]
    # Frames of which little is there, and one of which only the ground is.
    gone = [tuple(name for name in names if rng.random() < 0.4) for _ in range(7)]
    gone[0] = ("blind 0", "hidden 1", "hidden 2")
    gone[3] = tuple(names)
    gone[4] = ()
    frames = [Frame((camera((0.2 * k, 0.3, 3.0)),), absent=names) for k, names in enumerate(gone)]
    return posed(objects, frames)


@_scene("what bends out of its box at rest is drawn", "boxes of joints, or of the pose at rest")
def bending_reeds(rng: np.random.Generator) -> Case:
    objects: list[tuple[str, Mesh]] = [
        ("hedge", together(*(panel((x, x + 1.9), (-2.0, 0.5), -8.0) for x in range(-6, 6, 2))))
    ]
    reeds = []
    for number in range(6):
        x = 2.0 * number - 5.0
        objects.append((f"reed {number}", reed(x)))
        reeds.append(len(objects) - 1)
    # Beside the view, into which its end bends at last.
    objects.append(("reed beside", reed(8.5)))
    reeds.append(len(objects) - 1)
    ways = [*rng.uniform(-1.0, 1.0, len(reeds) - 1).tolist(), -0.2]
    scene = case(objects, [camera()]).scene
    # As a file has them: float32, and at each time as much more as it is later.
    positions = [points.astype(np.float32) for _, (points, _) in objects]
    grown = {at: bent(positions[at], way) for at, way in zip(reeds, ways, strict=True)}
    motion = Bending(positions, grown)
    frames = [Frame((camera((0.0, -0.6, 1.0)),), time_s=float(t)) for t in range(6)]
    return Case(rigged(scene, positions, motion), CameraPath(frames, "conformance"))


@_scene("each of two views misses nothing, whatever the other has seen", "what one view remembers")
def two_views(rng: np.random.Generator) -> Case:
    # Each screen stands before what the other view alone could see past.
    objects = [
        ("post", panel((-1.0, 1.0), (-4.0, 4.0), -5.0)),
        ("left screen", panel((-3.7, -1.3), (-4.0, 4.0), -9.0)),
        ("right screen", panel((1.3, 3.7), (-4.0, 4.0), -9.0)),
    ]
    for _ in range(40):
        centre = rng.uniform((-8.0, -3.0, -14.0), (8.0, 3.0, -10.0))
        objects.append(("box", box(centre - 0.3, centre + 0.3)))
    objects.append(("shutter", panel((-9.0, 9.0), (-5.0, 5.0), -2.0)))
    frames = []
    for step in range(5):
        left = camera((-2.5 + 0.2 * step, 0.0, 0.0), (0.0, 0.0, -12.0), view="left")
        right = camera((2.5, 0.1 * step, 0.0), (0.0, 0.0, -12.0), view="right", width=48, height=64)
        where = {"shutter": moved(x=-18.0 if step % 2 else 18.0)}
        frames.append(Frame((left, right), world_from_object=where))
    return posed(objects, frames)


@_scene("two views of a city of which houses come and go, with cuts, miss nothing", "any")
def two_views_of_a_changing_city(rng: np.random.Generator) -> Case:
    objects = [(f"{name} {k}", mesh) for k, (name, mesh) in enumerate(city(rng))]
    frames = []
    for step in range(5):
        z = 20.0 - 6.0 * step
        views = (
            camera((0.3, 1.6, z), (0.1, 1.5, z - 1.0), view="ahead", cut=step == 3),
            camera((0.3, 1.6, z), (-1.0, 1.5, z - 0.4), view="aside", cut=step == 3),
        )
        chosen = rng.integers(1, len(objects), 12)
        where = {objects[k][0]: moved(*rng.uniform(-3.0, 3.0, 3)) for k in chosen[:6]}
        absent = tuple(objects[k][0] for k in chosen[6:])
        frames.append(Frame(views, world_from_object=where, absent=absent))
    return posed(objects, frames)


# What they are made of.


def posed(objects: list[tuple[str, Mesh]], frames: Sequence[Frame]) -> Case:
    """A case of named objects whose path poses them."""
    return Case(case(objects, [camera()]).scene, CameraPath(frames, "conformance"))


def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Float64:
    """(4, 4) float64: a translation."""
    result = np.eye(4)
    result[:3, 3] = x, y, z
    return result


def about(centre: tuple[float, float, float], angle: float, *, axis: int) -> Float64:
    """(4, 4) float64: a turn by `angle` radians about a line through `centre` along an axis."""
    result = np.eye(4)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    result[j, j] = result[k, k] = math.cos(angle)
    result[j, k], result[k, j] = -math.sin(angle), math.sin(angle)
    return moved(*centre) @ result @ moved(*(-np.array(centre)))


def reed(x: float) -> Mesh:
    """A thin upright strip of eight steps behind the hedge."""
    steps = np.linspace(-1.8, 0.2, 9)
    points = np.array([[x + side, y, -9.0] for y in steps for side in (-0.08, 0.08)])
    faces = [face for k in range(0, 16, 2) for face in ((k, k + 1, k + 3), (k, k + 3, k + 2))]
    return points, np.array(faces)


def bent(points: Float32, way: float) -> Float32:
    """(v, 3) float32: by how much a thing grows and bends from its lowest point on, its own way,
    in each second, as a skin does whose joints are along it."""
    height = (points[:, 1] - points[:, 1].min()).astype(np.float64)
    result = np.zeros((len(points), 3))
    result[:, 0] = 0.4 * way * height**2
    result[:, 1] = 0.25 * height
    return result.astype(np.float32)


@dataclass(frozen=True, eq=False)
class Bending:
    """As `visref.rig.Motion`: objects whose vertices move on evenly, as by a morph target whose
    weight is the time. `positions`: (v, 3) of every object at time 0; `grown`: by object id,
    (v, 3) float32, what a second adds to them."""

    positions: Sequence[NDArray[Any]]
    grown: Mapping[int, Float32]
    clips: Sequence[str] = ("bending",)
    digest: str = "bending"
    skinned: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))

    def __post_init__(self) -> None:
        object.__setattr__(self, "skinned", np.zeros(len(self.positions), np.bool_))

    def affected(self, clip: int) -> NDArray[np.bool_]:
        result = np.zeros(len(self.positions), np.bool_)
        result[list(self.grown)] = True
        return result

    def at(self, clip: int, time_s: float) -> Moment:
        posed: dict[int, Float64] = {}
        for number, grown in self.grown.items():
            posed[number] = self.positions[number].astype(np.float64)
            posed[number] += np.multiply(grown, time_s, dtype=np.float64)
        worlds = np.tile(np.eye(4), (len(self.grown), 1, 1))
        return Moment(np.array(list(self.grown)), worlds, posed)


def rigged(scene: Scene, positions: Sequence[NDArray[Any]], motion: Motion) -> Scene:
    """The scene with what its motion poses it by; each object has its own vertices."""
    starts = np.cumsum([0, *map(len, positions)])
    count = scene.object_count
    worlds = np.tile(np.eye(4), (count, 1, 1))
    rig = Rig(list(positions), np.arange(count), worlds, starts, motion=motion)
    return replace(scene, rig=rig, motion=motion.digest)
