"""Who casts a run's truths, and when.

Each view is cast once. While a frame is judged the next one's views may be cast already, where
nothing moves and the engine allows it: a cast uses all cores, and judging mostly one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace

from visref.camera import Camera
from visref.engines.base import TruthEngine
from visref.engines.exact import ExactEngine
from visref.errors import InputError
from visref.exact import ExactScene
from visref.judging.rounding import greatest_move
from visref.judging.summary import Caster, Moved
from visref.scene import Scene
from visref.stopwatch import Stopwatch
from visref.visibility import FrameTruth, ObjectVisibility, objects_seen

Cast = tuple[FrameTruth, ObjectVisibility]


@dataclass(frozen=True, eq=False)
class ViewCast:
    """A view's truth, who is seen in it, and the milliseconds that took."""

    truth: FrameTruth
    seen: ObjectVisibility
    ms: float


# A truth, and the milliseconds of its cast.
_Timed = tuple[FrameTruth, float]


class Casting:
    """The truths of a run's views. `engine` makes the engine on first use."""

    def __init__(self, engine: Callable[[], TruthEngine], threads: int | None) -> None:
        self._make = engine
        self._threads = threads
        self._engine: TruthEngine | None = None
        self._exact: ExactScene | None = None
        self._next: tuple[int, Future[list[_Timed]]] | None = None
        self._thread: ThreadPoolExecutor | None = None
        # By frame, by how many pixels rounding moved a vertex that is seen, whose triangle it is,
        # and for which cullers that frame was cast: nobody where it was for the truth itself.
        self.moved: dict[int, Moved] = {}

    @property
    def engine(self) -> TruthEngine | None:
        """The engine, once it has cast, while it casts nothing. What it cast ahead is cast again,
        since whoever asks may let it cast into the same arrays."""
        self._drop()
        return self._engine

    @property
    def caster(self) -> Caster | None:
        """What is said of the engine, once it has cast."""
        return None if self._engine is None else Caster.of(self._engine)

    def views(
        self,
        frame: int,
        cameras: Sequence[Camera],
        scene: Scene,
        following: tuple[int, Sequence[Camera]] | None = None,
    ) -> list[ViewCast]:
        """A frame's views, of the scene as it stands in it. `following`: the frame to be cast while
        others look at this one, of the same scene; if the engine allows it."""
        if self._next is not None and self._next[0] == frame:
            future, self._next = self._next[1], None
            found = future.result()
        else:
            found = _cast(self._made(scene), cameras, keep=len(cameras) > 1)
        engine = self._engine
        if following is not None and engine is not None and engine.ahead:
            self._begin(engine, *following)
        return [self._gathered(frame, *one, scene) for one in found]

    def view(self, frame: int, camera: Camera, scene: Scene) -> Cast:
        """One view of a frame, in arrays of its own."""
        ((truth, ms),) = _cast(self._made(scene), [camera], keep=True)
        found = self._gathered(frame, truth, ms, scene)
        return found.truth, found.seen

    def _begin(self, engine: TruthEngine, frame: int, cameras: Sequence[Camera]) -> None:
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1)
        keep = len(cameras) > 1
        cast = self._thread.submit(_cast, engine, cameras, keep=keep)
        self._next = frame, cast

    def _gathered(self, frame: int, truth: FrameTruth, ms: float, scene: Scene) -> ViewCast:
        with Stopwatch() as watch:
            seen = objects_seen(truth, scene)
            pixels, triangle = greatest_move(scene, truth)
            self.moved.setdefault(frame, Moved(frame)).grow(pixels, triangle, scene)
        return ViewCast(truth, seen, ms + watch.ms)

    def pose(self, scene: Scene) -> None:
        """Let those who cast or calculate meet the scene as it stands now."""
        self._drop()
        if self._exact is not None and not isinstance(self._engine, ExactEngine):
            self._exact.pose(scene)
        if self._engine is not None:
            self._engine.pose(scene)

    def arithmetic(self, scene: Scene) -> ExactScene:
        """The exact engine's, where that casts, else one that is made on first use."""
        if self._exact is None:
            if isinstance(self._engine, ExactEngine):
                self._exact = self._engine.arithmetic
            else:
                self._exact = ExactScene(scene, threads=self._threads)
        return self._exact

    def close(self) -> None:
        """Let the engine go."""
        self._drop()
        if self._thread is not None:
            self._thread.shutdown()
        if self._engine is not None:
            self._engine.close()

    def _made(self, scene: Scene) -> TruthEngine:
        self._drop()
        if self._engine is None:
            self._engine = made_for(self._make, scene)
        return self._engine

    def _drop(self) -> None:
        """Wait for what is cast ahead, and forget it."""
        if self._next is not None:
            with suppress(Exception):
                self._next[1].result()
            self._next = None


def made_for(make: Callable[[], TruthEngine], scene: Scene) -> TruthEngine:
    """An engine, on the scene as it stands. Raises InputError where that moves and it cannot."""
    engine = make()
    moving = scene.moving is not None
    if moving and not engine.poses:
        raise InputError(
            f"engine '{engine.name}' casts scenes that stand still",
            fix="use another, such as 'exact'",
        )
    if moving and engine.scene is not scene:
        engine.pose(scene)
    return engine


def _cast(engine: TruthEngine, cameras: Sequence[Camera], *, keep: bool) -> list[_Timed]:
    """Views; in arrays of their own where others are cast before they are done with."""
    found = []
    for camera in cameras:
        with Stopwatch() as watch:
            truth = engine.frame(camera)
            if truth.ties_complete != engine.exact:
                # An engine that lists its ties and says so nowhere is taken at its class's word.
                truth = replace(truth, ties_complete=engine.exact)
            if keep:
                truth = truth.copy()
        found.append((truth, watch.ms))
    return found
