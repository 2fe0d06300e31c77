"""Judging in a test: what the fixtures of `visref.pytest_plugin` give."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from visref.culler import Culler, Promise, RasterTolerance
from visref.errors import InputError
from visref.inputs import Inputs, open_inputs, open_recorded
from visref.judging.outcome import RunOutcome
from visref.judging.policy_file import read_policy
from visref.judging.status import Status
from visref.plug_ins import Making, making_cullers
from visref.recordings.visible_sets import Replay, VisibleSets, read_visible_sets
from visref.report.misses import convicted, convicted_lines, facts_of, object_misses, why_lines
from visref.report.summary import CullerSummary, summarise
from visref.report.words import (
    HEADLINES,
    accepted,
    culler_sentence,
    failing_lines,
    hidden_line,
    hidden_name,
)
from visref.run_folder.read import RunFolder, read_run
from visref.runs import judge_to_folder
from visref.wording import legible

# Of so many objects a message tells; the run folder has all.
_TOLD = 5

Subject = Culler | type[Culler] | str


class SceneChoice:
    """The scene that a test judges on. It is read when it is first needed, and once for all tests
    of a process that ask for the same."""

    def __init__(self, opened: dict[Any, Any]) -> None:
        self._opened = opened
        self._scene: str | None = None
        self._settings: dict[str, Any] = {}

    def __call__(
        self,
        scene: str | os.PathLike[str],
        path: str | os.PathLike[str] | None = None,
        **settings: Any,
    ) -> SceneChoice:
        """Choose a scene, and the path along which it is seen; `settings` are those of
        `visref.open_inputs`."""
        self._scene = os.fspath(scene)
        self._settings = settings if path is None else {**settings, "path": os.fspath(path)}
        return self

    @property
    def inputs(self) -> Inputs:
        """Scene, path and frames. Raises InputError for anything wrong with them."""
        inputs: Inputs = self._once(open_inputs)
        return inputs

    def recorded(self, file: Path) -> tuple[Inputs, VisibleSets]:
        """The scene with a recording's own path, and what was drawn. Raises InputError."""
        if "path" in self._settings:
            raise InputError("a recording has its cameras", fix="leave the scene's path out")
        read: tuple[Inputs, VisibleSets] = self._once(open_recorded, str(file))
        return read

    def _once(self, read: Callable[..., Any], *more: str) -> Any:
        if self._scene is None:
            raise InputError(
                "no scene was chosen",
                fix="mark the test with @pytest.mark.visref_scene(SCENE, path=PATH), or call "
                "visref_scene(SCENE, path=PATH)",
            )
        # A file may be written anew by another test.
        files = (self._scene, self._settings.get("path"), *more)
        stamps = tuple(map(_stamp, files))
        key = (read.__name__, os.getcwd(), *more, self._scene, *self._settings.items(), stamps)
        if key not in self._opened:
            settings = {"threads": _threads(), **self._settings}
            self._opened[key] = read(self._scene, *more, **settings)
        return self._opened[key]


def _stamp(name: str | None) -> tuple[int, int] | None:
    try:
        found = os.stat(name or "")
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_size


