"""Views of one's own scene as a source of trials: cameras where culling is hard.

A trial is a short walk: a few frames from one eye, for cullers with memory. Drawn anew, an eye is
anywhere in the scene, on a way through its free space, or close to a side of an object's box, and
looks anywhere, at an object, or past one; the search changes and crosses those that show something
new.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.camera_path import CameraPath, Frame
from visref.errors import InputError
from visref.paths.free_space import free_route
from visref.scene import Float64, Scene
from visref.search.case import Case

# A trial's images have about so many samples: as a thumbnail has, of the scene's own aspect.
_SAMPLES = 160 * 120
FRAMES = 3
# How a trial is drawn anew: anywhere, on a way through free space, or by an object's box.
_ANYWHERE, _ON_A_WAY = 0.2, 0.3
# Places on the way through free space.
_WAY = 64


@dataclass(frozen=True)
class Look:
    """A trial's cameras: `eye` in the scene's own coordinates, `yaw`, `pitch`, `roll` in radians,
    and what each further frame adds: `step` to the eye, `turn` to the yaw. `time_s`: the first
    frame's, of a scene that its file animates."""

    eye: tuple[float, float, float]
    yaw: float
    pitch: float
    roll: float = 0.0
    step: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: float = 0.0
    time_s: float = 0.0

    def pose(self, frame: int) -> Float64:
        """(4, 4) float64, world_from_camera of a frame."""
        yaw, pitch = self.yaw + frame * self.turn, self.pitch
        (sy, cy), (sp, cp) = ((math.sin(one), math.cos(one)) for one in (yaw, pitch))
        sr, cr = math.sin(self.roll), math.cos(self.roll)
        about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]])
        about_z = np.array([[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]])
        result = np.eye(4)
        result[:3, :3] = about_y @ about_x @ about_z
        result[:3, 3] = np.array(self.eye) + frame * np.array(self.step)
        return result


def _short(values: Sequence[float] | NDArray[Any]) -> tuple[float, float, float]:
    """In seven digits, as they are on disk."""
    x, y, z = (float(f"{value:.7g}") for value in values)
    return x, y, z


