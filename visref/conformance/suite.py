"""check_culler(): what a stranger runs on a culler of their own, from pytest.

    from visref.conformance import assert_conforms, parametrize_with_checks
    from my_engine import MyCuller

    @parametrize_with_checks([MyCuller])
    def test_my_culler(make_culler, check):
        assert_conforms(make_culler, checks=[check])

Each check is named, seeded and small: most build a scene around one way to go wrong, cast its
truth with the exact engine (every sample, every tie) and let `visref.judging.referee` judge the
culler on it; a few look at the contract of `visref.culler.Culler` itself. A check that a culler is
known to fail is named in `expected_failures` with the reason; if it passes all the same, that is an
error, so that the list never outlives its reasons.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import TYPE_CHECKING
from unittest import SkipTest

import numpy as np

from visref.camera_path import CameraPath
from visref.conformance.building import Case, SceneMaker
from visref.conformance.scenes import SCENES
from visref.culler import Culler, Promise, check_drawn
from visref.engines.exact import ExactEngine
from visref.engines.recalled import RecalledTruths
from visref.errors import InputError
from visref.findings import Code, Severity
from visref.judging.outcome import CullerRecord
from visref.judging.referee import Referee
from visref.scene import Scene
from visref.timeline import Timeline
from visref.visibility import FrameTruth
from visref.wording import did_you_mean

if TYPE_CHECKING:
    import pytest

MakeCuller = Callable[[], Culler]

# How many lines a failed check prints of the objects that it lost.
LINES_PER_CHECK = 4


class NotForThis(Exception):
    """A culler says that it is not for such a scene; the text says why."""


class Status(StrEnum):
    """How a check ended. A check is skipped where the culler says that it is not for such scenes
    (`Culler.moves`). One that failed, or passed unexpectedly, fails `assert_conforms`. `MEASURED`
    is no praise: who promises nothing can break nothing (the command line alone says it)."""

    PASSED = "passed"
    FAILED = "failed"
    EXPECTED_FAILURE = "expected failure"
    UNEXPECTED_PASS = "unexpected pass"
    MEASURED = "measured"
    SKIPPED = "not run"


@dataclass(frozen=True)
class CheckResult:
    """One check's outcome. `problems` are readable lines, empty if it passed; `reason` is the
    one given for an expected failure, or why it was skipped; `missed` counts objects of which
    something is lost, over all frames, whatever the culler promises."""

    check: str
    status: Status
    problems: tuple[str, ...] = ()
    reason: str = ""
    missed: int = 0

    @property
    def ok(self) -> bool:
        return self.status not in (Status.FAILED, Status.UNEXPECTED_PASS)


@dataclass(frozen=True)
class Check:
    """A named check. `claim` is what a sound culler does, `trap` the usual way to fail it. `moves`:
    whether its scene does, so that it is skipped for a culler without an `update`."""

    name: str
    claim: str
    trap: str
    run: Callable[[MakeCuller, int], tuple[tuple[str, ...], int]]
    moves: bool = False

    def __str__(self) -> str:
        return self.name


def conformance_checks(*, moving: bool = True) -> list[Check]:
    """The catalogue, for `pytest.mark.parametrize`.

    `moving=False` leaves out the checks whose scene moves: the rest apply to a culler that has no
    `update`, and none of them is skipped.
    """
    scenes = [
        Check(made.name, made.claim, made.trap, _judge_on(made), made.moves)
        for made in SCENES
        if moving or not made.moves
    ]
    return [*scenes, *_CONTRACT]


def check_culler(
    make_culler: MakeCuller,
    *,
    checks: Iterable[Check] | None = None,
    expected_failures: Mapping[str, str] | None = None,
    seed: int = 0,
) -> list[CheckResult]:
    """Run the catalogue, or some `checks` of it, on cullers that `make_culler` makes.

    `checks` may be of your own. `expected_failures` maps names of checks to reasons. Raises
    InputError where a name is unknown or a reason empty, and NothingToJudge where no culler can be
    made (no OpenGL).
    """
    asked = conformance_checks() if checks is None else list(checks)
    expected = dict(expected_failures or {})
    _known(expected, asked)
    results = []
    for check in asked:
        try:
            problems, missed = check.run(make_culler, seed)
        except NotForThis as why:
            results.append(CheckResult(check.name, Status.SKIPPED, reason=str(why)))
            continue
        reason = expected.get(check.name, "")
        status = status_of(problems, reason)
        results.append(CheckResult(check.name, status, problems, reason, missed))
    return results


def status_of(problems: Sequence[str], reason: str, *, promised: bool = True) -> Status:
    """How a check ended that found these problems, where `reason` says why it is expected to fail
    (empty where it is not). `promised`: whether the culler's promise can be broken at all."""
    if problems:
        return Status.EXPECTED_FAILURE if reason else Status.FAILED
    if reason:
        return Status.UNEXPECTED_PASS
    return Status.PASSED if promised else Status.MEASURED


