"""A share of a run: the frames that one process judges, written as it goes.

Either into one folder, the whole run's or a part's, or into a folder for every so many frames, each
a part that `visref.merging` reads: what is written there need not be judged again.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from itertools import pairwise
from math import gcd
from pathlib import Path
from typing import Protocol, cast

from visref.alignment import misaligned
from visref.causes.evidence import Evidence
from visref.causes.pictured import paint_causes
from visref.causes.search import find_causes
from visref.culler import Culler
from visref.doing import doing
from visref.engines import TruthEngine, check_engine, make_engine
from visref.errors import InputError
from visref.inputs import Inputs
from visref.judging.again import Answers, Difference, ask, mark_unsteady
from visref.judging.asking import Job, Panel
from visref.judging.outcome import RunOutcome
from visref.judging.policy import Policy
from visref.judging.referee import ImageCheck, JudgedFrame, Listener, Referee
from visref.picking import Shard, Stretch, evenly_picked
from visref.recordings.truth_file import RecordedTruth
from visref.recordings.truth_reading import read_truth
from visref.recordings.visible_sets import Replay
from visref.registry import DEFAULT_ENGINE
from visref.run_folder.aside import Aside
from visref.run_folder.layout import PART, PICTURES, SUPERFLUOUS_ROWS, TRUTH
from visref.run_folder.part import InputFindings, Part, PartKeeper
from visref.run_folder.picture_plan import PicturePlan
from visref.run_folder.pictures import Painter
from visref.run_folder.write import RunWriter, write_json
from visref.visibility import FrameTruth, ObjectVisibility

# Makes the cullers of a run anew, with the same names; they live until the block ends.
MakingAnew = Callable[[], AbstractContextManager[Sequence[tuple[str, Culler]]]]

# Of the time that a part took to judge, what writing it may take at most.
_WRITING = 1 / 50


class Misaligned(StrEnum):
    """What becomes of the status of a recording that fits another input: it stays, or nothing is
    concluded from it. It stays in any case where an engine may err that way by itself."""

    KEEP = "keep"
    INCONCLUSIVE = "inconclusive"


@dataclass(frozen=True, eq=False)
class Asked:
    """What is asked of a run beside its inputs and cullers: see `visref.runs.judge_to_folder`."""

    truth: Path | None = None
    pictures: int = 4
    image_check: bool = False
    if_misaligned: Misaligned = Misaligned.KEEP
    policy: Policy | None = None
    repeat: int = 1
    anew: MakingAnew | None = None
    superfluous_rows: bool = False

    def __post_init__(self) -> None:
        if self.pictures < 0:
            raise InputError(f"--pictures is {self.pictures}", fix="give 0 or more")
        if self.repeat < 1 or (self.repeat > 1 and self.anew is None):
            fix = "give 1 or more, and a way to make cullers"
            raise InputError(f"--repeat is {self.repeat}", fix=fix)


class Parts(Protocol):
    """Where parts go as they are finished. `seconds`: how long one takes to judge, at least."""

    seconds: float

    def begin(self) -> Path:
        """A new folder, for a part that is about to begin."""
        ...

    def keep(self, folder: Path, stretch: Stretch) -> None:
        """The folder, which a part of these frames fills, is that part's for good. It moves."""
        ...


def judge_share(
    inputs: Inputs,
    cullers: Sequence[tuple[str, Culler]],
    folder: Path | None,
    asked: Asked,
    *,
    share: Shard | Stretch | None = None,
    parts: Parts | None = None,
    listeners: Sequence[Listener] = (),
    shares_cores: bool = False,
) -> RunOutcome | None:
    """Judge cullers in a share of the frames (None: in all) and write `folder`, which is there and
    empty. With `parts`, who are for a stretch, that is only for all frames, and where these are
    through before a part is due; then the outcome is the whole run's, otherwise None.
    `shares_cores`: others judge other shares on this machine at the same time.

    Raises InputError where the truth file is of another scene, path or engine; NothingToJudge where
    an engine cannot start.
    """
    recorded = None
    if asked.truth is not None:
        recorded = read_truth(asked.truth, inputs.scene, inputs.path, inputs.frames)
        inputs = _of_the_same_engine(inputs, recorded.engine, asked.truth)
    with ExitStack() as closing:
        checker = None
        if asked.image_check:
            # Any engine that redraws and compares pictures would do.
            checker = make_engine("gl", inputs.timeline.still)
            closing.callback(checker.close)
        referee = Referee(
            inputs.scene,
            inputs.make_engine,
            threads=inputs.threads,
            recorded=recorded,
            image_check=cast(ImageCheck | None, checker),
            examine=True,
            held=Aside(),  # the folder has it all
            timeline=inputs.timeline,
            policy=asked.policy or Policy(),
            shares_cores=shares_cores,
        )
        answers = Answers()
        writing = _Writing(inputs, cullers, asked, share, recorded, referee, folder, parts)
        kept: list[Listener] = [answers] if asked.repeat > 1 else []
        outcome = referee.run(
            inputs.path,
            inputs.frames,
            cullers,
            [writing, *kept, *listeners],
            shard=share,
            parting=writing,
        )
        again = [
            _asked_again(inputs, asked, answers, outcome, share) for _ in range(asked.repeat - 1)
        ]
        mark_unsteady(outcome, again)
        return outcome if writing.finish(outcome, again) else None


