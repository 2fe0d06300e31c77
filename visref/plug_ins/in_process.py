"""A culler of somebody else's in this process: to debug it, and for the speed of small calls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import Culler, CullerError, DrawnSet, Promise, Raster, fault_text
from visref.errors import InputError
from visref.registry import find_culler
from visref.scene import Scene, Units

R = TypeVar("R")


class BadSpec(InputError):
    """A spec that names no culler, or gives it what it does not take: its writer's fault."""


def make(spec: str) -> Culler:
    """The culler that a spec names, made in this process. Raises BadSpec, and CullerError for
    whatever goes wrong in its module or its constructor."""
    try:
        found, options = guarded(lambda: find_culler(spec), InputError)
    except InputError as error:
        raise BadSpec(str(error)) from error
    try:
        # A constructor may refuse a value that it was given.
        return guarded(lambda: found(**options), InputError if options else CullerError)
    except InputError as error:
        raise BadSpec(str(error)) from error


class CullerGuarded(Culler):
    """Stands for the culler that `spec` names: whatever is raised in it is its own fault, which
    ends neither the run nor the process. (What ends the process at once, or never comes back,
    does.) Raises BadSpec."""

    name = "guarded"

    def __init__(self, spec: str) -> None:
        self._unmade: CullerError | None = None
        self._culler: Culler | None = None
        try:
            self._culler = make(spec)
        except CullerError as error:
            self._unmade = error

    @property
    def _made(self) -> Culler:
        if self._culler is None:
            raise self._unmade or CullerError("it was closed")
        return self._culler

    @property
    def promise(self) -> Promise:  # type: ignore[override]
        return Promise.CONSERVATIVE if self._culler is None else self._culler.promise

    @property
    def joint(self) -> bool:  # type: ignore[override]
        return self._made.joint

    @property
    def moves(self) -> bool:
        return self._made.moves

    @property
    def memory(self) -> int | None:  # type: ignore[override]
        return self._made.memory

    @property
    def timed(self) -> bool:  # type: ignore[override]
        return self._made.timed

    @property
    def raster(self) -> Raster | None:  # type: ignore[override]
        return None if self._culler is None else self._culler.raster

    def prepare(self, scene: Scene) -> Units:
        return guarded(lambda: self._made.prepare(scene))

    def update(self, scene: Scene) -> None:
        guarded(lambda: self._made.update(scene))

    def cull(self, camera: Camera) -> DrawnSet:
        return guarded(lambda: self._made.cull(camera))

    def cull_joint(self, cameras: Sequence[Camera]) -> DrawnSet:
        return guarded(lambda: self._made.cull_joint(cameras))

    def bounds(self) -> NDArray[np.float64] | None:
        return guarded(lambda: self._made.bounds())

    def close(self) -> None:
        if self._culler is not None:
            culler, self._culler = self._culler, None
            guarded(culler.close)


def guarded(call: Callable[[], R], passing: type[Exception] = CullerError) -> R:
    """The call's result. Raises CullerError for whatever it raises but `passing`, and an interrupt,
    which may be the user's."""
    try:
        return call()
    except (CullerError, KeyboardInterrupt, passing):
        raise
    except BaseException as error:  # a plug-in may raise anything
        raise CullerError(fault_text(error)) from error