def assert_conforms(
    make_culler: MakeCuller,
    *,
    checks: Iterable[Check] | None = None,
    expected_failures: Mapping[str, str] | None = None,
    seed: int = 0,
) -> None:
    """Raise AssertionError, with a witness for every loss, unless each check ends as it should; and
    unittest.SkipTest, which pytest shows as skipped, if each was skipped.

    Takes and raises what `check_culler` does.
    """
    asked = conformance_checks() if checks is None else list(checks)
    results = check_culler(
        make_culler, checks=asked, expected_failures=expected_failures, seed=seed
    )
    told = [
        _describe(result, check, seed)
        for result, check in zip(results, asked, strict=True)
        if not result.ok
    ]
    if told:
        first = f"{len(told)} of {len(results)} conformance checks failed (seed {seed}):"
        raise AssertionError("\n".join([first, *told]))
    if results and all(result.status is Status.SKIPPED for result in results):
        raise SkipTest("; ".join(f"{result.check}: {result.reason}" for result in results))


def case(name: str, *, seed: int = 0) -> tuple[Scene, CameraPath]:
    """The scene and the path of a check, to look at or to load elsewhere."""
    _known([name])
    made = {made.name: made for made in SCENES}.get(name)
    if made is None:
        raise InputError(f"check '{name}' is about the contract and has no scene of its own")
    built = built_of(made, seed)
    return built.scene, built.path


def built_case(name: str, seed: int) -> tuple[Case, tuple[FrameTruth, ...]]:
    """The scene of a check with its exact truth, cast once for all who ask."""
    return _truths({made.name: made for made in SCENES}[name], seed)


def parametrize_with_checks(cullers: Iterable[MakeCuller]) -> pytest.MarkDecorator:
    """A decorator for a test of `make_culler` and `check`: every check on every culler."""
    import pytest

    pairs = [(make, check) for make in cullers for check in conformance_checks()]
    ids = [f"{getattr(make, '__name__', 'culler')}-{check}" for make, check in pairs]
    return pytest.mark.parametrize(("make_culler", "check"), pairs, ids=ids)


def _known(names: Iterable[str] | Mapping[str, str], more: Iterable[Check] = ()) -> None:
    """Raises InputError where a name is of no check of the catalogue, nor of `more`."""
    catalogue = list(dict.fromkeys(check.name for check in (*conformance_checks(), *more)))
    for name in names:
        if name not in catalogue:
            raise InputError(
                f"no conformance check is named '{name}'", fix=did_you_mean(name, catalogue)
            )
        if isinstance(names, Mapping) and not names[name].strip():
            raise InputError(f"expected failure '{name}' has no reason", fix="say why")


def _describe(result: CheckResult, check: Check, seed: int) -> str:
    lines = [f"  {result.status.upper()} {check.name}: {check.claim}"]
    if result.status is Status.UNEXPECTED_PASS:
        return f"{lines[0]}\n    expected to fail because: {result.reason}"
    lines += [f"    {problem}" for problem in result.problems]
    lines.append(f"    the usual trap: {check.trap}")
    # A check of somebody's own may have a name of the catalogue.
    if (check.name, check.claim) in {(made.name, made.claim) for made in SCENES}:
        lines.append(f"    its scene: visref.conformance.case({check.name!r}, seed={seed})")
    return "\n".join(lines)


