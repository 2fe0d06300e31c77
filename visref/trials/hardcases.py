"""The hard numerical cases, run through every engine and every culler there is.

The cases come from the generator `hard` of the entry-point group `visref.scenes`, through
their files, so that reading them is under test too. Each brings its right verdict, derived
from how it was laid out. An engine's frame is compared with it sample by sample; a culler is
judged by the referee, on exact truth.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.culler import Culler
from visref.engines import check_engine, make_engine
from visref.engines.base import TruthEngine
from visref.engines.recalled import RecalledTruths
from visref.errors import InputError, NothingToJudge
from visref.findings import Code
from visref.formats import load_path, load_scene
from visref.judging.judge import MissKind
from visref.judging.outcome import CullerRecord, RunOutcome
from visref.judging.referee import Referee
from visref.judging.status import Exit, decide
from visref.registry import CULLERS, SCENES, available, load_entry, make_culler
from visref.scene import Scene
from visref.visibility import BACKGROUND, FrameTruth, objects_seen
from visref.wording import counted, did_you_mean

EXACT = "exact"
SCENE_FILE, PATH_FILE, EXPECTED_FILE = "{}.glb", "{}.path.json", "{}.expected.json"


class State(StrEnum):
    """What a cell of the table says."""

    RIGHT = "right"
    WRONG = "WRONG"
    # A culler that declares itself aggressive or approximate left something out.
    MEASURED = "measured"
    # It declined the case in one clear line.
    REFUSED = "refused"
    # It broke down.
    FAILED = "FAILED"
    # It does not run on this machine at all.
    UNAVAILABLE = "not here"


@dataclass(frozen=True)
class Cell:
    """How one engine or culler did on one case, summed over its frames.

    Engines: `samples` with a wrong owner, `objects` wrongly seen or wrongly unseen (counted
    per frame), `ties_unseen` tied samples that the engine does not list. Cullers: `objects`
    missed and confirmed, `samples` lost with them, and further objects left out as `ties` or
    `within_raster_tolerance`. `detail`: why it refused, failed or is not here.
    """

    state: State
    samples: int = 0
    objects: int = 0
    ties_unseen: int = 0
    ties: int = 0
    within_raster_tolerance: int = 0
    detail: str = ""

    def __str__(self) -> str:
        parts = []
        if self.samples or self.objects:
            parts.append(f"{counted(self.samples, 'sample')}, {counted(self.objects, 'object')}")
        if self.ties_unseen:
            parts.append(f"{counted(self.ties_unseen, 'tie')} unseen")
        if self.ties:
            parts.append(f"{counted(self.ties, 'tied object')} left out")
        if self.within_raster_tolerance:
            parts.append(f"{self.within_raster_tolerance} within raster tolerance")
        return f"{self.state}: {'; '.join(parts)}" if parts else str(self.state)


@dataclass(frozen=True, eq=False)
class ExpectedFrame:
    """The right verdict of one frame.

    `sets`: sets of object names; `which`: (height, width) int64, the number of each sample's
    set of owners (several are tied, none is background). `visible` and `tied` (visible, and
    nowhere alone) are sets of names, `hidden` lists all others.
    """

    sets: tuple[frozenset[str], ...]
    which: NDArray[np.int64]
    visible: frozenset[str]
    tied: frozenset[str]
    hidden: tuple[str, ...]

    @classmethod
    def read(cls, data: Mapping[str, Any], camera: Camera) -> ExpectedFrame:
        """From a frame of NAME.expected.json: patches painted in order over a background."""
        number: dict[frozenset[str], int] = {frozenset(): 0}
        which = np.zeros((camera.height, camera.width), np.int64)
        for patch in data["owners"]:
            (x0, x1), (y0, y1) = patch["x"], patch["y"]
            owners = frozenset(patch["owners"])
            which[y0 : y1 + 1, x0 : x1 + 1] = number.setdefault(owners, len(number))
        return cls(
            tuple(number),
            which,
            frozenset(data["visible"]),
            frozenset(data["tied"]),
            tuple(data["hidden"]),
        )


@dataclass(frozen=True, eq=False)
class HardCase:
    """A case as read from its files. `error`: what the loader must say, empty where it must
    load; then there are `frames`. `between`: objects visible between the samples alone."""

    name: str
    what: str
    path: CameraPath
    scene_file: Path
    cull_backfaces: bool
    frames: tuple[ExpectedFrame, ...] = ()
    error: tuple[str, ...] = ()
    between: tuple[str, ...] = ()

    def load(self) -> Scene:
        return load_scene(self.scene_file, cull_backfaces=self.cull_backfaces)


@dataclass(frozen=True, eq=False)
class HardCaseTable:
    """Case × engine and case × culler. `cells`: by case, then by the column's spec."""

    cases: tuple[HardCase, ...]
    engines: tuple[str, ...]
    cullers: tuple[str, ...]
    cells: dict[str, dict[str, Cell]] = field(default_factory=dict)

    def column(self, spec: str) -> list[Cell]:
        return [self.cells[case.name][spec] for case in self.cases]

    @property
    def exit(self) -> Exit:
        """A violation if the exact engine is not right on every case, or if a culler that
        promises to be conservative misses an object. What does not run here says nothing."""
        exact = all(cell.state is State.RIGHT for cell in self.column(EXACT))
        statuses = [Exit.NO_VIOLATION if exact else Exit.VIOLATION]
        for spec in self.cullers:
            states = {cell.state for cell in self.column(spec)}
            if State.WRONG in states:
                statuses.append(Exit.VIOLATION)
            elif State.FAILED in states:
                statuses.append(Exit.NOTHING_JUDGED)
        return decide(statuses)

    def reasons(self) -> list[str]:
        """Why columns could not run, or gave up on a case; a line each, in order."""
        lines = {
            f"{spec}: {cell.state}: {cell.detail}": None
            for case in self.cases
            for spec, cell in self.cells[case.name].items()
            if cell.detail and cell.state is not State.RIGHT
        }
        return list(lines)

    def to_json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "exit_status": int(self.exit),
            "engines": list(self.engines),
            "cullers": list(self.cullers),
            "cases": [
                {
                    "case": case.name,
                    "what": case.what,
                    "cells": {
                        spec: {**vars(cell), "state": cell.state.value}
                        for spec, cell in self.cells[case.name].items()
                    },
                }
                for case in self.cases
            ],
        }


