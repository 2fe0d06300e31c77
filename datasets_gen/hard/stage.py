"""How a hard case is put together: exact cameras, cards in pixel coordinates, the right picture.

Everything is laid out so that the right answer is a closed form. Cameras look along an axis
and have a dyadic tan(yfov / 2) or ymag, so that the samples are dyadic numbers; a card is a
rectangle parallel to the image, given in pixels at its depth, so that it covers the samples
x0 <= x <= x1, y0 <= y <= y1 and no others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.scene import Scene
from visref_datasets_gen.dataset import Dataset, scene_of
from visref_datasets_gen.graph import Material, Mesh, Node, Primitive

Float64 = NDArray[np.float64]
Span = tuple[float, float]
SampleSpan = tuple[int, int]

TWO_SIDED = Material("two-sided", (0.6, 0.6, 0.6, 1.0))
ONE_SIDED = Material("one-sided", (0.6, 0.6, 0.6, 1.0), double_sided=False)


@dataclass(frozen=True)
class Patch:
    """Samples with the same owners: several are tied, none is background. `x` and `y` are
    inclusive; None is the whole image."""

    owners: tuple[str, ...]
    x: SampleSpan | None = None
    y: SampleSpan | None = None


def seen(*owners: str, x: SampleSpan | None = None, y: SampleSpan | None = None) -> Patch:
    """A patch; in a picture it covers the patches before it."""
    return Patch(owners, x, y)


Picture = Sequence[Patch]


@dataclass(frozen=True, eq=False)
class HardCase:
    """A scene, a path and the right verdict.

    `what`: what is hard and why the verdict is right. `pictures`: who owns each sample of
    each frame. `between`: objects whose visible area is positive, though they own no sample.
    `error`: where reading the scene must fail, what the message must say; then there is no
    picture. `cull_backfaces`: the setting that the verdict is for.
    """

    name: str
    what: str
    nodes: tuple[Node, ...]
    path: CameraPath
    pictures: tuple[Picture, ...] = ()
    between: tuple[str, ...] = ()
    error: tuple[str, ...] = ()
    cull_backfaces: bool = False

    @property
    def scene(self) -> Scene:
        """The scene. Raises InputError where the case is one of bad input."""
        return scene_of(self.dataset, cull_backfaces=self.cull_backfaces)

    @property
    def expected(self) -> dict[str, Any]:
        """The right verdict as written to NAME.expected.json.

        Per frame: `visible` (owns a sample, alone or tied), `tied` (those of them that own
        none alone), `hidden` (all others), and `owners`: patches of samples in painting
        order, over a background; x and y are inclusive.
        """
        result: dict[str, Any] = {"what": self.what, "cull_backfaces": self.cull_backfaces}
        if self.error:
            return result | {"error": list(self.error)}
        if self.between:
            result["visible_between_samples"] = list(self.between)
        return result | {"frames": [self._frame(k) for k in range(len(self.path))]}

    @property
    def dataset(self) -> Dataset:
        return Dataset(self.name, self.nodes, self.path, self.expected)

    def picture(self, frame: int) -> tuple[list[tuple[str, ...]], NDArray[np.int64]]:
        """The sets of owners of a frame, and by (height, width) sample the number of its set.
        The first set is the empty one, of background."""
        camera = self.path.cameras[frame]
        number: dict[tuple[str, ...], int] = {(): 0}
        which = np.zeros((camera.height, camera.width), np.int64)
        for patch in self.pictures[frame]:
            x = patch.x or (0, camera.width - 1)
            y = patch.y or (0, camera.height - 1)
            which[y[0] : y[1] + 1, x[0] : x[1] + 1] = number.setdefault(patch.owners, len(number))
        return list(number), which

    def _frame(self, frame: int) -> dict[str, Any]:
        camera = self.path.cameras[frame]
        sets, which = self.picture(frame)
        shown = [sets[number] for number in np.unique(which)]
        visible = {name for owners in shown for name in owners}
        alone = {owners[0] for owners in shown if len(owners) == 1}
        names = _object_names(self.nodes)
        patches = [
            {
                "x": list(patch.x or (0, camera.width - 1)),
                "y": list(patch.y or (0, camera.height - 1)),
                "owners": list(patch.owners),
            }
            for patch in self.pictures[frame]
        ]
        return {
            "visible": [name for name in names if name in visible],
            "tied": [name for name in names if name in visible - alone],
            "hidden": [name for name in names if name not in visible],
            "owners": patches,
        }


def _object_names(nodes: Sequence[Node]) -> list[str]:
    names: list[str] = []
    for node in nodes:
        names += [node.name] if node.mesh is not None else []
        names += _object_names(node.children)
    return names


@dataclass
class Stage:
    """One camera and what stands before it; turned into a case by `case`."""

    camera: Camera
    nodes: list[Node] = field(default_factory=list)

    def point(self, x: float, y: float, depth: float) -> Float64:
        """The world point, (3,) float64, of a (fractional) pixel at a view depth."""
        camera = self.camera
        a, b = 2.0 * x + 1.0 - camera.width, camera.height - 2.0 * y - 1.0
        reach = depth if camera.is_perspective else 1.0
        step = a * camera.right_step + b * camera.up_step
        return np.asarray(camera.eye + reach * step + depth * camera.forward)

    def add(
        self,
        name: str,
        points: Any,
        triangles: Any,
        *,
        material: Material = TWO_SIDED,
        matrix: Float64 | None = None,
        rounded: bool = False,
    ) -> None:
        """An object from world points, (v, 3); `triangles`: (t, 3) integers below v; `matrix`:
        (4, 4), the identity if None. The points must be float32 values unless `rounded`, for
        cases whose answer has room for the rounding."""
        exact = np.asarray(points, np.float64).reshape(-1, 3)
        single = exact.astype(np.float32)
        if not rounded and not np.array_equal(single.astype(np.float64), exact, equal_nan=True):
            raise AssertionError(f"{name} has a coordinate that is no float32")
        faces = np.asarray(triangles, np.uint32).reshape(-1, 3)
        mesh = Mesh(name, (Primitive(single, faces, material),))
        self.nodes.append(Node(name, mesh, np.eye(4) if matrix is None else matrix))

    def pixels(self, name: str, corners: Any, triangles: Any, **options: Any) -> None:
        """An object from (x, y, depth) corners, x and y in pixels."""
        self.add(name, [self.point(*corner) for corner in corners], triangles, **options)

    def card(self, name: str, depth: float, x: Span, y: Span, **options: Any) -> None:
        """A rectangle parallel to the image, facing the camera."""
        corners = [(x[0], y[1]), (x[1], y[1]), (x[1], y[0]), (x[0], y[0])]
        self.pixels(name, [(*corner, depth) for corner in corners], QUAD, **options)

    def wall(self, name: str, depth: float, **options: Any) -> None:
        """A card that covers every sample, with a pixel to spare."""
        self.card(name, depth, (-1.0, self.camera.width), (-1.0, self.camera.height), **options)

    def case(self, name: str, what: str, *picture: Patch, **options: Any) -> HardCase:
        """The case with this one frame."""
        pictures = () if options.get("error") else (picture,)
        return HardCase(
            name,
            " ".join(what.split()),
            tuple(self.nodes),
            CameraPath((self.camera,)),
            pictures,
            **options,
        )


QUAD = [[0, 1, 2], [0, 2, 3]]


def perspective(
    width: int = 8,
    height: int = 8,
    *,
    near: float = 0.5,
    far: float = 1024.0,
    eye: Sequence[float] = (0.0, 0.0, 0.0),
) -> Camera:
    """A camera that looks along -z with tan(yfov / 2) = 1/2 exactly: with a power of two for
    height, one pixel at depth d is d / height wide, exactly."""
    return Camera(_pose(eye), width, height, near, far, yfov=_yfov_of(0.5))


def orthographic(
    width: int = 8,
    height: int = 8,
    *,
    near: float = 0.5,
    far: float = 1024.0,
    ymag: float = 4.0,
    eye: Sequence[float] = (0.0, 0.0, 0.0),
) -> Camera:
    """A camera that looks along -z; a pixel is 2 * ymag / height wide."""
    return Camera(_pose(eye), width, height, near, far, ymag=ymag)


def turned(camera: Camera, right: Sequence[float], back: Sequence[float]) -> Camera:
    """The camera with other axes (exact ones: multiples of 90 degrees)."""
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 2] = right, back
    pose[:3, 1] = np.cross(pose[:3, 2], pose[:3, 0])
    pose[:3, 3] = camera.eye
    return replace(camera, world_from_camera=pose)


def _pose(eye: Sequence[float]) -> Float64:
    pose = np.eye(4)
    pose[:3, 3] = eye
    return pose


def _yfov_of(tangent: float) -> float:
    """The field of view whose half has exactly this tangent in float64.

    There is one near atan for 1/2: a step of yfov moves the tangent by 0.6 of the spacing of
    float64 there, so that no value is stepped over.
    """
    yfov = 2.0 * math.atan(tangent)
    for candidate in (yfov, math.nextafter(yfov, 0.0), math.nextafter(yfov, math.pi)):
        if math.tan(candidate / 2) == tangent:
            return candidate
    raise AssertionError(f"no float64 has the tangent {tangent}")
