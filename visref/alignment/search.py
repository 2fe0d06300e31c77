"""Which hypothesis makes a recording fit, if one does.

Few frames are cast at few of their own samples (every k-th, so that what is seen is seen by the
judge too). A sound recording on right inputs agrees fully by this, and the search ends after its
first look.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from visref.alignment.agreement import Agreement, Answers, within_view
from visref.alignment.hypotheses import HYPOTHESES, Cell, Hypothesis, shifted
from visref.camera import ALL_VIEWS, Camera
from visref.camera_path import CameraPath, middles
from visref.engines import TruthEngine, make_engine
from visref.judging.limits import sparse
from visref.recordings.visible_sets import VisibleSets
from visref.scene import Scene
from visref.timeline import Timeline

Bool = NDArray[np.bool_]
# Of a frame and a view, (n,) bool, the objects that own a sample there; None where that is unknown.
Known = Callable[[int, str], Bool | None]

# Frames that are looked at, and samples on a picture's longer side.
FRAMES = 8
LONGER_SIDE = 128

# A hypothesis that is right brings a sound recording to 1 exactly, since what is seen by few
# samples is seen by all. So above an agreement of `GOOD` nothing is asked, and what is named has
# to come near 1 and to leave at most a quarter of the wrong answers that there are as given, and
# half of those that the next best leaves. In both cases by `LEAST_WRONG` at the least, for of one
# or two answers any hypothesis may make right ones by chance. These decide what is said of an
# input, and no verdict.
GOOD = 0.99
BEST_AT_LEAST = 0.95
MOST_LEFT = 0.25
MOST_OF_NEXT = 0.5
LEAST_WRONG = 4
# Several cells tell of the same objects. So many different ones have to be drawn where they are
# seen, left out where they are outside, and to have wrong answers made right.
LEAST_OBJECTS = 8
# And there have to be so many cells, where the order of frames is in question.
LEAST_FRAMES = 5
# What agrees worse than this in the cells so far, by so many wrong answers, is dropped.
HOPELESS = 0.6
HOPELESS_FROM = 16


@dataclass(frozen=True)
class Alignment:
    """What was found: the best hypothesis, its agreement and that of the input as given over the
    same cells, the next best by name, and how many frames were looked at."""

    hypothesis: Hypothesis
    agreement: float
    as_given: float
    next_best: tuple[str, float]
    frames: int


@dataclass(frozen=True)
class Tried:
    """A hypothesis over the cells where it can be said: what it gives there, and what is given."""

    hypothesis: Hypothesis
    found: Agreement
    given: Agreement


def best_alignment(
    timeline: Timeline,
    path: CameraPath,
    recorded: VisibleSets,
    *,
    threads: int | None = None,
    lent: TruthEngine | None = None,
    known: Known | None = None,
) -> Alignment | None:
    """The hypothesis under which a recording fits the path, relative to the scene's origin; None
    where it fits as given, where none makes it fit, or where several do about as well. `lent`: an
    engine that is there already; it is not posed. `known`: what a truth that is there says, so
    that a recording that fits by it needs no engine."""
    cells = list(_cells(timeline.still, path, recorded))
    if known is not None and _fits(timeline, path, cells, known):
        return None
    frames = len({cell.place for cell in cells})
    with ExitStack() as closing:
        world = _World(timeline, path, threads, lent)
        closing.callback(world.close)
        given = [world.agreement(_AS_GIVEN, cell) for cell in cells]
        total = sum((one for one in given if one is not None), Agreement())
        if total.score >= GOOD or total.wrong < LEAST_WRONG:
            return None
        found = _named(list(_tried(world, cells)), frames)
        if found is None or _evidence(world, found.hypothesis, cells) < LEAST_OBJECTS:
            return None
    return found


def _fits(timeline: Timeline, path: CameraPath, cells: Sequence[Cell], known: Known) -> bool:
    """Whether a first look would end the search. The few samples that it casts are among the
    truth's, so it finds no more that is lost; what is drawn beside the view needs no cast."""
    wrong = 0
    for cell in cells:
        number = path.numbers[cell.place]
        cameras = path.frames[cell.place].cameras
        scene = timeline.at(number)
        seen, within = np.zeros((2, scene.object_count), np.bool_)
        for view in cell.views:
            sees = known(number, cameras[view].view)
            if sees is None:
                return False
            seen |= sees
            within |= within_view(cameras[view], scene.object_bounds)
        there = ~timeline.absent(number)
        answers = Answers.of(cell.drawn & there, seen & there, within | ~there)
        wrong += answers.counted().wrong
    return wrong < LEAST_WRONG