class _Generated(Protocol):
    """What the generator returns a list of."""

    name: str

    def write(self, directory: Path) -> tuple[Path, Path]: ...


def read_cases(folder: Path, only: Sequence[str] | None = None) -> tuple[HardCase, ...]:
    """Generate the cases' files into `folder` and read them back, in the generator's order.

    `only`: names of cases, None for all. Raises InputError for an unknown name.
    """
    made = cast(Callable[[], list[_Generated]], load_entry(SCENES, "hard", kind="scene"))()
    names = [dataset.name for dataset in made]
    for name in only or ():
        if name not in names:
            raise InputError(f"no hard case is named '{name}'", fix=did_you_mean(name, names))
    cases = []
    for dataset in made:
        if only is None or dataset.name in only:
            dataset.write(folder)
            cases.append(_read_case(folder, dataset.name))
    return tuple(cases)


def _read_case(folder: Path, name: str) -> HardCase:
    expected = json.loads((folder / EXPECTED_FILE.format(name)).read_text(encoding="utf-8"))
    path = load_path(folder / PATH_FILE.format(name))
    frames: tuple[ExpectedFrame, ...] = ()
    if "frames" in expected:
        frames = tuple(map(ExpectedFrame.read, expected["frames"], path.cameras))
    return HardCase(
        name,
        expected["what"],
        path,
        folder / SCENE_FILE.format(name),
        expected["cull_backfaces"],
        frames,
        tuple(expected.get("error", ())),
        tuple(expected.get("visible_between_samples", ())),
    )


@dataclass(frozen=True)
class Difference:
    """Where a frame's truth departs from the right verdict; see `Cell`."""

    samples: int
    objects: int
    ties_unseen: int


