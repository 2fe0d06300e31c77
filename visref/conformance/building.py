"""What the scenes of `visref.conformance` are made of: meshes, cameras, and how they make a case.

Every scene is made of plain arrays and needs no file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.masks.materials import MaskMaterial, Sampler
from visref.masks.store import Masks
from visref.masks.textures import AlphaImage
from visref.scene import Alpha, Float64, Scene, Units

WIDTH, HEIGHT = 64, 48

Mesh = tuple[NDArray[Any], NDArray[Any]]
Point = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Case:
    """A scene and the path it is seen along. `units`: of a scene that is about clusters, what an
    engine in clusters decides about; None where that is the objects."""

    scene: Scene
    path: CameraPath
    units: Units | None = None


@dataclass(frozen=True)
class SceneMaker:
    """A named scene. `claim` says what a safe culler does on it, `trap` what goes wrong, `moves`
    whether anything in it does."""

    name: str
    claim: str
    trap: str
    build: Callable[[np.random.Generator], Case]
    moves: bool = False


Build = Callable[..., Case]


def register_in(
    scenes: list[SceneMaker], *, moves: bool = False
) -> Callable[[str, str], Callable[[Build], Build]]:
    """A decorator that puts scenes into a list, with their claim and the usual trap. `moves`:
    whether things move in them."""

    def scene(claim: str, trap: str) -> Callable[[Build], Build]:
        def register(build: Build) -> Build:
            scenes.append(SceneMaker(build.__name__, claim, trap, build, moves))
            return build

        return register

    return scene


_BOX_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5],
        [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
        [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def box(low: Point | Float64, high: Point | Float64) -> Mesh:
    """A closed box from two corners, (3,) each; its faces counter-clockwise seen from outside."""
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
    """The world point, (3,) float64, that falls on pixel coordinates (x, y), integers being
    centres."""
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


@dataclass(frozen=True, eq=False)
class Cutout:
    """An object's alpha mask. `uv`: (v, 2) texture coordinates, one per vertex of its mesh, which
    float32 can hold. `texels`: (h, w) uint8, 255 for solid and 0 for a hole, row 0 where v is 0,
    repeated beyond. `nearest`: a lookup is one texel."""

    uv: NDArray[Any]
    texels: NDArray[np.uint8]
    nearest: bool = True


def cut_out(built: Case, cutouts: Mapping[str, Cutout]) -> Case:
    """The case with alpha masks, by object name, on objects whose material is MASK."""
    scene = built.scene
    row = np.full(scene.triangle_count, -1)
    uv: list[NDArray[Any]] = []
    material: list[int] = []
    materials: list[MaskMaterial] = []
    images: list[AlphaImage] = []
    for index, name in enumerate(scene.names):
        if name not in cutouts:
            continue
        mask = cutouts[name]
        part = slice(*scene.object_offsets[index : index + 2])
        faces = scene.triangles[part] - scene.triangles[part].min()
        row[part] = len(material) + np.arange(len(faces))
        uv.append(mask.uv[faces])
        material += [len(materials)] * len(faces)
        materials.append(MaskMaterial(len(images), Sampler(nearest=mask.nearest)))
        images.append(AlphaImage(mask.texels, 255))
    masks = Masks.build(
        row, np.array(material), np.concatenate(uv), np.ones((len(material), 3)), materials, images
    )
    return replace(built, scene=replace(scene, masks=masks))


def clusters(scene: Scene, parts: Sequence[Sequence[int]]) -> Units:
    """Units of the scene's triangles, a list of triangle ids each."""
    offsets = np.cumsum([0, *map(len, parts)])
    triangles = np.concatenate([np.asarray(part, np.int32) for part in parts])
    return Units(offsets, triangles, "cluster")


def city(rng: np.random.Generator, side: int = 6) -> list[tuple[str, Mesh]]:
    """Houses on a square grid, 8 apart, and the ground below them; streets run at 0, 8, ..."""
    objects = [("ground", box((-80.0, -1.0, -80.0), (80.0, 0.0, 80.0)))]
    for i in range(side):
        for j in range(side):
            centre = np.array([8.0 * (i - side / 2) + 4.0, 0.0, 8.0 * (j - side / 2) + 4.0])
            half = rng.uniform(1.2, 3.4, 3) * (1.0, 0.0, 1.0)
            height = np.array([0.0, rng.uniform(1.5, 9.0), 0.0])
            objects.append(("house", box(centre - half, centre + half + height)))
    return objects


def walk(rng: np.random.Generator, frames: int, **changes: Any) -> list[Camera]:
    """A walk along a street of the city at eye height, looking about."""
    views = []
    for frame in range(frames):
        z = 20.0 - 5.0 * frame
        aside = rng.uniform(-0.6, 0.6)
        views.append(camera((0.3, 1.6, z), (0.3 + aside, 1.6 + 0.2 * aside, z - 1.0), **changes))
    return views
