"""Who casts a run's truths, and when.

Each view is cast once. While a frame is judged the views of those that follow may be cast already,
where nothing moves and the engine allows it: a cast uses all cores, and judging mostly one. Those
frames are cast a few at a time, since one that follows another shows much the same: what the first
brought into the processor's caches the others find there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
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


# A frame, and its cameras.
Asked = tuple[int, Sequence[Camera]]
# How many frames are cast together, if these are no more samples than that; beyond four, little is
# won. And how many may be cast before they are looked at.
TOGETHER, SAMPLES_TOGETHER = 4, 1 << 23
AHEAD = 2 * TOGETHER

# A truth, and the milliseconds of its cast.
_Timed = tuple[FrameTruth, float]


class Casting:
    """The truths of a run's views. `engine` makes the engine on first use."""

    def __init__(self, engine: Callable[[], TruthEngine], threads: int | None) -> None:
        self._make = engine
        self._threads = threads
        self._engine: TruthEngine | None = None
        self._exact: ExactScene | None = None
        # By frame, what is cast ahead: views of it and of others, and where its own begin.
        self._coming: dict[int, tuple[Future[list[_Timed]], int]] = {}
        self._thread: ThreadPoolExecutor | None = None
        # By frame, by how many pixels rounding moved a vertex that is seen, whose triangle it is,
        # and for which cullers that frame was cast: nobody where it was for the truth itself.
        self.moved: dict[int, Moved] = {}

    @property
    def engine(self) -> TruthEngine | None:
        """The engine, once it has cast. It may be casting ahead: it can be asked, but not posed."""
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
        following: Sequence[Asked] = (),
    ) -> list[ViewCast]:
        """A frame's views, of the scene as it stands in it. `following`: the frames that will be
        asked for next, of the same scene, `AHEAD` or all that are left, which may be cast while
        others look at this one; if the engine allows it."""
        found = self._awaited(frame, len(cameras))
        if found is None:
            found = _cast(self._made(scene), cameras)
        engine = self._engine
        if engine is not None and engine.ahead:
            self._cast_ahead(engine, following)
        return [self._gathered(frame, *one, scene) for one in found]

    def view(self, frame: int, camera: Camera, scene: Scene) -> Cast:
        """One view of a frame, in arrays of its own."""
        ((truth, ms),) = _cast(self._made(scene), [camera], keep=True)
        found = self._gathered(frame, truth, ms, scene)
        return found.truth, found.seen

    def _awaited(self, frame: int, views: int) -> list[_Timed] | None:
        """A frame that was cast ahead; None where it was not, or in vain: then what went wrong is
        found again, in its own frame."""
        if frame not in self._coming:
            return None
        cast, first = self._coming.pop(frame)
        try:
            return cast.result()[first : first + views]
        except Exception:
            return None

    def _cast_ahead(self, engine: TruthEngine, following: Sequence[Asked]) -> None:
        """Begin with those that follow, as soon as there are enough to be cast together."""
        if not following:
            return
        samples = sum(camera.samples for camera in following[0][1])
        together = max(1, min(TOGETHER, SAMPLES_TOGETHER // samples))
        soon = following[: 2 * together]
        new = [asked for asked in soon if asked[0] not in self._coming]
        if len(new) < together and len(soon) == 2 * together:
            return
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1)
        for start in range(0, len(new), together):
            some = new[start : start + together]
            cast = self._thread.submit(_cast, engine, [view for _, views in some for view in views])
            first = 0
            for frame, views in some:
                self._coming[frame] = cast, first
                first += len(views)

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
        """Forget what is cast ahead, once nobody is at it."""
        for cast, _ in self._coming.values():
            if not cast.cancel():
                wait([cast])
        self._coming.clear()


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


def _cast(engine: TruthEngine, cameras: Sequence[Camera], *, keep: bool = False) -> list[_Timed]:
    """Views; of several, each takes as long as the other. `keep`: in arrays of their own, since
    others are cast before they are done with; as are several at any rate."""
    with Stopwatch() as watch:
        if keep or len(cameras) > 1:
            found = engine.frames(cameras)
        else:
            found = [engine.frame(camera) for camera in cameras]
    # An engine that lists its ties and says so nowhere is taken at its class's word.
    found = [
        truth if truth.ties_complete == engine.exact else replace(truth, ties_complete=engine.exact)
        for truth in found
    ]
    return [(truth, watch.ms / len(found)) for truth in found]
