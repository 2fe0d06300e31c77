"""Shrinking: a case to the smallest that still shows the same fault.

Source: Zeller and Hildebrandt's delta debugging (`visref.search.ddmin`) over frames, views, objects
and triangles; what is no list (image, camera, coordinates, materials, motion) is tried in simpler
forms, the simplest first. Passes are repeated until none finds anything; each step lowers
`cost_of`, so that they end.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from visref.camera import Camera
from visref.errors import InputError
from visref.scene import Alpha
from visref.search import edits
from visref.search.case import Case
from visref.search.ddmin import ddmin
from visref.search.holding import Holding, Progress
from visref.search.judging import Violation

T = TypeVar("T")

# Sides of an image that are tried, the smallest first: fewer samples show nobody anything.
_SIDES = ((8, 6), (8, 8), (12, 9), (16, 12), (16, 16), (32, 24), (32, 32), (64, 48), (64, 64),
          (128, 96), (256, 192), (512, 384), (1024, 768))  # fmt: skip
# A part of the image is cut out of it where the whole has more samples than this.
_SAMPLES_FOR_PEOPLE = 64 * 64
# So many objects and triangles anybody looks through.
_OBJECTS, _TRIANGLES = 9, 49
_FIELDS_OF_VIEW = (1.0, 1.5, 0.5, 2.0, 0.1)


@dataclass(frozen=True, eq=False)
class Shrunk:
    """What is left. `violation`: what it shows, in its last frame; `trials`: how many cases were
    judged; `whole`: whether nothing more can be left out (the effort was enough); `first_cause`:
    the cause that was named before the first step, "" for none."""

    case: Case
    violation: Violation
    trials: int
    whole: bool
    first_cause: str = ""


def shrink(case: Case, holding: Holding, progress: Progress | None = None) -> Shrunk:
    """The smallest case found, from one whose last frame shows what `holding` wants. A cause that
    is wanted is named at every step; where that leaves more than people look through, and it is not
    firm, it goes on to where nothing is named. Raises InputError where the case does not show it,
    or where no file can say what is left."""
    found = holding.at(case)
    if found is None:
        raise InputError(
            f"object '{holding.wanted.name}' is not lost in the last frame of the case"
            if holding.wanted.left_out
            else f"object '{holding.wanted.name}' is not drawn for nothing in the last frame"
        )
    shrinker = _Shrinker(case, found, holding, progress or (lambda *_: None))
    shrinker.run()
    scene = shrinker.case.scene
    large = scene.object_count > _OBJECTS or scene.triangle_count > _TRIANGLES
    if holding.wanted.cause and not holding.firm and large:
        holding.untold = True
        shrinker.run()
    return Shrunk(
        shrinker.case, shrinker.found, holding.trials, not holding.spent, holding.first_cause
    )


def cost_of(case: Case) -> tuple[int, ...]:
    """What is to be lowered, what weighs most first: frames, views, objects, triangles, samples,
    equal names and materials, motion, and the digits of cameras, of matrices and of vertices."""
    scene, frames = case.scene, case.path.frames
    cameras = [camera for frame in frames for camera in frame.cameras]
    looks = int(np.count_nonzero(scene.alpha)) + int(np.count_nonzero(scene.one_sided))
    looks += 0 if scene.masks is None else 1
    looks += scene.object_count - len(set(scene.given_names))
    motion = sum(len(frame.world_from_object) + len(frame.absent) for frame in frames)
    motion += sum(map(len, case.shapes.values()))
    poses = [m for frame in frames for m in frame.world_from_object.values()]
    vertices = [scene.vertices, *case.shapes.values()]
    return (
        len(frames),
        len(cameras),
        scene.object_count,
        scene.triangle_count,
        sum(camera.samples for camera in cameras),
        looks,
        motion,
        int(scene.origin.any()) + sum(map(_camera_digits, cameras)),
        sum(_digits(value) for matrix in poses for value in matrix[:3].reshape(-1).tolist()),
        sum(_digits(v) for own in vertices for v in own.reshape(-1).astype(float).tolist())
        if scene.triangle_count <= _FEW
        else 0,
    )


# Of more triangles nobody counts the digits.
_FEW = 2000


def _digits(value: float) -> int:
    """How long a number is, as people write it: 0 for none."""
    if value == 0.0:
        return 0
    short = np.float32(value)
    text = str(short) if float(short) == value else repr(value)
    return len(text.removesuffix(".0"))


def _camera_digits(camera: Camera) -> int:
    numbers = [
        *camera.world_from_camera[:3].reshape(-1).tolist(),
        camera.near,
        camera.yfov or camera.ymag or 0.0,
        camera.shift_x_px,
        camera.shift_y_px,
        *(camera.clip_plane or ()),
    ]
    # An endless range is simplest; a name and a jump are something to be said, too.
    far = 0 if math.isinf(camera.far) else _digits(camera.far)
    return sum(map(_digits, numbers)) + far + len(camera.view) + camera.cut


class _Shrinker:
    def __init__(self, case: Case, found: Violation, holding: Holding, progress: Progress) -> None:
        self.case, self.found = case, found
        self._holding, self._progress, self._step = holding, progress, ""

    def run(self) -> None:
        passes: list[tuple[str, Callable[[], None]]] = [
            ("frames", self._frames),
            ("views", self._views),
            ("objects", self._objects),
            ("triangles", self._triangles),
            ("names", lambda: self._once(edits.told_apart)),
            ("materials", self._materials),
            ("motion", self._motion),
            ("image", self._image),
            ("camera", self._camera),
            ("matrices", self._matrices),
            ("coordinates", self._coordinates),
        ]
        before = ""
        while before != self.case.digest and not self._holding.spent:
            before = self.case.digest
            for name, one in passes:
                self._step = name
                one()

    # One step.

    def _try(self, make: Callable[[], Case]) -> bool:
        """Take a simpler case, if it is one and it holds."""
        try:
            case = make()
        except InputError:
            return False
        if cost_of(case) >= cost_of(self.case):
            return False
        return self._take(case)

    def _once(self, change: Callable[[Case], Case]) -> None:
        self._try(lambda: change(self.case))

    def _take(self, case: Case) -> bool:
        found = self._holding.at(case)
        self._progress(self._step, self._holding.trials, self.case)
        if found is None:
            return False
        self.case, self.found = case, found
        return True

    def _fewest(self, items: Sequence[T], make: Callable[[list[T]], Case]) -> list[T]:
        """Keep as few of the items as can be; `make` makes a case of some of them."""

        def fails(kept: list[T]) -> bool:
            if self._holding.spent:
                return False
            try:
                case = make(kept)
            except InputError:
                return False
            return self._take(case)

        return ddmin(items, fails)

    # What there is less of.

    def _frames(self) -> None:
        base = self.case
        last = len(base.path) - 1
        self._fewest(range(last), lambda kept: edits.only_frames(base, [*kept, last]))

    def _views(self) -> None:
        base = self.case
        names = [camera.view for camera in base.path.frames[-1].cameras]
        every = dict.fromkeys(
            [*names, *(c.view for frame in base.path.frames for c in frame.cameras)]
        )
        if len(every) > 1:
            self._fewest(list(every), lambda kept: edits.only_views(base, kept))
        if all(len(frame.cameras) == 1 for frame in self.case.path.frames):
            self._try(lambda: edits.each_camera(self.case, lambda c: replace(c, view="")))

    def _objects(self) -> None:
        base, name = self.case, self._holding.wanted.name
        others = [one for one in base.scene.names if one != name]
        self._fewest(others, lambda kept: edits.only_objects(base, {name, *kept}))

    def _triangles(self) -> None:
        base = self.case
        if base.scene.triangle_count > 1:
            every = range(base.scene.triangle_count)
            self._fewest(every, lambda kept: edits.only_triangles(base, kept))

    # What is plainer.

    def _materials(self) -> None:
        for change, special in ((edits.opaque, self._alphas), (edits.two_sided, self._sides)):
            if names := special():
                base = self.case
                self._fewest(names, lambda kept, b=base, c=change, n=names: c(  # type: ignore[misc]
                    b, [one for one in n if one not in kept]
                ))  # fmt: skip

    def _alphas(self) -> list[str]:
        scene = self.case.scene
        return [
            scene.names[i]
            for i in np.unique(scene.object_of_triangle[scene.alpha != Alpha.OPAQUE]).tolist()
        ]

    def _sides(self) -> list[str]:
        scene = self.case.scene
        found = np.unique(scene.object_of_triangle[scene.one_sided]).tolist()
        return [scene.names[i] for i in found]

    def _motion(self) -> None:
        base = self.case
        absences = [(k, n) for k, frame in enumerate(base.path.frames) for n in frame.absent]
        if absences:
            self._fewest(absences, lambda kept: edits.with_absences(base, set(kept)))
        base = self.case
        moving = dict.fromkeys(
            name for frame in base.path.frames for name in frame.world_from_object
        )
        names = [*moving, *(base.scene.names[index] for index in base.shapes)]
        if names:
            self._fewest(
                names,
                lambda kept: edits.stopped(base, [one for one in names if one not in kept]),
            )

    def _image(self) -> None:
        camera = self.case.path.frames[-1].cameras[0]
        for width, height in _SIDES:
            if self._try(lambda w=width, h=height: edits.resized(self.case, w, h)):  # type: ignore[misc]
                return
        if camera.samples <= _SAMPLES_FOR_PEOPLE:
            return
        seen = self._seen_in()
        for width, height in _SIDES:
            if width >= seen.width or height >= seen.height:
                return
            x = min(max(self.found.x - width // 2, 0), seen.width - width)
            y = min(max(self.found.y - height // 2, 0), seen.height - height)
            if self._try(
                lambda x=x, y=y, w=width, h=height: edits.cut_out(self.case, x, y, w, h)  # type: ignore[misc]
            ):
                return

    def _seen_in(self) -> Camera:
        cameras = self.case.path.frames[-1].cameras
        return next((c for c in cameras if c.view == self.found.seen_in), cameras[0])

    def _camera(self) -> None:
        if self.case.scene.triangle_count <= _FEW:
            self._try(lambda: edits.to_the_eye(self.case, turned=True)) or self._try(
                lambda: edits.to_the_eye(self.case, turned=False)
            )
        self._try(lambda: edits.each_camera(self.case, lambda c: replace(c, cut=False)))
        self._try(lambda: edits.with_lens(self.case, {"clip_plane": None}))
        self._try(lambda: edits.with_lens(self.case, {"shift_x_px": 0.0, "shift_y_px": 0.0}))
        camera = self.case.path.frames[-1].cameras[0]
        if camera.shift_x_px or camera.shift_y_px:
            self._try(lambda: edits.to_the_eye(edits.aimed(self.case), turned=True))
        for pose in _simpler_poses(camera):
            if self._try(lambda p=pose: edits.each_camera(self.case, p)):  # type: ignore[misc]
                break
        for name, values in (
            ("yfov", (*_FIELDS_OF_VIEW, *_shorter(camera.yfov))),
            ("ymag", (1.0, *_shorter(camera.ymag))),
            ("near", (1.0, 0.1, 0.01, *_shorter(camera.near))),
            ("far", (math.inf, 10.0, 100.0, 1000.0, *_shorter(camera.far))),
        ):
            for value in values:
                if self._try(lambda n=name, v=value: edits.with_lens(self.case, {n: v})):  # type: ignore[misc]
                    break

    def _matrices(self) -> None:
        if not any(frame.world_from_object for frame in self.case.path.frames):
            return
        for digits in range(4):
            for only_moved in (True, False):
                if self._try(
                    lambda d=digits, m=only_moved: edits.rounded_poses(self.case, d, only_moved=m)  # type: ignore[misc]
                ):
                    return

    def _coordinates(self) -> None:
        """All vertices to whole numbers but as few as can be; those to a digit more, and so on."""
        scene = self.case.scene
        if not 0 < scene.triangle_count <= _FEW:
            return
        size = float(np.abs(scene.vertices).max(initial=0.0))
        first = -math.floor(math.log10(size)) if size > 0.0 else 0
        for digits in range(first, first + 6):
            base = self.case
            long = edits.not_so_short(base, digits).tolist()
            if long:
                self._fewest(long, lambda kept, b=base, d=digits: self._cheaper(  # type: ignore[misc]
                    b, edits.rounded_vertices(b, d, kept)
                ))  # fmt: skip

    @staticmethod
    def _cheaper(base: Case, case: Case) -> Case:
        if cost_of(case) >= cost_of(base):
            raise InputError("it is no simpler")
        return case


def _shorter(value: float | None) -> Iterator[float]:
    """The number with one significant digit, two and three."""
    if value is not None and math.isfinite(value):
        for digits in (1, 2, 3):
            yield float(f"{value:.{digits}g}")


def _simpler_poses(last: Camera) -> Iterator[Callable[[Camera], Camera]]:
    """Ways to make poses simpler: that of the last frame in all, the nearest along the axes, an eye
    with few digits."""
    yield lambda camera: replace(camera, world_from_camera=last.world_from_camera)

    def rounded(camera: Camera, digits: int, *, along: bool) -> Camera:
        pose = camera.world_from_camera.copy()
        pose[:3, 3] = np.round(pose[:3, 3], digits) + 0.0
        if along:
            pose[:3, :3] = _along_axes(pose[:3, :3])
        return replace(camera, world_from_camera=pose)

    for along in (True, False):
        for digits in range(4):
            yield lambda c, d=digits, a=along: rounded(c, d, along=a)  # type: ignore[misc]


def _along_axes(
    rotation: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """The rotation by right angles that comes near to this one."""
    result = np.zeros((3, 3))
    left = np.abs(rotation).copy()
    for _ in range(2):
        row, column = np.unravel_index(int(np.argmax(left)), (3, 3))
        result[row, column] = np.sign(rotation[row, column])
        left[row, :] = -1.0
        left[:, column] = -1.0
    row, column = np.unravel_index(int(np.argmax(left)), (3, 3))
    result[row, column] = 1.0
    if np.linalg.det(result) < 0.0:
        result[row, column] = -1.0
    return result