@dataclass(eq=False)
class ViewsOf:
    """Views of a scene. `lens`: a camera whose projection, range and aspect they have. `seed`: of
    the way through free space. `hard`: whether eyes are sought by objects and in free space; else
    they are anywhere in the scene's bounds, as a baseline."""

    scene: Scene
    lens: Camera
    seed: int = 0
    hard: bool = True
    cull_backfaces: bool = False
    animated: bool = False

    # Places of the scene, relative to its origin.

    @cached_property
    def _size(self) -> float:
        low, high = self.scene.core_bounds
        return max(float(np.linalg.norm(high - low)), 1e-9)

    @cached_property
    def _objects(self) -> NDArray[np.int64]:
        boxes = self.scene.object_bounds
        found = np.flatnonzero(np.all(boxes[:, 0] <= boxes[:, 1], axis=1))
        if not len(found):
            raise InputError("there is nothing to look at", source=self.scene.source)
        return found

    @cached_property
    def _way(self) -> Float64:
        """Points of a walk through free space, (k, 3) float64."""
        points, _ = free_route(self.scene, seed=self.seed, places=8)
        points = points - self.scene.origin
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        at = np.concatenate([[0.0], np.cumsum(lengths)])
        where = np.linspace(0.0, at[-1], _WAY)
        return np.stack([np.interp(where, at, points[:, axis]) for axis in range(3)], axis=1)

    # Drawing, changing, crossing.

    def random(self, rng: np.random.Generator) -> Look:
        how = float(rng.random())
        low, high = self.scene.core_bounds
        if not self.hard or how < _ANYWHERE:
            eye = rng.uniform(low, high)
        elif how < _ON_A_WAY:
            eye = self._way[int(rng.integers(_WAY))]
        else:
            eye = self._by_a_box(rng)
        look = self._looking(eye, rng)
        return self._walking(look, rng)

    def _by_a_box(self, rng: np.random.Generator) -> Float64:
        """A point on, just off or just inside a side of an object's box, or somewhat away from
        it."""
        box = self.scene.object_bounds[int(rng.choice(self._objects))]
        low, high = box
        at = rng.uniform(low, high)
        axis, side = int(rng.integers(3)), int(rng.integers(2))
        at[axis] = box[side][axis]
        # From a part of the near distance to the box's own size and more.
        reach = max(float(np.linalg.norm(high - low)), 1e-6 * self._size)
        off = self.lens.near * 10.0 ** rng.uniform(-1.0, 1.0)
        if rng.random() < 0.5:
            off = reach * 10.0 ** rng.uniform(-2.0, 1.0)
        outward = 1.0 if side else -1.0
        at[axis] += outward * off * (1.0 if rng.random() < 0.75 else -1.0)
        result: Float64 = at
        return result

    def _looking(self, eye: Float64, rng: np.random.Generator) -> Look:
        """From an eye anywhere, at an object, or past one so that it lies at the image's edge."""
        how = float(rng.random())
        if not self.hard or how < 0.3:
            way = rng.normal(size=3) * (1.0, 0.4, 1.0)
        else:
            low, high = self.scene.object_bounds[int(rng.choice(self._objects))]
            way = rng.uniform(low, high) - eye
        length = float(np.linalg.norm(way))
        way = way / length if length > 0.0 else np.array([0.0, 0.0, -1.0])
        yaw, pitch = math.atan2(-way[0], -way[2]), math.asin(float(np.clip(way[1], -1.0, 1.0)))
        if self.hard and how > 0.7:
            half = (self.lens.yfov or 1.0) / 2
            yaw += float(rng.choice([-1.0, 1.0])) * half * rng.uniform(0.9, 1.1) * self._aspect
        roll = float(rng.uniform(-math.pi, math.pi)) if self.hard and rng.random() < 0.1 else 0.0
        return Look(_short(eye), *_short((yaw, pitch, roll)))

    @property
    def _aspect(self) -> float:
        return self.lens.width / self.lens.height

    def _walking(self, look: Look, rng: np.random.Generator) -> Look:
        """The look with a step from frame to frame, from next to none to a large one."""
        reach = self._size * 10.0 ** rng.uniform(-5.0, -1.0)
        step = reach * rng.normal(size=3) * (1.0, 0.2, 1.0)
        turn = float(rng.choice([0.0, 10.0 ** rng.uniform(-3.0, 0.3)])) * rng.choice([-1.0, 1.0])
        time = float(rng.uniform(0.0, 10.0)) if self.animated else 0.0
        return replace(
            look, step=_short(step), turn=_short((turn, 0, 0))[0], time_s=_short((time, 0, 0))[0]
        )

    def changed(self, genome: Look, rng: np.random.Generator) -> Look:
        what = float(rng.random())
        if what < 0.45:
            reach = self._size * 10.0 ** rng.uniform(-6.0, -1.0)
            eye = np.array(genome.eye) + reach * rng.normal(size=3)
            return replace(genome, eye=_short(eye))
        if what < 0.75:
            angle = 10.0 ** rng.uniform(-3.0, 0.0)
            yaw, pitch = np.array([genome.yaw, genome.pitch]) + angle * rng.normal(size=2)
            pitch = float(np.clip(pitch, -1.57, 1.57))
            return replace(genome, yaw=_short((yaw, 0, 0))[0], pitch=_short((pitch, 0, 0))[0])
        if what < 0.85:
            return self._walking(genome, rng)
        if what < 0.95:
            other = self._looking(np.array(genome.eye), rng)
            return replace(genome, yaw=other.yaw, pitch=other.pitch, roll=other.roll)
        # A frame on.
        eye = np.array(genome.eye) + np.array(genome.step)
        return replace(genome, eye=_short(eye), yaw=_short((genome.yaw + genome.turn, 0, 0))[0])

    def crossed(self, one: Look, other: Look, rng: np.random.Generator) -> Look:
        if rng.random() < 0.5:
            share = float(rng.random())
            eye = (1.0 - share) * np.array(one.eye) + share * np.array(other.eye)
            return replace(one, eye=_short(eye))
        return replace(one, yaw=other.yaw, pitch=other.pitch, step=other.step, turn=other.turn)

    # JSON.

    def written(self, genome: Look) -> Any:
        return {**vars(genome), "eye": list(genome.eye), "step": list(genome.step)}

    def read(self, value: Any) -> Look:
        try:
            numbers = {name: float(value[name]) for name in ("yaw", "pitch", "roll", "turn")}
            eye, step = (tuple(map(float, value[name])) for name in ("eye", "step"))
            if len(eye) != 3 or len(step) != 3:
                raise ValueError
            return Look(eye=eye, step=step, time_s=float(value["time_s"]), **numbers)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError("it is no view of a scene", fix="begin anew elsewhere") from error

    # Cases.

    def frames(self, genome: Look) -> list[Frame]:
        """The frames of a trial, the first of which follows no other."""
        origin = (float(self.scene.origin[0]), float(self.scene.origin[1]),
                  float(self.scene.origin[2]))  # fmt: skip
        lens = self.small_lens
        return [
            Frame(
                (
                    replace(
                        lens, world_from_camera=genome.pose(k), cut=k == 0, origin=origin, view=""
                    ),
                ),
                time_s=genome.time_s + k / 10.0 if self.animated else None,
            )
            for k in range(FRAMES)
        ]

    @cached_property
    def small_lens(self) -> Camera:
        """The lens with a small image of its aspect."""
        lens = self.lens
        scale = min(1.0, math.sqrt(_SAMPLES / lens.samples))
        width, height = (max(1, round(scale * side)) for side in (lens.width, lens.height))
        return replace(
            lens, width=width, height=height, shift_x_px=lens.shift_x_px * scale,
            shift_y_px=lens.shift_y_px * scale, clip_plane=None,
        )  # fmt: skip

    def case(self, genome: Look) -> Case:
        return self.on(CameraPath(self.frames(genome), "views"))

    def on(self, path: CameraPath) -> Case:
        """The case of a path through the scene."""
        if self.animated:
            return Case.of(self.scene, path, cull_backfaces=self.cull_backfaces)
        # What stands still is made plain once.
        return replace(self._still, path=path.relative_to(np.zeros(3)))

    @cached_property
    def _still(self) -> Case:
        path = CameraPath([self.small_lens], "views")
        return Case.of(self.scene, path, rest_pose=True, cull_backfaces=self.cull_backfaces)

    def called(self, case: Case) -> Callable[[int], str]:
        """Each is its own."""
        return str
