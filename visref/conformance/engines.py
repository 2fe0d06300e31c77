"""assert_engine_conforms(): what the author of a truth engine runs on it, from pytest.

    from visref.conformance import assert_engine_conforms, parametrize_with_engine_checks

    @parametrize_with_engine_checks([MyEngine])
    def test_my_engine(make_engine, check):
        assert_engine_conforms(make_engine, checks=[check])

The scenes are those of the suite for cullers in which nothing moves, and the exact engine says
what is right. An engine that is exact names every owner, every tie, every doubt and all glass. Any
other must name the object that owns a sample where nothing within `FLOAT_TOLERANCE` of it would
change the answer, and the background where nothing is near. An engine that overrides `pose` is
also asked for a scene that moves; another one is for scenes that stand still.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.conformance.scenes import SCENES
from visref.conformance.suite import built_case
from visref.culler import RasterTolerance
from visref.engines.base import TruthEngine
from visref.engines.exact import ExactEngine
from visref.exact import ExactScene, surviving
from visref.scene import Int64, Scene
from visref.visibility import BACKGROUND, FrameTruth

if TYPE_CHECKING:
    import pytest

MakeEngine = Callable[..., TruthEngine]

# A float32 ray is off by a few units in the last place of the image's coordinates, and its depth
# by a few of the depth's: a 256th of a pixel holds the first for any image of up to 2^14 samples
# a side, and a float32 depth buffer's step the second.
FLOAT_TOLERANCE = RasterTolerance(2.0**-8, None)

# How many lines a failed check prints.
_LINES = 4


@dataclass(frozen=True)
class EngineCheck:
    """A named check. `claim` is what a sound engine does; `run` takes what makes the engine of a
    scene and a seed, and gives the problems in readable lines, none where it holds."""

    name: str
    claim: str
    run: Callable[[MakeEngine, int], tuple[str, ...]]

    def __str__(self) -> str:
        return self.name


def engine_checks() -> list[EngineCheck]:
    """The catalogue, for `pytest.mark.parametrize`."""
    scenes = [
        EngineCheck(made.name, "owners are those of exact arithmetic", _owners_on(made.name))
        for made in SCENES
        if not made.moves
    ]
    return [*scenes, *_CONTRACT]


def assert_engine_conforms(
    make_engine: MakeEngine, *, checks: Iterable[EngineCheck] | None = None, seed: int = 0
) -> None:
    """Raise AssertionError unless each check holds, all of the catalogue by default.

    `make_engine(scene, threads=N)` makes the engine of a scene; the engine's class will do.
    """
    problems = []
    for check in engine_checks() if checks is None else checks:
        found = check.run(make_engine, seed)
        if found:
            problems.append(f"  FAILED {check.name}: {check.claim}")
            problems += [f"    {line}" for line in found[:_LINES]]
            if len(found) > _LINES:
                problems.append(f"    ... and {len(found) - _LINES} more")
    if problems:
        raise AssertionError("\n".join([f"engine checks failed (seed {seed}):", *problems]))


def parametrize_with_engine_checks(engines: Iterable[MakeEngine]) -> pytest.MarkDecorator:
    """A decorator for a test of `make_engine` and `check`: every check on every engine."""
    import pytest

    pairs = [(make, check) for make in engines for check in engine_checks()]
    ids = [f"{getattr(make, '__name__', 'engine')}-{check}" for make, check in pairs]
    return pytest.mark.parametrize(("make_engine", "check"), pairs, ids=ids)


def _owners_on(name: str) -> Callable[[MakeEngine, int], tuple[str, ...]]:
    def run(make_engine: MakeEngine, seed: int) -> tuple[str, ...]:
        built, truths = built_case(name, seed)
        engine = make_engine(built.scene)
        arithmetic = ExactScene(built.scene)
        problems: list[str] = []
        try:
            asked = [(k, one) for k, frame in enumerate(built.path.frames) for one in frame.cameras]
            for (frame, camera), right in zip(asked, truths, strict=True):
                found = engine.frame(camera)
                told = _differences(arithmetic, found, right, exact=engine.exact)
                problems += [f"{name}, frame {frame}: {line}" for line in told]
        finally:
            engine.close()
        return tuple(problems)

    return run


def _differences(
    arithmetic: ExactScene, found: FrameTruth, right: FrameTruth, *, exact: bool
) -> Iterator[str]:
    shape = right.camera.height, right.camera.width
    if found.buffer.triangle.shape != shape or found.buffer.depth.shape != shape:
        yield f"the buffers are {found.buffer.triangle.shape}, not {shape}"
        return
    if exact:
        yield from _exact_differences(found, right)
        return
    scene = arithmetic.scene
    ours, theirs = _objects(found, scene), _objects(right, scene)
    differ = np.flatnonzero((ours != theirs) & found.decided & right.decided)
    tied = np.isin(differ, right.ties.sample)
    owned = differ[(theirs[differ] >= 0) & ~tied]
    firm = surviving(
        arithmetic, right.camera, owned, theirs[owned].astype(np.int64), FLOAT_TOLERANCE
    )
    for sample in owned[firm]:
        yield _said(scene, right, int(sample), ours, theirs)
    for sample in np.intersect1d(differ[theirs[differ] < 0], _far_from_all(theirs, shape)):
        yield _said(scene, right, int(sample), ours, theirs)


def _exact_differences(found: FrameTruth, right: FrameTruth) -> Iterator[str]:
    for what, ours, theirs in (
        ("owners", found.buffer.triangle, right.buffer.triangle),
        ("depths", found.buffer.depth, right.buffer.depth),
        ("samples with ties", found.ties.sample, right.ties.sample),
        ("tied triangles", found.ties.triangle, right.ties.triangle),
        ("samples in doubt", found.doubt.sample, right.doubt.sample),
        ("triangles in doubt", found.doubt.triangle, right.doubt.triangle),
        ("samples seen through glass", found.blend.sample, right.blend.sample),
        ("triangles of glass", found.blend.triangle, right.blend.triangle),
    ):
        if not np.array_equal(ours, theirs):
            yield f"the {what} are not those of exact arithmetic"


def _objects(truth: FrameTruth, scene: Scene) -> NDArray[np.int64]:
    """(samples,) the object that owns each, -1 for none."""
    owner = truth.buffer.triangle.reshape(-1)
    objects = np.append(scene.object_of_triangle.astype(np.int64), -1)
    result: NDArray[np.int64] = objects[np.where(owner >= 0, owner, -1)]
    return result


def _far_from_all(objects: NDArray[np.int64], shape: tuple[int, int]) -> Int64:
    """Background samples all of whose neighbours are background, flat."""
    empty = np.pad(objects.reshape(shape) == BACKGROUND, 1, constant_values=True)
    height, width = shape
    around = [empty[y : y + height, x : x + width] for y in range(3) for x in range(3)]
    return np.flatnonzero(np.logical_and.reduce(around)).astype(np.int64)


def _said(
    scene: Scene,
    right: FrameTruth,
    sample: int,
    ours: NDArray[np.int64],
    theirs: NDArray[np.int64],
) -> str:
    y, x = divmod(sample, right.camera.width)
    names = [
        "the background" if o < 0 else f"'{scene.names[o]}'" for o in (ours[sample], theirs[sample])
    ]
    return f"pixel ({x}, {y}) is given to {names[0]} and belongs to {names[1]}"


def _bytes(truth: FrameTruth) -> list[bytes]:
    arrays = (
        truth.buffer.triangle, truth.buffer.depth, truth.ties.sample, truth.ties.triangle,
        truth.doubt.sample, truth.doubt.triangle, truth.blend.sample, truth.blend.triangle,
    )  # fmt: skip
    return [np.ascontiguousarray(array).tobytes() for array in arrays]


def _repeats(make_engine: MakeEngine, seed: int) -> tuple[str, ...]:
    """Threads, and frames cast between, change nothing."""
    built, _ = built_case("walk_through_a_city", seed)
    engines = [make_engine(built.scene, threads=count) for count in (1, 2)]
    try:
        first = [_bytes(engines[0].frame(camera)) for camera in built.path]
        other = [_bytes(engines[1].frame(camera)) for camera in built.path]
        again = [_bytes(engines[0].frame(camera)) for camera in reversed(list(built.path))]
    finally:
        for engine in engines:
            engine.close()
    problems = []
    if first != other:
        problems.append("one thread and two give different answers")
    if first != again[::-1]:
        problems.append("the same camera gives another answer after others")
    return tuple(problems)


def _together(make_engine: MakeEngine, seed: int) -> tuple[str, ...]:
    """Cameras of several sizes, asked for at once, get the answers that each gets by itself, and
    keep them; so do single ones, and while frames are cast in another thread, where the engine says
    that it may be asked `ahead`."""
    built, _ = built_case("walk_through_a_city", seed)
    cameras = list(built.path)
    half = replace(cameras[0], width=cameras[0].width // 2)
    cameras = [*cameras[:2], half, *cameras[2:]]
    engine = make_engine(built.scene, threads=2)
    problems = []
    try:
        alone = [_bytes(engine.frame(camera)) for camera in cameras]
        truths = engine.frames(cameras)
        if [_bytes(truth) for truth in truths] != alone:
            problems.append("frames() gives other answers than frame()")
        engine.frames(cameras[::-1])
        if [_bytes(truth) for truth in truths] != alone:
            problems.append("truths of frames() change when others are cast")
        if engine.frames([]):
            problems.append("frames() of no camera gives truths")
        if engine.ahead:
            with ThreadPoolExecutor(1) as other:
                coming = other.submit(engine.frames, cameras)
                held = [engine.frame(camera) for camera in cameras]
                both = coming.result(), held
            if any([_bytes(truth) for truth in some] != alone for some in both):
                problems.append("frames cast in another thread change answers, or are changed")
    finally:
        engine.close()
    return tuple(problems)


def _moments(seed: int, count: int = 3) -> list[tuple[Scene, Camera]]:
    """A city of which half moves, comes and goes, at several moments; each with a camera."""
    built, _ = built_case("walk_through_a_city", seed)
    still, cameras, rng = built.scene, list(built.path), np.random.default_rng(seed)
    moving = np.arange(still.object_count) % 2 == 1
    result = []
    for moment in range(count):
        vertices = still.vertices.astype(np.float64)
        for each in np.flatnonzero(moving):
            rows = still.triangles[still.object_offsets[each] : still.object_offsets[each + 1]]
            vertices[np.unique(rows)] += rng.normal(size=3)
        scene = replace(
            still,
            vertices=vertices.astype(np.float32),
            absent=moving & (rng.random(len(moving)) < 0.2),
            moving=moving,
        )
        result.append((scene, cameras[moment % len(cameras)]))
    return result


def _in_motion(make_engine: MakeEngine, seed: int) -> tuple[str, ...]:
    """An engine that follows a scene sees it as it stands, whatever was before."""
    moments = _moments(seed)
    engines = [make_engine(moments[0][0], threads=count) for count in (1, 2)]
    problems: list[str] = []
    try:
        # An engine that does not follow is for scenes that stand still.
        if not engines[0].poses:
            return ()
        for number in (1, 2, 0, 2):
            scene, camera = moments[number]
            found = []
            for engine in engines:
                engine.pose(scene)
                found.append(engine.frame(camera))
            right = ExactEngine(scene).frame(camera)
            told = _differences(ExactScene(scene), found[0], right, exact=engines[0].exact)
            problems += [f"moment {number}: {line}" for line in told]
            if _bytes(found[0]) != _bytes(found[1]):
                problems.append(f"moment {number}: one thread and two give different answers")
    finally:
        for engine in engines:
            engine.close()
    return tuple(problems)


def _empty(make_engine: MakeEngine, seed: int) -> tuple[str, ...]:
    """A scene without triangles is background."""
    built, _ = built_case("walk_through_a_city", seed)
    engine = make_engine(Scene.from_objects([]))
    try:
        truth = engine.frame(built.path.cameras[0])
        if (truth.buffer.triangle != BACKGROUND).any() or not np.isinf(truth.buffer.depth).all():
            return ("an empty scene is not all background at infinite depth",)
    finally:
        engine.close()
    return ()


def _closes(make_engine: MakeEngine, seed: int) -> tuple[str, ...]:
    """An engine is closed once or twice, used or not."""
    built, _ = built_case("walk_through_a_city", seed)
    problems = []
    for used in (False, True):
        engine = make_engine(built.scene)
        if used:
            engine.frame(built.path.cameras[0])
        for time in ("first", "second"):
            try:
                engine.close()
            except Exception as error:  # a plug-in may raise anything
                problems.append(f"the {time} close(): {type(error).__name__}: {error}")
    return tuple(problems)


_CONTRACT = [
    EngineCheck("same_answer_again", "threads and other frames change no byte", _repeats),
    EngineCheck("frames_together", "several cameras at once, as each by itself", _together),
    EngineCheck("in_motion", "a scene that moves is seen as it stands", _in_motion),
    EngineCheck("empty_scene_is_background", "nothing is background everywhere", _empty),
    EngineCheck("close_at_any_time", "closing never fails", _closes),
]
