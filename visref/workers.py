"""A run on several cores, or in several goes: processes that judge a part of the frames each, and
one run folder.

Workers are copies of this process, which share the scene with it. Each judges a part of the frames
(`visref.shares`) and keeps it as it goes (`visref.kept`), and what they leave is merged
(`visref.merging`): the bytes are those of one. A run that ended in between goes on with what it
kept.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from visref.errors import InputError
from visref.files import refuse_inputs, replacing_folder
from visref.forked import Tell, Work, at_work
from visref.inputs import Inputs
from visref.judging.asking import Job
from visref.judging.outcome import RunOutcome
from visref.judging.policy import Policy
from visref.judging.referee import JudgedFrame, Listener
from visref.kept import Kept, keeping
from visref.memory import SAMPLE_BYTES, TRIANGLE_BYTES, default_budget
from visref.picking import Shard, Stretch, stretches
from visref.recordings.truth_reading import can_be_merged, read_rows
from visref.run_folder.layout import RUN_FOLDER
from visref.runs import merge_naming
from visref.shares import Asked, MakingAnew, judge_share
from visref.threads import available_threads
from visref.visibility import FrameTruth, ObjectVisibility

# A worker makes its own engine and meets the scene with its own cullers: with fewer frames that is
# most of what it does.
LEAST_FRAMES = 8
# What is recorded costs nothing to ask: one worker casts the truth on all cores, and another wins
# a sixth of a frame's time, which pays for its start with so many frames.
LEAST_RECORDED = 256
# What a worker holds beside the scene, which all share: libraries and their threads, and for each
# triangle the engine's hierarchy and float32 corners, and buffers of the cullers.
WORKER_BYTES = 256 << 20
WORKER_TRIANGLE_BYTES = 2 * TRIANGLE_BYTES


def default_workers(inputs: Inputs, *, sharing: bool = True, recorded: bool = False) -> int:
    """How many workers a run is worth: a core each, where memory allows. `sharing`: they share the
    scene with this process, as its copies do; `recorded`: all cullers are recordings."""
    if sharing and not hasattr(os, "fork"):
        return 1
    samples = max(
        (camera.samples for frame in inputs.frames for camera in inputs.path.views(frame)),
        default=0,
    )
    each = (
        WORKER_BYTES + inputs.scene.triangle_count * WORKER_TRIANGLE_BYTES + samples * SAMPLE_BYTES
    )
    if not sharing:
        each += inputs.scene.triangle_count * TRIANGLE_BYTES
    by_memory = default_budget() // each
    least = LEAST_RECORDED if recorded and sharing else LEAST_FRAMES
    return max(1, min(available_threads(), len(inputs.frames) // least, by_memory))


@dataclass(frozen=True, eq=False)
class Going:
    """A run that is under way. `before`: how many of its `frames` were finished earlier, by the
    same command; `spoilt`: what was wrong with others, which are judged again; `finish` waits for
    the rest, and is told of each frame that is judged, in whatever order."""

    frames: int
    before: int
    spoilt: Sequence[str]
    finish: Callable[[Callable[[int], None]], RunOutcome]
    kept: Kept

    def __call__(self, on_frame: Callable[[int], None]) -> RunOutcome:
        return self.finish(on_frame)

    @property
    def finished(self) -> int:
        """How many frames are kept by now, whatever happens."""
        if math.isinf(self.kept.seconds):
            return 0
        return sum(stretch.stop - stretch.start for stretch, _ in self.kept.finished())


@contextmanager
def judging_at_once(
    inputs: Inputs,
    anew: MakingAnew,
    out: Path | str,
    *,
    workers: int,
    truth: Path | str | None = None,
    policy: Policy | None = None,
    command: Mapping[str, str] | None = None,
    **given: Any,
) -> Iterator[Going]:
    """`visref.runs.judge_to_folder` by so many workers, which are at work while the block lasts;
    what it yields waits for them and gives the outcome. To be entered before this process has
    threads of its own. `anew` makes each worker's cullers, in it; `given`: what else
    `judge_to_folder` takes. `command`: what determines the result, by name; where it is given, what
    is finished is kept on the way, and the same command goes on with it.

    Raises what that raises; InputError where another command's parts are kept for `out`;
    RuntimeError where a worker broke down.
    """
    if not 1 <= workers <= len(inputs.frames):
        raise InputError(
            f"--workers is {workers}", fix=f"give 1 to the number of frames, {len(inputs.frames)}"
        )
    if workers > 1 and not hasattr(os, "fork"):
        raise InputError("--workers: this system cannot copy a process", fix="leave it out")
    asked = Asked(truth=None if truth is None else Path(truth), policy=policy, anew=anew, **given)
    with (
        begun(inputs, out, truth=asked.truth, policy=policy, command=command) as run,
        _at_work(run, anew, asked, workers) as going,
    ):
        yield going


@dataclass(frozen=True, eq=False)
class Begun:
    """A run folder that is to be: `folder` is there and empty. `done`: at how many of its frames
    the parts that are `kept` stand, `left`: the places of the others. `alone`: its truth file can
    only be read by one who judges all, and nothing can be kept."""

    inputs: Inputs
    folder: Path
    truth: Path | None
    kept: Kept
    done: int
    left: Sequence[int]
    alone: bool

    def merged(self) -> RunOutcome:
        """The run folder of what is kept by now."""
        self.folder.mkdir(exist_ok=True)
        parts = [path for _, path in self.kept.finished()]
        return merge_naming(self.folder, parts, self.inputs, self.truth)

    def going(self, finish: Callable[[Callable[[int], None]], RunOutcome]) -> Going:
        """It is under way; who `finish`es it, as `Going` has it, judges what is left."""
        frames = len(self.inputs.frames)
        return Going(frames, self.done, self.kept.spoilt, finish, self.kept)


@contextmanager
def begun(
    inputs: Inputs,
    out: Path | str,
    *,
    truth: Path | None,
    policy: Policy | None,
    command: Mapping[str, str] | None,
) -> Iterator[Begun]:
    """A run whose parts are judged by whoever; it stands at `out` when the block ends well.
    Arguments and errors as of `judging_at_once`."""
    refuse_inputs(out, [*inputs.files, truth, policy.source if policy is not None else None])
    with ExitStack() as closing:
        lasting = None
        if command is not None:
            lasting = closing.enter_context(keeping(out, command))
        with replacing_folder(out, kind=RUN_FOLDER) as folder:
            kept = lasting
            if kept is None:
                # Beside it, and gone with it.
                kept = Kept(folder.parent, "", math.inf)
            rows = None
            alone = truth is not None and not can_be_merged(truth)
            if alone:
                kept.seconds = math.inf
            elif truth is not None and kept.finished():
                rows = read_rows(truth)
            finished = kept.sound(inputs.frames, rows)
            done = {place for stretch in finished for place in range(stretch.start, stretch.stop)}
            left = [place for place in range(len(inputs.frames)) if place not in done]
            yield Begun(inputs, folder, truth, kept, len(done), left, alone)
        if lasting is not None:
            lasting.remove()


@contextmanager
def _at_work(run: Begun, anew: MakingAnew, asked: Asked, workers: int) -> Iterator[Going]:
    inputs, left = run.inputs, run.left
    workers = 1 if run.alone else min(workers, len(left))
    pieces = [stretches(Shard(number, workers).of(left)) for number in range(1, workers + 1)]
    if workers <= 1:
        with ExitStack() as closing:
            ready = [closing.enter_context(anew())] if left else []

            def alone(on_frame: Callable[[int], None]) -> RunOutcome:
                for stretch in pieces[0] if pieces else []:
                    cullers = ready.pop() if ready else closing.enter_context(anew())
                    whole = judge_share(
                        inputs, cullers, None if run.done else run.folder, asked, share=stretch,
                        parts=run.kept, listeners=[_Telling(on_frame)],
                    )  # fmt: skip
                    if whole is not None:
                        return whole
                return run.merged()

            yield run.going(alone)
        return
    threads = max(1, (inputs.threads or available_threads()) // workers)

    def work_on(piece: Sequence[Stretch]) -> Work:
        def work(tell: Tell) -> None:
            # Mesa's rasteriser takes all cores, where nobody says otherwise.
            os.environ.setdefault("LP_NUM_THREADS", str(threads))
            for stretch in piece:
                with anew() as cullers:
                    judge_share(
                        replace(inputs, threads=threads), cullers, None, asked, share=stretch,
                        parts=run.kept, listeners=[_Telling(tell)], shares_cores=True,
                    )  # fmt: skip

        return work

    with at_work([work_on(piece) for piece in pieces]) as copies:

        def wait(on_frame: Callable[[int], None]) -> RunOutcome:
            copies.wait(on_frame)
            return run.merged()

        yield run.going(wait)


class _Telling(Listener):
    """A run's listener in a worker."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        pass

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        pass

    def on_frame_done(self, frame: int) -> None:
        self._tell(frame)