def _evidence(world: _World, hypothesis: Hypothesis, cells: Sequence[Cell]) -> int:
    """How many objects speak for a hypothesis: the fewest of those shown, left out and set right
    in some cell."""
    shown, left_out, repaired = np.zeros((3, world.still.object_count), np.bool_)
    for cell in cells:
        changed = hypothesis.cell(cell, len(world.path), world.views(cell.place))
        one, given = world.answers(hypothesis, changed), world.answers(_AS_GIVEN, cell)
        if one is None or given is None:
            continue
        shown |= one.seen & one.drawn
        left_out |= one.outside & ~one.drawn
        repaired |= given.wrong & ~one.wrong
    return int(min(np.count_nonzero(which) for which in (shown, left_out, repaired)))


def _named(tried: Sequence[Tried], frames: int) -> Alignment | None:
    """The best of them, if it may be named."""
    order = sorted(tried, key=lambda one: -one.found.score)
    if not order:
        return None
    best, rival = order[0], order[1] if len(order) > 1 else None
    left = best.found.wrong
    before, next_best = best.given.wrong, rival.found.wrong if rival is not None else None
    enough = best.found.score >= BEST_AT_LEAST and _outdoes(left, before, MOST_LEFT)
    if not enough or (next_best is not None and not _outdoes(left, next_best, MOST_OF_NEXT)):
        return None
    second = ("", 0.0) if rival is None else (rival.hypothesis.name, rival.found.score)
    return Alignment(best.hypothesis, best.found.score, best.given.score, second, frames)


def _outdoes(left: int, other: int, share: float) -> bool:
    """Whether so many wrong answers are clearly fewer than those of another reading."""
    return left <= share * other and left + LEAST_WRONG <= other


_ENGINE = "embree"
_AS_GIVEN = Hypothesis("as given", "", "")