def compare(truth: FrameTruth, scene: Scene, expected: ExpectedFrame) -> Difference:
    """Compare a frame with its right verdict.

    At a tied sample any of the co-owners is right. A truth with complete ties must name them
    all, and list no others; what another truth does not list is counted as unseen.
    """
    owner, tied = _owners(truth, scene)
    which = expected.which.reshape(-1)
    wanted = [frozenset(scene.id_of_name[name] for name in names) for names in expected.sets]
    is_right = np.zeros((len(wanted), scene.object_count + 1), np.bool_)
    for number, ids in enumerate(wanted):
        is_right[number, list(ids) or [BACKGROUND]] = True
    wrong = ~is_right[which, owner]
    unseen = np.array([len(ids) > 1 for ids in wanted])[which]
    for sample, together in tied.items():
        if together == wanted[which[sample]]:
            unseen[sample] = False
        else:
            wrong[sample] = True
    unseen &= ~wrong
    if truth.ties_complete:
        wrong |= unseen
    seen = objects_seen(truth, scene)
    visible = {scene.names[i] for i in np.flatnonzero(seen.visible)}
    unlisted = frozenset() if truth.ties_complete else expected.tied
    objects = len(visible - expected.visible) + len(expected.visible - visible - unlisted)
    return Difference(int(np.count_nonzero(wrong)), objects, int(np.count_nonzero(unseen & ~wrong)))


def _owners(truth: FrameTruth, scene: Scene) -> tuple[NDArray[np.int32], dict[int, frozenset[int]]]:
    """Each sample's object (`BACKGROUND` for none), and all objects of the samples that the
    truth lists as tied between several."""
    triangle = truth.buffer.triangle.reshape(-1)
    owner = np.append(scene.object_of_triangle, np.int32(BACKGROUND))[triangle]
    tied: dict[int, set[int]] = {}
    other = scene.object_of_triangle[truth.ties.triangle]
    for sample, object_id in zip(truth.ties.sample.tolist(), other.tolist(), strict=True):
        if object_id != owner[sample]:
            tied.setdefault(sample, {int(owner[sample])}).add(object_id)
    return owner, {sample: frozenset(objects) for sample, objects in tied.items()}


EngineMaker = Callable[[str, Scene], TruthEngine]


def _run_engine(case: HardCase, spec: str, make: EngineMaker) -> Cell:
    """An engine on a case, which may be one that must not load."""
    try:
        scene = case.load()
    except InputError as error:
        named = bool(case.error) and all(part in str(error) for part in case.error)
        return Cell(State.RIGHT if named else State.WRONG, detail=_line(case, error))
    if case.error:
        return Cell(State.WRONG, detail="bad input was accepted")
    try:
        engine = make(spec, scene)
    except InputError as error:
        return Cell(State.REFUSED, detail=_line(case, error))
    try:
        found = [
            compare(engine.frame(camera), scene, frame)
            for camera, frame in zip(case.path, case.frames, strict=True)
        ]
    except InputError as error:
        return Cell(State.REFUSED, detail=_line(case, error))
    finally:
        engine.close()
    samples = sum(difference.samples for difference in found)
    objects = sum(difference.objects for difference in found)
    return Cell(
        State.WRONG if samples or objects else State.RIGHT,
        samples,
        objects,
        sum(difference.ties_unseen for difference in found),
    )


def _run_culler(
    case: HardCase,
    scene: Scene,
    truths: Sequence[FrameTruth],
    spec: str,
    make: Callable[[HardCase], Culler],
) -> Cell:
    """A culler on a case that loads, judged on the case's exact truths."""
    path = case.path.relative_to(scene.origin)
    referee = Referee(scene, lambda: RecalledTruths(scene, path, truths))
    try:
        outcome = referee.run(path, range(len(path)), [(spec, make(case))])
    except NothingToJudge as error:
        return Cell(State.UNAVAILABLE, detail=_line(case, error))
    except InputError as error:
        return Cell(State.REFUSED, detail=_line(case, error))
    return _culler_cell(outcome, outcome.cullers[0])


def _line(case: HardCase, error: Exception) -> str:
    """The error's line, without the temporary folder that the case was read from."""
    return str(error).replace(f"{case.scene_file.parent}{os.sep}", "")


