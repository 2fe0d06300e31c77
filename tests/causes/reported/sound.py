"""What the reported faults are made of: a culler without a mistake, in steps, and a register."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from tests.causes.reported.places import Place
from visref.camera import Camera
from visref.culler import Culler, DrawnSet
from visref.engines import make_engine
from visref.scene import Float64, Scene

# Boxes and depths come from other arithmetic than the samples: by far less than this.
SLACK = 1e-6
CORNERS = np.array(list(np.ndindex(2, 2, 2)))


class Sound(Culler):
    """Boxes against the six planes of the view, then the rectangle around each box, a pixel wider
    all round, against the farthest depth in it."""

    name = "reported"
    # Whether what is in the view is held against depth.
    asks = True

    def __init__(self, place: Place | None = None) -> None:
        self.place = place
        self._cast: tuple[Scene, object] | None = None

    def prepare(self, scene):
        self.first = self.before = self.scene = scene
        return scene.object_units()

    def update(self, scene):
        self.before, self.scene = self.scene, scene

    def cull(self, camera):
        return DrawnSet(np.flatnonzero(self.kept(camera)).astype(np.int32))

    def kept(self, camera: Camera):
        """(n,) bool, which objects are drawn."""
        boxes = self.boxes()
        kept = self.there()
        some = np.flatnonzero(kept)
        kept[some] = self.in_view(self.lens(camera), some, boxes[some])
        if self.asks:
            some = np.flatnonzero(kept)
            kept[some] = self.shows(camera, some, boxes[some])
        return kept

    # The steps.

    def there(self):
        """(n,) bool, the objects that there are."""
        low, high = self.scene.object_bounds[:, 0], self.scene.object_bounds[:, 1]
        return (low <= high).all(axis=1)

    def boxes(self) -> Float64:
        """(n, 2, 3) of every object."""
        return np.array(self.scene.object_bounds)

    def lens(self, camera: Camera) -> Camera:
        """The camera whose planes are tested."""
        return camera

    def in_view(self, camera: Camera, some, boxes):
        """(k,) bool of the objects `some`, (k,), whether their boxes may be in the view."""
        return ~outside(camera, corners(boxes)).all(axis=2).any(axis=0)

    def shows(self, camera: Camera, some, boxes):
        """(k,) bool of the objects `some`, (k,), whether their boxes may show before the depth."""
        depth = self.depth(camera)
        nearest = self.nearest(camera, boxes)
        result = nearest <= camera.near * (1.0 + SLACK)
        low, high = rectangles(camera, boxes)
        for at in np.flatnonzero(~result):
            result[at] = self.passes(depth, low[at], high[at], nearest[at])
        return result

    def depth(self, camera: Camera) -> Float64:
        """(height, width) view depths of what hides, inf for nothing."""
        return self.cast(self.scene, camera)

    def nearest(self, camera: Camera, boxes) -> Float64:
        """(k,) the least depth of each box."""
        return depths(camera, corners(boxes)).min(axis=1)

    def passes(self, depth, low, high, nearest) -> bool:
        """Whether anything in the rectangle, from column and row to column and row, is as far."""
        found = depth[low[1] : high[1] + 1, low[0] : high[0] + 1]
        return bool((found >= nearest * (1.0 - SLACK)).any())

    def cast(self, scene: Scene, camera: Camera) -> Float64:
        """(height, width) view depths of a scene."""
        if self._cast is None or self._cast[0] is not scene:
            self.close()
            self._cast = scene, make_engine("embree", scene, threads=1)
        return self._cast[1].frame(camera).buffer.depth

    def close(self):
        if self._cast is not None:
            self._cast[1].close()
            self._cast = None


class InView(Sound):
    """The six planes of the view alone."""

    asks = False


def corners(boxes) -> Float64:
    """(k, 8, 3) of (k, 2, 3) boxes."""
    axis = np.arange(3)
    return boxes[:, CORNERS, axis]


def places(camera: Camera, points) -> tuple[Float64, Float64]:
    """Of (k, m, 3) points: (k, m, 2) pixel coordinates and (k, m) depths."""
    pixels, depth = camera.pixel_of(points.reshape(-1, 3))
    return pixels.reshape(*points.shape[:2], 2), depth.reshape(points.shape[:2])


def depths(camera: Camera, points) -> Float64:
    """(k, m) depths of (k, m, 3) points."""
    return (points - camera.eye) @ camera.forward


def planes(camera: Camera) -> Float64:
    """(6, 4): the view is where n p + d >= 0 for each; left, right, bottom, top, near, far."""
    matrix = camera.clip_from_world()
    rows = np.stack([matrix[3] + s * matrix[i] for i in range(3) for s in (1, -1)])
    return rows / np.linalg.norm(rows[:, :3], axis=1, keepdims=True)


def outside(camera: Camera, points):
    """(6, k, m) bool, which of (k, m, 3) points are beyond which plane."""
    sides = planes(camera)
    signed = np.einsum("pi,kmi->pkm", sides[:, :3], points) + sides[:, 3, None, None]
    return signed < -SLACK * (1.0 + np.abs(points).max())


def rectangles(camera: Camera, boxes):
    """Pixels around (k, 2, 3) boxes that lie wholly beyond the eye: (k, 2) first and last column
    and row, a pixel wider all round; what ends before it starts is empty."""
    pixels, _ = places(camera, corners(boxes))
    last = np.array([camera.width, camera.height]) - 1
    with np.errstate(invalid="ignore"):
        low = np.nan_to_num(np.floor(pixels.min(axis=1)) - 1, nan=0.0)
        high = np.nan_to_num(np.ceil(pixels.max(axis=1)) + 1, nan=0.0)
    return np.clip(low, 0, last).astype(int), np.clip(high, 0, last).astype(int)


def spheres(boxes) -> tuple[Float64, Float64]:
    """(k, 3) centres and (k,) radii of the spheres around boxes."""
    return boxes.mean(axis=1), np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1) / 2


def sphere_in_view(camera: Camera, centre, radius):
    """(k,) bool, whether a sphere reaches into the view, as far as each plane tells alone."""
    sides = planes(camera)
    signed = centre @ sides[:, :3].T + sides[:, 3]
    return (signed >= -np.asarray(radius)[:, None] - SLACK).all(axis=1)


# The register.


@dataclass(frozen=True)
class Report:
    """A culler with the mistake that a report tells of. `source`: project and number."""

    culler: type[Sound]
    source: str
    family: str
    place: Callable[[], Place]

    @property
    def name(self) -> str:
        return re.sub(r"(?<!^)(?=[A-Z])", "-", self.culler.__name__).lower()


REPORTS: list[Report] = []
# Lots that were written later, each without a look at what was learned from those before.
LATER: list[Report] = []
RECENT: list[Report] = []
NEWEST: list[Report] = []


def _registering(
    reports: list[Report], source: str, family: str, place: Callable[[], Place]
) -> Callable[[type[Sound]], type[Sound]]:
    """Register a culler: who reported what it does, its family, and where it is tried."""

    def register(culler: type[Sound]) -> type[Sound]:
        reports.append(Report(culler, source, family, place))
        return culler

    return register


reported, later = partial(_registering, REPORTS), partial(_registering, LATER)
recent = partial(_registering, RECENT)
newest = partial(_registering, NEWEST)