# Judging on a scene.


def built_of(made: SceneMaker, seed: int) -> Case:
    """The case that a maker makes with a seed."""
    return made.build(np.random.default_rng([seed, zlib.crc32(made.name.encode())]))


def exact_truths(built: Case) -> tuple[FrameTruth, ...]:
    """The exact engine's truth of each view of each frame of a case, in the path's order. What
    moves is met by an engine of its own in each frame."""
    path = built.path.relative_to(built.scene.origin)
    timeline = Timeline(built.scene, path)
    truths: list[FrameTruth] = []
    engine: ExactEngine | None = None
    for number, frame in enumerate(path.frames):
        scene = timeline.at(number)
        if engine is None or engine.scene is not scene:
            if engine is not None:
                engine.close()
            engine = ExactEngine(scene)
        truths += engine.frames(frame.cameras)
    if engine is not None:
        engine.close()
    return tuple(truths)


@lru_cache(maxsize=128)
def _truths(made: SceneMaker, seed: int) -> tuple[Case, tuple[FrameTruth, ...]]:
    """A check's scene with its exact truth, cast once for however many cullers."""
    built = built_of(made, seed)
    return built, exact_truths(built)


def _judge_on(made: SceneMaker) -> Callable[[MakeCuller, int], tuple[tuple[str, ...], int]]:
    def run(make_culler: MakeCuller, seed: int) -> tuple[tuple[str, ...], int]:
        return judge_on(make_culler, *_truths(made, seed))

    return run


@dataclass(frozen=True)
class Judged:
    """What is wrong, in readable lines; how many objects lose something, over all frames; whether
    the culler's promise can be broken at all; and what it decides about."""

    problems: tuple[str, ...]
    missed: int = 0
    promised: bool = True
    unit_kind: str = ""


def judge_on(
    make_culler: MakeCuller, built: Case, truths: Sequence[FrameTruth]
) -> tuple[tuple[str, ...], int]:
    """Judge a culler on a case whose exact truths are known, one per view of each frame: what is
    wrong, in readable lines, and how many objects lose something, over all frames. Raises
    NotForThis where something moves and the culler is for scenes that stand still."""
    judged = judged_on(make_culler, built, truths)
    return judged.problems, judged.missed


def judged_on(
    make_culler: MakeCuller, built: Case, truths: Sequence[FrameTruth], name: str = ""
) -> Judged:
    """As `judge_on`, and raises what it does. `name`: of the culler, by default its own."""
    culler = make_culler()
    if not culler.moves and Timeline(built.scene, built.path).moves:
        culler.close()
        shown = name or culler.name
        raise NotForThis(f"'{shown}' has no update(): it is for scenes that stand still")
    path = built.path.relative_to(built.scene.origin)
    referee = Referee(built.scene, lambda: RecalledTruths(built.scene, path, truths))
    try:
        outcome = referee.run(path, range(len(path)), [(culler.name, culler)])
    except InputError as error:
        # The units were refused.
        return Judged((str(error),))
    record = outcome.cullers[0]
    problems = [
        f"{finding.code}: {finding.message}"
        for finding in outcome.findings
        if finding.code == Code.NO_GL
        or (finding.rule.severity is Severity.ERROR and finding.code not in _TOLD)
    ]
    if record.promise.convicts:
        problems += _losses(record, built)
    problems += _hidden(record, built)
    promised = record.promise is not Promise.APPROXIMATE
    return Judged(tuple(problems), record.totals.confirmed, promised, record.unit_kind)


# What is told with its witness instead of the finding's own words.
_TOLD = ("MISSED_OBJECT", "DRAWN_HIDDEN")