def _threads() -> int | None:
    """This worker's share of the cores, where pytest-xdist runs several; None: all."""
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    return None if workers == 1 else max(1, (os.cpu_count() or 1) // workers)


@dataclass(frozen=True, eq=False)
class Judged:
    """What was found of one culler or recording. `outcome`: the whole run, as values; `run`: its
    folder, as read; `row`: the culler's counts and rates.

    It is true where no violation was found: not where nothing could be judged, nor for what
    promises nothing.
    """

    outcome: RunOutcome
    run: RunFolder
    row: CullerSummary

    @property
    def status(self) -> Status:
        """The run's: a stale waiver, say, makes it a violation whatever the culler is."""
        return self.outcome.status

    @property
    def folder(self) -> Path:
        """The run folder, for `visref explain` and `visref report`."""
        return self.run.folder

    def __bool__(self) -> bool:
        return self.status is Status.NO_VIOLATION_FOUND

    def __repr__(self) -> str:
        lost = [f"misses {one.worst.name!r}" for one in convicted(self.row)[:1]]
        return f"<visref: {self.row.culler}: {', '.join([HEADLINES[self.status], *lost])}>"

    def assert_no_violation(self) -> None:
        """Raises AssertionError, with what was found, unless no violation was found."""
        __tracebackhide__ = True
        if not self:
            raise AssertionError(self.message)

    @property
    def message(self) -> str:
        """What was found, for whoever mends it: each of the worst objects with frame, pixel,
        witness and cause, and the command that explains it."""
        row, run = self.row, self.run
        lines = [f"{row.culler}: {HEADLINES[self.status]}. {culler_sentence(row)}"]
        lines += failing_lines(run)
        lines += why_lines(run.verdict.cullers[row.culler].causes)
        missed = object_misses(run, row.culler)
        guilty, facts = convicted(row), facts_of(run, row, _TOLD)
        for lost in guilty[:_TOLD]:
            obj = lost.worst.object
            told = convicted_lines(run, row, lost, missed.get(obj), Path(), facts.get(obj, ""))
            first, *more = told
            lines += [f"  {first}", *(f"    {line}" for line in more)]
        lines += [f"  {hidden_name(row, one)}: {hidden_line(one)}" for one in row.hidden[:_TOLD]]
        more_objects = max(0, len(guilty) - _TOLD) + max(0, len(row.hidden) - _TOLD)
        if more_objects:
            lines.append(f"  … and {more_objects:,} more")
        counts = row.counts
        if said := accepted(counts.small, counts.late, counts.waived):
            lines.append(f"  accepted by the policy: {said}")
        lines += [
            f"  {finding.code}: {finding.message}"
            for finding in run.verdict.findings
            if row.failed and finding.culler == row.culler and finding.severity != "info"
        ]
        lines.append(f"  the run: {run.folder}")
        return "\n".join(map(legible, lines))


class Judge:
    """Judges on the chosen scene. `folder` gives a new folder for each run."""

    def __init__(self, scene: SceneChoice, folder: Callable[[], Path]) -> None:
        self._scene = scene
        self._folder = folder
        self._judged: list[Judged] = []

    def __call__(
        self,
        subject: Subject | None = None,
        *,
        recording: str | os.PathLike[str] | None = None,
        visible: str | os.PathLike[str] | None = None,
        promise: Promise | str = Promise.CONSERVATIVE,
        raster: RasterTolerance | None = None,
        policy: str | os.PathLike[str] | None = None,
    ) -> Judged:
        """Judge a culler, or the spec of one; or what an engine drew: `recording` with its cameras
        in one file, or `visible` along the chosen path, for both of which `promise` and `raster`
        are what the engine declares. `policy`: what is accepted, a file.

        Raises InputError for anything wrong with them; whatever a culler does is in the verdict.
        """
        if sum(given is not None for given in (subject, recording, visible)) != 1:
            raise TypeError("give one of: a culler, recording=, visible=")
        if subject is not None:
            inputs = self._scene.inputs
            if isinstance(subject, str):
                with making_cullers([subject], Making()) as cullers:
                    return self._judge(inputs, cullers[0], policy)
            culler = subject() if isinstance(subject, type) else subject
            return self._judge(inputs, (culler.name, culler), policy)
        if recording is not None:
            file = Path(recording)
            inputs, sets = self._scene.recorded(file)
        else:
            assert visible is not None
            file, inputs = Path(visible), self._scene.inputs
            sets = read_visible_sets(
                file, inputs.scene, inputs.frames, inputs.path, max_memory=inputs.max_memory
            )
        replay = Replay(sets, inputs.path, Promise(promise), raster)
        return self._judge(inputs, (file.name, replay), policy)

    def _judge(
        self, inputs: Inputs, named: tuple[str, Culler], policy: str | os.PathLike[str] | None
    ) -> Judged:
        read = None if policy is None else read_policy(Path(policy))
        out = self._folder() / "run"
        outcome = judge_to_folder(inputs, [named], out, pictures=0, policy=read)
        run = read_run(out)
        judged = Judged(outcome, run, summarise(run, named[0]))
        self._judged.append(judged)
        return judged

    def unsaid(self, said: str) -> list[str]:
        """The messages of what did not pass in this test that are not in a text already."""
        messages = [judged.message for judged in self._judged if not judged]
        return [text for text in messages if text.splitlines()[0] not in said]