def _culler_cell(outcome: RunOutcome, record: CullerRecord) -> Cell:
    details = {
        finding.code: finding.message
        for finding in outcome.findings
        if finding.code in (Code.NO_GL, Code.CULLER_FAILED)
    }
    totals = record.totals
    if Code.NO_GL in details:
        state = State.UNAVAILABLE
    elif totals.violations:
        state = State.WRONG
    elif record.failed:
        state = State.FAILED
    else:
        state = State.MEASURED if totals.confirmed else State.RIGHT
    lost = sum(
        int(misses.columns.samples[misses.are(MissKind.CONFIRMED)].sum())
        for misses in (row.verdict.misses for row in record.frames)
    )
    return Cell(
        state,
        lost,
        totals.confirmed,
        ties=totals.ties,
        within_raster_tolerance=totals.within_raster_tolerance,
        detail="; ".join(details.values()),
    )


def every_spec(group: str) -> list[str]:
    """Every installed engine or culler of a group: with its default options, then once for
    each other value of each option that has few, where it takes that value by itself."""
    specs = []
    for name in available(group):
        try:
            options = cast(type[Culler] | type[TruthEngine], available(group)[name].load()).options
        except ImportError:
            options = {}
        specs.append(name)
        for option, about in options.items():
            few = (False, True) if isinstance(about.default, bool) else about.choices
            others = [f"{name}:{option}={v}".lower() for v in few if v != about.default]
            specs += [spec for spec in others if _is_accepted(group, spec)]
    return specs


def _is_accepted(group: str, spec: str) -> bool:
    try:
        if group == CULLERS:
            make_culler(spec).close()
        else:
            check_engine(spec)
    except InputError:
        return False
    return True


def run_hard_cases(
    engines: Sequence[str],
    cullers: Sequence[str],
    *,
    programs: Mapping[str, Callable[[HardCase], Culler]] | None = None,
    only: Sequence[str] | None = None,
    make: EngineMaker = make_engine,
    on_case: Callable[[str], None] = lambda name: None,
) -> HardCaseTable:
    """Run engines and cullers (specs) on the hard cases, all or `only` some.

    The exact engine is always among the engines: cullers are judged by its truth. `programs`: by
    name, what makes a culler for one case, which are judged after `cullers`. `make` makes an
    engine from its spec; `on_case` is told of each case that is done. Raises InputError for an
    unknown case, engine or culler.
    """
    engines = tuple(dict.fromkeys([EXACT, *engines]))
    specs = tuple(dict.fromkeys(cullers))
    missing = _unavailable(engines, specs, make)
    makers = {spec: _maker(spec) for spec in specs} | dict(programs or {})
    cullers = tuple(makers)
    with tempfile.TemporaryDirectory(prefix="visref-hard-") as folder:
        table = HardCaseTable(read_cases(Path(folder), only), engines, cullers)
        for case in table.cases:
            cells = {spec: missing.get(spec) or _run_engine(case, spec, make) for spec in engines}
            if case.error:
                cells |= {spec: missing.get(spec) or cells[EXACT] for spec in cullers}
            else:
                scene = case.load()
                truths = list(_exact_truths(case, scene, make))
                for spec in cullers:
                    cells[spec] = missing.get(spec) or _run_culler(
                        case, scene, truths, spec, makers[spec]
                    )
            table.cells[case.name] = cells
            on_case(case.name)
    return table


def _maker(spec: str) -> Callable[[HardCase], Culler]:
    return lambda case: make_culler(spec)


def _exact_truths(case: HardCase, scene: Scene, make: EngineMaker) -> Iterator[FrameTruth]:
    engine = make(EXACT, scene)
    for camera in case.path:
        yield engine.frame(camera).copy()
    engine.close()


def _unavailable(
    engines: Sequence[str], cullers: Sequence[str], make: EngineMaker
) -> dict[str, Cell]:
    """The columns that cannot run on this machine. Raises InputError for what nobody has."""
    triangle = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    scene = Scene.from_objects([("triangle", triangle, np.array([[0, 1, 2]]))])
    missing = {}
    for spec in engines:
        if make is make_engine:
            check_engine(spec)
        try:
            make(spec, scene).close()
        except (InputError, NothingToJudge, ImportError) as error:
            missing[spec] = Cell(State.UNAVAILABLE, detail=str(error))
    for spec in cullers:
        try:
            make_culler(spec).close()
        except NothingToJudge as error:
            missing[spec] = Cell(State.UNAVAILABLE, detail=str(error))
    return missing