def _tried(world: _World, cells: Sequence[Cell]) -> Iterator[Tried]:
    """Those that are not refuted on the way, over all cells of which they say something."""
    for hypothesis in (*HYPOTHESES, *_offsets(world.still)):
        found, given, count = Agreement(), Agreement(), 0
        for cell in cells:
            changed = hypothesis.cell(cell, len(world.path), world.views(cell.place))
            one = world.agreement(hypothesis, changed)
            if one is None:
                continue
            as_given = world.agreement(_AS_GIVEN, cell)
            assert as_given is not None
            found, given, count = found + one, given + as_given, count + 1
            if found.wrong >= HOPELESS_FROM and found.score < HOPELESS:
                break
        else:
            least = LEAST_FRAMES if hypothesis.over_time else 1
            # Where all of the scene is in view, nothing outside could speak against it.
            refutable = found.outside > 0 or given.outside == 0
            asked = given.lost > 0 or not hypothesis.sound
            # Who only leaves out, and draws nothing outside, is an engine that culls too much.
            if not hypothesis.engine:
                asked &= given.beside >= LEAST_WRONG or given.outside == 0
            if count >= max(least, len(cells) // 2) and refutable and asked:
                yield Tried(hypothesis, found, given)


def _offsets(scene: Scene) -> Iterator[Hypothesis]:
    """Points that importers make the origin; those that are apart from it and from each other."""
    low, high = scene.bounds + scene.origin
    middle = (low + high) / 2.0
    ground = np.array([middle[0], low[1], middle[2]])
    apart = float(np.abs(high - low).max()) * 2.0**-10
    known = [np.zeros(3)]
    for name, point in (
        ("middle", middle),
        ("middle of its floor", ground),
        ("lowest corner", low),
    ):
        if all(np.abs(point - other).max() > apart for other in known):
            known.append(point)
            yield shifted(name, point)


def _cells(scene: Scene, path: CameraPath, recorded: VisibleSets) -> Iterator[Cell]:
    """Drawn sets of a few frames, evenly picked."""
    frames = list(recorded.sets)
    # Where units are objects nothing need be gathered; those without triangles draw nothing.
    some = recorded.units.sizes > 0 if recorded.units.are_objects(scene) else None
    for index in middles(len(frames), FRAMES):
        number = frames[index]
        place = path.place(number)
        cameras = path.views(number)
        for view, ids in recorded.sets[number].items():
            views = (
                tuple(range(len(cameras)))
                if view == ALL_VIEWS
                else tuple(i for i, camera in enumerate(cameras) if camera.view == view)
            )
            drawn = np.zeros(scene.object_count, np.bool_)
            if some is not None:
                drawn[ids] = some[ids]
            else:
                drawn[scene.object_of_triangle[recorded.units.gather(ids)]] = True
            yield Cell(place, views, drawn)


class _World:
    """The scene over time, and who sees what of it: every answer is kept."""

    def __init__(
        self,
        timeline: Timeline,
        path: CameraPath,
        threads: int | None,
        lent: TruthEngine | None,
    ) -> None:
        self.path = path
        self.still = timeline.still
        self._lent = lent if lent is not None and lent.name == _ENGINE else None
        self._timeline = timeline
        self._threads = threads
        self._engines: dict[bool, tuple[TruthEngine, Scene]] = {}
        self._given: dict[tuple[int, tuple[int, ...]], tuple[Bool, Bool]] = {}

    def views(self, place: int) -> int:
        return len(self.path.frames[place].cameras)

    def agreement(self, hypothesis: Hypothesis, changed: Cell | None) -> Agreement | None:
        """Of one cell, as a hypothesis changed it; None where it says nothing of it."""
        answers = self.answers(hypothesis, changed)
        return None if answers is None else answers.counted()

    def answers(self, hypothesis: Hypothesis, changed: Cell | None) -> Answers | None:
        """The same by object."""
        if changed is None:
            return None
        if hypothesis.turned and not self.still.has_one_sided:
            return None
        cameras = self.path.frames[changed.place].cameras
        key = changed.place, changed.views
        plain = not hypothesis.turned
        seen, within = np.zeros((2, self.still.object_count), np.bool_)
        made = [hypothesis.camera(cameras[view]) for view in changed.views]
        plain = plain and all(
            one is cameras[view] for one, view in zip(made, changed.views, strict=True)
        )
        if plain and key in self._given:
            seen, within = self._given[key]
        else:
            for camera in made:
                if camera is None:
                    return None
                self._look(camera, changed.place, hypothesis.turned, seen, within)
            if plain:
                self._given[key] = seen, within
        there = ~self._timeline.absent(self.path.numbers[changed.place])
        return Answers.of(changed.drawn & there, seen & there, within | ~there)

    def _look(self, camera: Camera, place: int, turned: bool, seen: Bool, within: Bool) -> None:
        """Add what a camera sees, and what reaches into its view."""
        scene = self._timeline.at(self.path.numbers[place])
        engine = self._engine(scene, turned)
        truth = engine.frame(sparse(camera, LONGER_SIDE))
        owner = truth.buffer.triangle.reshape(-1).copy()
        owner[truth.doubt.sample] = -1
        seen[scene.object_of_triangle[owner[owner >= 0]]] = True
        within |= within_view(camera, scene.object_bounds)

    def _engine(self, scene: Scene, turned: bool) -> TruthEngine:
        """An engine that has met this scene."""
        if self._lent is not None and self._lent.scene is scene and not turned:
            return self._lent
        if turned not in self._engines:
            still = _turned(self.still) if turned else self.still
            self._engines[turned] = make_engine(_ENGINE, still, threads=self._threads), self.still
        engine, met = self._engines[turned]
        if met is not scene:
            engine.pose(_turned(scene) if turned else scene)
            self._engines[turned] = engine, scene
        return engine

    def close(self) -> None:
        for engine, _ in self._engines.values():
            engine.close()


def _turned(scene: Scene) -> Scene:
    """The scene with each triangle wound the other way. Masks are by corner: what they cover stays
    open."""
    return replace(scene, triangles=scene.triangles[:, [0, 2, 1]], masks=None)
