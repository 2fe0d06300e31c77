"""The exact engine: certifies whole frames."""

from __future__ import annotations

from visref.camera import Camera
from visref.engines.base import TruthEngine
from visref.exact import ExactScene
from visref.scene import Scene
from visref.visibility import FrameTruth


class ExactEngine(TruthEngine):
    """Every sample's owner in exact arithmetic, every tie listed."""

    name = "exact"
    exact = True
    summary = "exact arithmetic on every close call; lists every tie"

    def __init__(self, scene: Scene, *, threads: int | None = None) -> None:
        super().__init__(scene, threads=threads)
        self.arithmetic = ExactScene(scene, threads=threads)

    def pose(self, scene: Scene) -> None:
        self.scene = scene
        self.arithmetic.pose(scene)

    def frame(self, camera: Camera) -> FrameTruth:
        return self.arithmetic.certify(camera)
