"""A run on several cores: processes that judge a part of the frames each, and one run folder.

Workers are copies of this process, which share the scene with it. Each judges its part as a shard
(`visref.runs`), and what they leave is merged (`visref.merging`): the bytes are those of one.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
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
from visref.memory import SAMPLE_BYTES, TRIANGLE_BYTES, default_budget
from visref.picking import Shard
from visref.run_folder.layout import RUN_FOLDER
from visref.runs import MakingAnew, judge_to_folder, merge_naming
from visref.threads import available_threads
from visref.visibility import FrameTruth, ObjectVisibility

# A worker makes its own engine and meets the scene with its own cullers: with fewer frames that is
# most of what it does.
LEAST_FRAMES = 8
# What a worker holds beside the scene, which all share: libraries and their threads, and for each
# triangle the engine's hierarchy and float32 corners, and buffers of the cullers.
WORKER_BYTES = 256 << 20
WORKER_TRIANGLE_BYTES = 2 * TRIANGLE_BYTES


def default_workers(inputs: Inputs) -> int:
    """How many workers a run is worth: a core each, where memory allows."""
    if not hasattr(os, "fork"):
        return 1
    samples = max(
        (camera.samples for frame in inputs.frames for camera in inputs.path.views(frame)),
        default=0,
    )
    each = (
        WORKER_BYTES + inputs.scene.triangle_count * WORKER_TRIANGLE_BYTES + samples * SAMPLE_BYTES
    )
    by_memory = default_budget() // each
    return max(1, min(available_threads(), len(inputs.frames) // LEAST_FRAMES, by_memory))


# Waits for the workers, and is told of each frame that is judged, in whatever order.
Finishing = Callable[[Callable[[int], None]], RunOutcome]


@contextmanager
def judging_at_once(
    inputs: Inputs,
    anew: MakingAnew,
    out: Path | str,
    *,
    workers: int,
    truth: Path | str | None = None,
    policy: Policy | None = None,
    **given: Any,
) -> Iterator[Finishing]:
    """`visref.runs.judge_to_folder` by so many workers, which are at work while the block lasts;
    what it yields waits for them and gives the outcome. To be entered before this process has
    threads of its own. `anew` makes each worker's cullers, in it; `given`: what else
    `judge_to_folder` takes.

    Raises what that raises; RuntimeError where a worker broke down.
    """
    if not 1 <= workers <= len(inputs.frames):
        raise InputError(
            f"--workers is {workers}", fix=f"give 1 to the number of frames, {len(inputs.frames)}"
        )
    if not hasattr(os, "fork"):
        raise InputError("--workers: this system cannot copy a process", fix="leave it out")
    refuse_inputs(out, [*inputs.files, truth, policy.source if policy is not None else None])
    threads = max(1, (inputs.threads or available_threads()) // workers)
    with replacing_folder(out, kind=RUN_FOLDER) as folder:
        # Beside it, and gone with it.
        parts = [folder.parent / f"part-{number}" for number in range(1, workers + 1)]

        def piece(number: int) -> Work:
            def work(tell: Tell) -> None:
                # Mesa's rasteriser takes all cores, where nobody says otherwise.
                os.environ.setdefault("LP_NUM_THREADS", str(threads))
                with anew() as cullers:
                    judge_to_folder(
                        replace(inputs, threads=threads),
                        cullers,
                        parts[number - 1],
                        truth=truth,
                        policy=policy,
                        anew=anew,
                        shard=Shard(number, workers),
                        listeners=[_Telling(tell)],
                        **given,
                    )

            return work

        with at_work([piece(number) for number in range(1, workers + 1)]) as copies:

            def finish(on_frame: Callable[[int], None]) -> RunOutcome:
                copies.wait(on_frame)
                return merge_naming(folder, parts, inputs)

            yield finish


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
