"""What an entry of the catalogue is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tests.causes.families import FAMILIES
from visref.camera_path import CameraPath
from visref.culler import Culler
from visref.scene import Scene


@dataclass(frozen=True, eq=False)
class Input:
    """What is judged: a culler, new, on a scene along a path, whose sizes are in its cameras."""

    scene: Scene
    path: CameraPath
    culler: Culler


@dataclass(frozen=True)
class Fault:
    """A culler with one mistake, and where it is convicted of it.

    `name`: unique; what is before the first "/" says where it comes from. `family`: of
    `FAMILIES`. `mistake`: what is drawn by lot together: one mistake, in however many variants of
    a method and on however many scenes. `about`: what it gets wrong, in words.
    """

    name: str
    family: str
    mistake: str
    about: str
    make: Callable[[], Input]

    @property
    def source(self) -> str:
        return self.name.split("/")[0]

    @property
    def accepted(self) -> frozenset[str]:
        """The causes that would be right for it; empty where none describes it."""
        return FAMILIES[self.family]

    def __str__(self) -> str:
        return self.name