class _Writing:
    """A run's listener that writes a share of it, and parts it where that is due."""

    def __init__(
        self,
        inputs: Inputs,
        cullers: Sequence[tuple[str, Culler]],
        asked: Asked,
        share: Shard | Stretch | None,
        recorded: RecordedTruth | None,
        referee: Referee,
        folder: Path | None,
        parts: Parts | None,
    ) -> None:
        self._inputs = inputs
        self._cullers = cullers
        self._asked = asked
        self._share = share
        self._recorded = recorded
        self._referee = referee
        self._parts = parts
        self._of_inputs: InputFindings | None = None
        self._frames = tuple(inputs.frames)
        self._latency = 0 if asked.policy is None else asked.policy.latency_frames
        picked = evenly_picked(len(self._frames), asked.pictures)
        self._planned = [self._frames[i] for i in picked]
        part = self._part(share) if share is not None else None
        self._plan = PicturePlan(self._planned, part.open if part is not None else frozenset())
        self._first: dict[str, int] = {}
        # Of what may be the whole run.
        may_be_whole = folder is not None and not isinstance(share, Shard)
        self._evidence = Evidence() if may_be_whole else None
        if folder is None:
            assert parts is not None
            folder = parts.begin()
        self._least = 0.0 if parts is None else parts.seconds
        self._begin(folder, share.start if isinstance(share, Stretch) else 0)

    def _part(self, share: Shard | Stretch) -> Part:
        since = self._share.start if isinstance(self._share, Stretch) else None
        return Part(share, self._frames, self._latency, since)

    def _begin(self, folder: Path, start: int) -> None:
        """A folder for the frames from the place `start` on."""
        inputs, share = self._inputs, self._share
        self._folder, self._start, self._began = folder, start, time.monotonic()
        self._writer = RunWriter(
            folder,
            inputs.scene,
            inputs.path,
            timeline=inputs.timeline,
            engine=inputs.engine,
            exact=self._recorded.exact if self._recorded is not None else None,
            settings=self._settings(),
            policy=self._asked.policy,
            picture_frames=self._planned,
            part=None if share is None else self._part(share),
            plan=self._plan,
            superfluous_rows=self._asked.superfluous_rows,
            first=self._first,
        )
        self._keeper = None if share is None else PartKeeper(folder, inputs.scene, inputs.path)

    def _settings(self) -> dict[str, object]:
        asked, share = self._asked, self._share
        return {
            **self._inputs.settings,
            "frames": _slice(self._inputs.frames),
            **({"repeat": asked.repeat} if asked.repeat > 1 else {}),
            **({SUPERFLUOUS_ROWS: True} if asked.superfluous_rows else {}),
            **(
                {}
                if asked.if_misaligned is Misaligned.KEEP
                else {"if_misaligned": asked.if_misaligned}
            ),
            **({"shard": str(share)} if isinstance(share, Shard) else {}),
        }

    @property
    def _kept(self) -> list[Listener]:
        return [one for one in (self._writer, self._keeper, self._evidence) if one is not None]

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        for listener in self._kept:
            listener.on_truth(frame, truth, seen, ms)

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        for listener in self._kept:
            listener.on_verdict(job, judged)

    def on_frame_done(self, frame: int) -> None:
        # While there is an engine that may be lent.
        self._look_at_inputs()
        for listener in self._kept:
            listener.on_frame_done(frame)

    def due(self, frame: int) -> bool:
        """Whether a part is. Who is asked again is so once all is through."""
        if self._parts is None or self._asked.repeat > 1:
            return False
        return time.monotonic() - self._began >= self._least

    def take(self, outcome: RunOutcome, frame: int) -> None:
        """A part ends with this frame, and the next one begins."""
        assert self._parts is not None
        self._put_first(outcome)
        began = time.monotonic()
        self._evidence = None
        stop = self._frames.index(frame, self._start) + 1
        self._keep(outcome, Stretch(self._start, stop), [])
        self._least = max(self._parts.seconds, (time.monotonic() - began) / _WRITING)
        self._begin(self._parts.begin(), stop)

    def finish(self, outcome: RunOutcome, again: Sequence[dict[str, Difference]]) -> bool:
        """Write the last folder. Whether it is the whole run's."""
        self._put_first(outcome)
        if self._evidence is not None:
            name_the_causes(self._inputs, self._evidence, outcome)
            self._writer.add_pictures(
                paint_causes(
                    self._inputs,
                    self._evidence,
                    outcome.cullers,
                    self._plan,
                    Painter(self._folder / PICTURES),
                )
            )
            if self._keeper is not None:
                self._keeper.discard()
            self._writer.finish(outcome)
            self._copy_truth()
            return True
        if isinstance(self._share, Stretch):
            self._keep(outcome, Stretch(self._start, self._share.stop), again)
            return False
        assert self._share is not None
        self._write_part(outcome, self._share, again)
        self._copy_truth()
        return True

    def _keep(
        self, outcome: RunOutcome, stretch: Stretch, again: Sequence[dict[str, Difference]]
    ) -> None:
        assert self._parts is not None
        self._write_part(outcome, stretch, again)
        self._parts.keep(self._folder, stretch)

    def _write_part(
        self, outcome: RunOutcome, share: Shard | Stretch, again: Sequence[dict[str, Difference]]
    ) -> None:
        assert self._keeper is not None
        assert self._of_inputs is not None
        part = self._part(share)
        self._writer.finish(outcome, part)
        said = self._keeper.finish(
            part, outcome, self._referee.facts, self._of_inputs, again, pictures=self._planned,
            moved=self._writer.moved, truth=self._asked.truth is not None,
        )  # fmt: skip
        write_json(self._folder / PART, said)

    def _copy_truth(self) -> None:
        if self._asked.truth is not None:
            shutil.copyfile(self._asked.truth, self._folder / TRUTH)

    def _put_first(self, outcome: RunOutcome) -> None:
        """Say what is to be said of the inputs."""
        self._look_at_inputs().put_first(outcome)

    def _look_at_inputs(self) -> InputFindings:
        """What is to be said of the inputs, which is found once."""
        if self._of_inputs is None:
            found = _of_the_input(
                self._inputs,
                self._cullers,
                self._asked.if_misaligned,
                self._referee.caster,
                self._recorded,
            )
            found.notes += self._inputs.notes
            found.recorded += self._recorded.findings if self._recorded else ()
            self._of_inputs = found
        return self._of_inputs


