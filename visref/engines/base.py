"""The interface of every truth engine."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from visref.camera import Camera
from visref.options import Option
from visref.scene import Int32, Scene
from visref.visibility import FrameTruth


class TruthEngine(ABC):
    """Says who owns which samples of a scene, frame after frame.

    Made once for a scene (this is where acceleration structures are built). `threads` None
    means all cores; the answer is the same for any number. Found by name through the
    entry-point group `visref.engines`, and named as `NAME[:option=value,…]`: the values of
    its `options` are further keyword arguments of the constructor.

    `exact`: every sample's owner is decided exactly and every tie is listed. Whoever asks how
    far a truth goes asks this: it is recorded in manifests and truth files.

    `ahead`: frames may be cast, in another thread, while others ask this engine or look at truths,
    each of which has its own arrays for as long as anybody holds them.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    options: ClassVar[Mapping[str, Option]] = {}
    exact: ClassVar[bool] = False
    ahead: ClassVar[bool] = False

    def __init__(self, scene: Scene, *, threads: int | None = None) -> None:
        self.scene = scene
        self.threads = threads

    @abstractmethod
    def frame(self, camera: Camera) -> FrameTruth:
        """The truth of one camera's samples. Unless the engine may cast `ahead`, its arrays may be
        reused by the next call."""

    def frames(self, cameras: Sequence[Camera]) -> list[FrameTruth]:
        """The truths of several cameras, each in arrays of its own. An engine that casts them
        together faster than one by one says how."""
        return [self.frame(camera).copy() for camera in cameras]

    def known_wrong(self, camera: Camera) -> tuple[Int32, int]:
        """Triangles that this camera shows for certain while the engine sees nothing there, or what
        lies behind: (k,) int32; and how many were asked for. An engine that leaves this as it is
        does not ask."""
        return np.zeros(0, np.int32), 0

    @property
    def unseen(self) -> tuple[Int32, int]:
        """As `known_wrong`, but of rays through the scene itself, before any camera looks at it."""
        return np.zeros(0, np.int32), 0

    def pose(self, scene: Scene) -> None:
        """Meet the scene as it stands now: called before a frame in which something has moved,
        appeared or vanished; triangles, objects and names are those that the engine was made
        with. An engine that leaves this as it is casts scenes that stand still."""

    @property
    def poses(self) -> bool:
        """Whether it can be asked to `pose`: whether its class says how."""
        return type(self).pose is not TruthEngine.pose

    def describe(self) -> str:
        """What it runs on here (library version, renderer, limits), for `visref doctor`."""
        return self.summary

    def close(self) -> None:
        """Free what the engine holds; it is not used afterwards."""
