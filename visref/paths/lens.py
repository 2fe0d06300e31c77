"""What the cameras of a path that is made here have in common."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from visref.camera import Camera, Float64
from visref.errors import InputError

# Vertical; 60 degrees.
DEFAULT_YFOV = math.pi / 3
# Half a day at 24 frames a second.
MAX_FRAMES = 1_000_000
# A frame of a path that is made: its camera's matrix as an array of its own, its fields, its JSON.
FRAME_BYTES = 4000
# An object's matrix in a frame, and its numbers in JSON.
MATRIX_BYTES = 1200


@dataclass(frozen=True)
class Lens:
    """An image's size in pixels, the vertical field of view in radians, and the range in world
    units; `near` None is for the maker of a path to choose. Raises InputError where no camera
    could have them."""

    width: int = 1280
    height: int = 960
    yfov: float = DEFAULT_YFOV
    near: float | None = None
    far: float = math.inf

    def __post_init__(self) -> None:
        # Any near below far: what is said of it comes with the camera that is made.
        self.camera(np.eye(4), min(1.0, self.far / 2))

    def camera(self, world_from_camera: Float64, near: float) -> Camera:
        """A camera at a pose, (4, 4) float64; `near` where the lens says nothing of it. Raises
        InputError as `Camera` does."""
        return Camera(
            world_from_camera,
            self.width,
            self.height,
            near if self.near is None else self.near,
            self.far,
            yfov=self.yfov,
        )

    @property
    def half_angle(self) -> float:
        """The smaller of half the vertical and half the horizontal angle of view, radians."""
        across = math.atan(math.tan(self.yfov / 2) * self.width / self.height)
        return min(self.yfov / 2, across)

    @property
    def corner(self) -> float:
        """How far a corner of the near plane is from the eye, over near."""
        up = math.tan(self.yfov / 2)
        return math.hypot(1.0, up, up * self.width / self.height)


def check_frames(frames: int, least: int = 1) -> None:
    """Raise InputError for too few frames, or more than a path may have here."""
    if not least <= frames <= MAX_FRAMES:
        raise InputError(f"--frames is {frames}", fix=f"give {least} to {MAX_FRAMES:,}")
