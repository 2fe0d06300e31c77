"""Three scenes without symmetry, their paths, and two sound recorders that share nothing with what
they check: one lists what owns a sample, the other what its frustum touches."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath, Frame
from visref.engines import make_engine
from visref.inputs import open_scene
from visref.recordings.visible_sets import VisibleSets
from visref.scene import Scene
from visref.timeline import Timeline

WIDTH, HEIGHT = 96, 60


def box(low, high):
    """Twelve triangles, outward."""
    low, high = np.array(low, float), np.array(high, float)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [[a, b, c] for a, b, c, _ in faces] + [[a, c, d] for a, _, c, d in faces]
    return low + corners * (high - low), np.array(triangles)


def cameras(eyes, targets, *, far=400.0, yfov=0.9, shift=(0.0, 0.0)) -> CameraPath:
    return CameraPath(
        [
            Camera(
                look_at(eye, target),
                WIDTH,
                HEIGHT,
                near=0.2,
                far=far,
                yfov=yfov,
                shift_x_px=shift[0],
                shift_y_px=shift[1],
            )
            for eye, target in zip(eyes, targets, strict=True)
        ]
    )


def yard(shift=(0.0, 0.0)) -> tuple[Scene, CameraPath]:
    """Posts and blocks strewn over a slope, with a walk among them that turns and looks down."""
    rng = np.random.default_rng(5)
    objects = []
    for index in range(220):
        x, z = rng.uniform(-30, 45), rng.uniform(-50, 25)
        y = 0.15 * x + 0.05 * z
        size = rng.uniform(0.4, 2.2, 3) * (1, rng.choice((0.6, 2.5)), 1)
        objects.append((f"block{index}", *box((x, y, z), np.add((x, y, z), size))))
    t = np.arange(24)
    eyes = np.stack([-8 + 1.1 * t, 3.5 + 0.25 * t, 9 - 1.9 * t], axis=1)
    ahead = np.stack([np.sin(0.3 * t), np.full(24, -0.28), -np.cos(0.3 * t)], axis=1)
    return Scene.from_objects(objects), cameras(eyes, eyes + ahead, shift=shift)


def rooms(shift=(0.0, 0.0)) -> tuple[Scene, CameraPath]:
    """A house of three floors with furnished rooms, walls with doors, and a way up through it."""
    rng = np.random.default_rng(11)
    objects = []
    for floor in range(3):
        y = 3.0 * floor
        for i in range(5):
            for k in range(4):
                x, z = 6.0 * i, 5.0 * k
                at = f"{floor}-{i}-{k}"
                objects.append((f"floor{at}", *box((x, y - 0.1, z), (x + 6, y, z + 5))))
                door = rng.uniform(1.0, 3.5)
                objects.append((f"wall{at}a", *box((x, y, z), (x + 0.1, y + 2.8, z + door))))
                objects.append(
                    (f"wall{at}b", *box((x, y, z + door + 1), (x + 0.1, y + 2.8, z + 5)))
                )
                objects.append((f"pane{at}", *box((x, y, z), (x + 0.9 + door, y + 2.2, z + 0.1))))
                for n in range(3):
                    low = np.array([x + rng.uniform(0.5, 5), y, z + rng.uniform(0.5, 4.2)])
                    objects.append((f"chair{at}-{n}", *box(low, low + rng.uniform(0.2, 0.9, 3))))
    t = np.arange(20)
    eyes = np.stack([2 + 1.2 * t, 1.7 + 3.0 * (t // 7), 3 + 0.7 * t], axis=1)
    ahead = np.stack([np.cos(0.45 * t), np.full(20, -0.12), np.sin(0.45 * t)], axis=1)
    return Scene.from_objects(objects), cameras(eyes, eyes + ahead, yfov=1.0, shift=shift)


@cache
def _city() -> tuple[Scene, CameraPath]:
    scene, path, _ = open_scene("city:scale=0.15,seed=3")
    assert path is not None
    return scene, path


def city(shift=(0.0, 0.0)) -> tuple[Scene, CameraPath]:
    """A small generated city and its walk."""
    scene, path = _city()
    keep = path.frames[:: max(1, len(path) // 24)]
    made = [
        replace(
            frame.cameras[0],
            width=WIDTH,
            height=HEIGHT,
            shift_x_px=shift[0],
            shift_y_px=shift[1],
            cut=False,
        )
        for frame in keep
    ]
    return scene, CameraPath(made)


SCENES = {"yard": yard, "rooms": rooms, "city": city}


def owners(scene: Scene, path: CameraPath) -> dict[int, dict[str, np.ndarray]]:
    """By frame and view, the objects that own a sample of the whole picture."""
    engine = make_engine("embree", scene, threads=1)
    result = {}
    for number in path.numbers:
        sets = {}
        for camera in path.views(number):
            triangle = engine.frame(camera).buffer.triangle
            sets[camera.view] = np.unique(scene.object_of_triangle[triangle[triangle >= 0]])
        result[number] = sets
    engine.close()
    return result


def touched(scene: Scene, path: CameraPath) -> dict[int, dict[str, np.ndarray]]:
    """By frame and view, the objects whose eight corners are not all beyond one clip plane."""
    low, high = scene.object_bounds[:, 0], scene.object_bounds[:, 1]
    corners = np.stack(
        [np.where(np.array(pick), high, low) for pick in np.ndindex(2, 2, 2)], axis=1
    )
    corners = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=2)
    result = {}
    for number in path.numbers:
        sets = {}
        for camera in path.views(number):
            clip = corners @ camera.clip_from_world().T
            w = clip[..., 3:]
            beyond = np.concatenate([clip[..., :3] < -w, clip[..., :3] > w], axis=2)
            sets[camera.view] = np.flatnonzero(~beyond.all(axis=1).any(axis=1))
        result[number] = sets
    return result


RECORDERS = {"owners": owners, "frustum": touched}


def visible_sets(scene: Scene, sets) -> VisibleSets:
    return VisibleSets(
        {
            frame: {view: np.asarray(ids, np.int32) for view, ids in views.items()}
            for frame, views in sets.items()
        },
        {},
        scene.object_units(),
    )


def timeline_of(scene: Scene, path: CameraPath) -> Timeline:
    return Timeline(scene, path)


def two_eyes(path: CameraPath) -> CameraPath:
    """Each camera as a wide pair that looks to either side, as in a cave of screens."""
    frames = []
    for camera in path.cameras:
        made = []
        for name, turn in (("left", 0.5), ("right", -0.5)):
            c, s = np.cos(turn), np.sin(turn)
            pose = camera.world_from_camera.copy()
            pose[:3, :3] = pose[:3, :3] @ [[c, 0, s], [0, 1, 0], [-s, 0, c]]
            made.append(
                Camera(
                    pose,
                    camera.width,
                    camera.height,
                    camera.near,
                    camera.far,
                    yfov=camera.yfov,
                    view=name,
                )
            )
        frames.append(Frame(tuple(made)))
    return CameraPath(frames)
