"""Some frames of a path, for experiments whose one frame takes long."""

from __future__ import annotations

from visref.camera import Camera, CameraPath


def sampled(path: CameraPath, frames: int) -> list[Camera]:
    """At most so many cameras, in the middles of equal parts of a path."""
    count = min(frames, len(path))
    return [path.frames[(2 * k + 1) * len(path) // (2 * count)] for k in range(count)]