def name_the_causes(inputs: Inputs, evidence: Evidence, outcome: RunOutcome) -> None:
    """Say why things were missed (`visref.causes`), in the outcome's records."""
    with doing("finding out why things were missed"):
        find_causes(
            evidence,
            outcome.cullers,
            inputs.timeline,
            inputs.path,
            inputs.frames,
            inputs.make_engine,
        )


def _asked_again(
    inputs: Inputs,
    asked: Asked,
    answers: Answers,
    outcome: RunOutcome,
    share: Shard | Stretch | None,
) -> dict[str, Difference]:
    """Hold the answers of the run against those of cullers that are made anew, by name."""
    frames = inputs.frames
    judged = frames if share is None else share.of(frames)
    assert asked.anew is not None
    with asked.anew() as cullers:
        panel = Panel(cullers, inputs.timeline, outcome.policy)
        path = inputs.path.relative_to(inputs.scene.origin)
        again = ask(panel, path, frames, judged)
    return {
        record.spec: Difference.between(answers, again, record, other)
        for record, other in zip(outcome.cullers, panel.records, strict=True)
    }


def _of_the_input(
    inputs: Inputs,
    cullers: Sequence[tuple[str, Culler]],
    if_misaligned: Misaligned,
    lent: TruthEngine | None,
    truth: RecordedTruth | None,
) -> InputFindings:
    """What is said of recordings that fit another input. `lent`: an engine that is there; `truth`:
    the one given."""
    found = InputFindings()
    for name, culler in cullers:
        if not isinstance(culler, Replay):
            continue
        finding, by_input_alone = misaligned(
            name,
            inputs.timeline,
            inputs.path,
            culler.recorded,
            threads=inputs.threads,
            lent=lent,
            known=None if truth is None else partial(truth.known, inputs.scene.object_count),
        )
        if finding is None:
            continue
        found.misaligned.append(finding)
        if by_input_alone and if_misaligned is Misaligned.INCONCLUSIVE:
            found.excused.append(name)
    return found


def _slice(frames: Sequence[int]) -> list[int]:
    """Start, stop and step of the slice that picks these frames, of those that there are."""
    if isinstance(frames, range):
        return [frames.start, frames.stop, frames.step]
    return [frames[0], frames[-1] + 1, gcd(*(b - a for a, b in pairwise(frames))) or 1]


def _of_the_same_engine(inputs: Inputs, engine: str, truth: Path) -> Inputs:
    """Inputs that cast with the engine of a truth file. What that truth says was missed, another
    engine might not see at all."""
    if inputs.engine not in (engine, DEFAULT_ENGINE):
        raise InputError(
            f"it was cast by '{engine}', not '{inputs.engine}'",
            source=str(truth),
            fix="leave --engine out, or cast the truth again",
        )
    try:
        check_engine(engine)
    except InputError as error:
        raise error.at(source=str(truth)) from error
    return replace(inputs, engine=engine)
