"""Truths that were cast before, as an engine: one cast serves however many cullers."""

from __future__ import annotations

from collections.abc import Sequence

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.engines.base import TruthEngine
from visref.scene import Scene
from visref.visibility import FrameTruth


class RecalledTruths(TruthEngine):
    """The exact engine's truths of a path's views, already cast, in the path's order.

    It knows the cameras of that path and no others. Raises ValueError where things move and a
    camera stands in two frames: which of their truths is meant?
    """

    name = "exact"
    summary = "exact truths cast before"
    exact = True

    def __init__(self, scene: Scene, path: CameraPath, truths: Sequence[FrameTruth]) -> None:
        super().__init__(scene)
        # The path keeps its cameras alive, so their identities are good keys.
        self._path = path
        cameras = [camera for frame in path.frames for camera in frame.cameras]
        self._truths = {id(c): truth for c, truth in zip(cameras, truths, strict=True)}
        if scene.moving is not None and len(self._truths) < len(truths):
            raise ValueError("one camera stands in two frames of a scene that moves")

    def pose(self, scene: Scene) -> None:
        """A truth is of its frame's moment already."""
        self.scene = scene

    def frame(self, camera: Camera) -> FrameTruth:
        return self._truths[id(camera)]