def _losses(record: CullerRecord, built: Case) -> list[str]:
    lines = []
    losses = record.losses()
    for _, frame, miss in losses[:LINES_PER_CHECK]:
        (view,) = [one for one in built.path.views(frame) if one.view == miss.view]
        where = f"frame {frame}, view '{miss.view}'" if miss.view else f"frame {frame}"
        x, y = miss.sample % view.width, miss.sample // view.width
        lines.append(
            f"MISSED_OBJECT: {where} ({view.width} x {view.height}): "
            f"'{built.scene.names[miss.object]}' (object {miss.object}) lost {miss.samples} of "
            f"its {miss.owned} samples; witness: pixel ({x}, {y}), triangle {miss.triangle} "
            f"at depth {miss.depth:.6g}"
        )
    if len(losses) > LINES_PER_CHECK:
        lines.append(f"... and {len(losses) - LINES_PER_CHECK} objects more")
    return lines


def _hidden(record: CullerRecord, built: Case) -> list[str]:
    """What was drawn though hidden, where the promise forbids it."""
    found = [(row, one) for row in record.frames for one in row.verdict.confirmed_superfluous]
    lines = []
    for row, one in found[:LINES_PER_CHECK]:
        where = f"frame {row.frame}, view '{one.view}'" if one.view else f"frame {row.frame}"
        line = f"DRAWN_HIDDEN: {where}: {record.unit_kind} {one.unit} was drawn"
        if one.sample < 0:
            lines.append(f"{line} and covers no sample")
            continue
        hides = int(built.scene.object_of_triangle[one.occluder]) if one.occluder >= 0 else -1
        by = f", at pixel ({one.sample % one.width}, {one.sample // one.width})"
        by += f" by '{built.scene.names[hides]}' (object {hides})" if hides >= 0 else ""
        lines.append(f"{line} and is hidden at all of its {one.samples} samples{by}")
    if len(found) > LINES_PER_CHECK:
        lines.append(f"... and {len(found) - LINES_PER_CHECK} hidden units more")
    return lines


# The contract itself.

# Scenes on which the contract's checks watch a culler: one with much hidden, one with cuts.
_WATCHED = ("walk_through_a_city", "jump_cuts")


def _answers_repeat(make_culler: MakeCuller, seed: int) -> tuple[tuple[str, ...], int]:
    """Alone, and twice side by side as the referee runs several, the sets are the same."""
    problems = []
    for name in _WATCHED:
        scene, path = case(name, seed=seed)
        alone = _drawn_sets([make_culler()], scene, path)
        pair = _drawn_sets([make_culler(), make_culler()], scene, path)
        problems += [
            f"{name}, frame {frame}: the drawn sets of three runs differ"
            for frame in range(len(path))
            if not alone[0][frame] == pair[0][frame] == pair[1][frame]
        ]
    return tuple(problems), 0


def _drawn_sets(cullers: list[Culler], scene: Scene, path: CameraPath) -> list[list[set[int]]]:
    """Per culler and frame the units drawn; the cullers take turns at each frame."""
    try:
        units = [culler.prepare(scene) for culler in cullers]
        drawn: list[list[set[int]]] = [[] for _ in cullers]
        for camera in path:
            for at, culler in enumerate(cullers):
                answer = culler.cull(camera)
                ids = check_drawn(answer, units[at])
                drawn[at].append(set(ids.tolist()))
    finally:
        for culler in cullers:
            culler.close()
    return drawn


def _close_at_any_time(make_culler: MakeCuller, seed: int) -> tuple[tuple[str, ...], int]:
    """The referee closes every culler once, also one that was never prepared."""
    problems = []
    scene, path = case(_WATCHED[0], seed=seed)
    for prepared in (False, True):
        culler = make_culler()
        when = "after a frame" if prepared else "before prepare()"
        if prepared:
            culler.prepare(scene)
            culler.cull(path.cameras[0])
        for time in ("first", "second"):
            try:
                culler.close()
            except Exception as error:  # a plug-in may raise anything
                problems.append(f"the {time} close() {when}: {type(error).__name__}: {error}")
    return tuple(problems), 0


_CONTRACT = (
    Check(
        "answers_repeat",
        "two runs, alone or side by side, draw the same sets",
        "state shared between cullers, unseeded chance, answers read too early",
        _answers_repeat,
    ),
    Check(
        "close_at_any_time",
        "close() works before prepare(), after it, and twice",
        "freeing what was never made, or freeing it again",
        _close_at_any_time,
    ),
)
