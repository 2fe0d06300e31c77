"""A judged run on the terminal: what `demo`, `run` and `check` print."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from visref.beside import steady
from visref.cli.arguments import shard_of
from visref.cli.manners import MANNERS, OF_SEVERITY, OF_STATUS
from visref.cli.terminal import ERRORS, OUT, frame_bar
from visref.errors import InputError
from visref.findings import Code, Finding, fails_run
from visref.inputs import Inputs
from visref.judging.judge import Counts
from visref.judging.outcome import CullerRecord, RunOutcome
from visref.judging.policy import Policy
from visref.judging.status import Status
from visref.papers import contents as papers
from visref.papers import tables_beside
from visref.report import words
from visref.report.misses import why_lines
from visref.report.tables import GLYPHS, HEADINGS, claim_text, table_lines
from visref.run_folder.inside import json_inside
from visref.run_folder.layout import VERDICT
from visref.run_folder.read import read_run
from visref.runs import MakingAnew, Misaligned, judge_to_folder
from visref.threads import available_threads
from visref.wording import counted
from visref.workers import Going, default_workers, judging_at_once

if TYPE_CHECKING:
    from visref.cluster.order import Opening

FINDINGS_SHOWN = 10


def judge(
    given: argparse.Namespace,
    inputs: Inputs,
    anew: MakingAnew,
    *,
    policy: Policy | None = None,
    image_check: bool = False,
    repeat: int = 1,
    if_misaligned: Misaligned = Misaligned.KEEP,
    alone: str = "",
    recorded: bool = False,
    command: Mapping[str, str],
    opening: Opening,
    packages: Sequence[str] = (),
) -> RunOutcome:
    """Judge by the judging arguments, print the verdict and the papers' numbers beside ours. `anew`
    makes the cullers; `alone`: why one worker must judge them, empty where it need not; `recorded`:
    all of them are recordings. `command`: what determines the result, by name. `opening` reads the
    inputs again, in a worker of a cluster, which must have the same code of `packages`."""
    shard = shard_of(given)
    alone = alone or ("--shard" if shard is not None else "")
    _check_dask(given, alone)
    workers = _workers(given, inputs, alone, recorded)
    judged = inputs.frames if shard is None else shard.of(inputs.frames)
    options: dict[str, Any] = {
        "truth": given.truth,
        "pictures": given.pictures,
        "superfluous_rows": given.superfluous_rows,
        "image_check": image_check,
        "if_misaligned": if_misaligned,
        "policy": policy,
        "repeat": repeat,
    }
    with ExitStack() as closing:
        # Before the display, which has a thread: workers are copies of this process.
        if shard is None:
            work: AbstractContextManager[Going]
            if given.dask is None:
                work = judging_at_once(
                    inputs, anew, given.out, workers=workers, command=command, **options
                )
            else:
                work = _on_dask(
                    given, inputs, anew, workers, closing, command=command,
                    opening=None if given.dask_scene == "send" else opening,
                    packages=packages, **options,
                )  # fmt: skip
            going = closing.enter_context(work)
            _say_before(going)
            bar = closing.enter_context(frame_bar(going.frames - going.before))
            try:
                outcome = going.finish(bar.on_frame_done)
            except BaseException:
                _say_kept(given, going)
                raise
        else:
            cullers = closing.enter_context(anew())
            bar = closing.enter_context(frame_bar(len(judged)))
            outcome = judge_to_folder(
                inputs, cullers, given.out, listeners=[bar], anew=anew, shard=shard, **options
            )
    print_run(given.out, outcome)
    return outcome


def _check_dask(given: argparse.Namespace, alone: str) -> None:
    if given.dask is None:
        for option in ("--dask-scene", "--dask-frames"):
            if getattr(given, option[2:].replace("-", "_")) is not None:
                raise InputError(f"{option} is given, and no --dask", fix="give both, or neither")
    elif alone:
        raise InputError(f"--dask, with {alone}", fix="leave one of them out")


def _on_dask(
    given: argparse.Namespace,
    inputs: Inputs,
    anew: MakingAnew,
    workers: int,
    closing: ExitStack,
    **options: Any,
) -> AbstractContextManager[Going]:
    """A run on a cluster, which is met now and left with `closing`."""
    # Dask is imported only where it is asked for.
    from visref.cluster import LOCAL, connected, judging_on_dask

    if given.dask != LOCAL:
        client = closing.enter_context(connected(given.dask, given.workers))
    else:
        if given.workers is None:
            workers = default_workers(inputs, sharing=False)
        # They share the cores of this machine.
        threads = max(1, (inputs.threads or available_threads()) // workers)
        inputs = replace(inputs, threads=threads)
        client = closing.enter_context(connected(LOCAL, workers))
    return judging_on_dask(
        inputs, anew, given.out, client, frames_each=given.dask_frames, **options
    )


def _say_before(going: Going) -> None:
    for line in going.spoilt:
        ERRORS.line(f"{line}; its frames are judged again")
    if going.before:
        OUT.remark(f"Goes on after {going.before:,} of {counted(going.frames, 'frame')}")


def _say_kept(given: argparse.Namespace, going: Going) -> None:
    """What is there to go on with, though the run ended before its time."""
    if kept := going.finished:
        said = f"{kept:,} of {counted(going.frames, 'frame')} are kept: the same command goes on"
        if isinstance(sys.exception(), KeyboardInterrupt):
            given.interrupted = said
        else:
            ERRORS.line(said)


def _workers(given: argparse.Namespace, inputs: Inputs, alone: str, recorded: bool) -> int:
    """How many workers judge."""
    asked: int | None = given.workers
    if asked is None:
        return 1 if alone else default_workers(inputs, recorded=recorded)
    if asked < 1 or (asked > 1 and alone):
        problem = f"--workers is {asked}" + (f", with {alone}" if alone and asked > 1 else "")
        raise InputError(problem, fix="give 1" if alone else "give 1 or more")
    return min(asked, len(inputs.frames))


def print_run(out: Path, outcome: RunOutcome) -> None:
    """The verdict of a run folder that was just written, and the papers' numbers beside ours; for
    a program, its verdict.json."""
    if MANNERS.json:
        print_verdict(out)
        return
    print_outcome(outcome)
    if MANNERS.quiet:
        return
    written = steady(out, lambda folder: read_run(folder, objects=False))
    for culler, verdict in written.verdict.cullers.items():
        for line in why_lines(verdict.causes):
            OUT.line(f"{culler}: {line}")
    for paper, tables in tables_beside(written):
        for table in tables:
            _print_beside_published(paper.name, table)
    OUT.line()
    OUT.line(f"The run: {out}. Next: `visref report {shlex.quote(str(out))} --out page`")


def print_verdict(out: Path) -> None:
    """A run folder's verdict, for programs."""
    OUT.json(steady(out, lambda folder: json_inside(folder, VERDICT, "judge it again")))


def print_outcome(outcome: RunOutcome) -> None:
    """What is to be mended in the input first, a row for each culler, then the first findings."""
    for finding in outcome.findings:
        if finding.code is not Code.MISALIGNED:
            continue
        _print_finding(finding, outcome.policy.severity_of(finding.code))
    headings = (
        "culler", "frames", "visible", "drawn", "superfluous", "missed", "partly missed",
        "samples lost", "undecided", "violations", "verdict",
    )  # fmt: skip
    rows = []
    for record in outcome.cullers:
        totals = record.totals
        rows.append(
            (
                record.spec,
                str(_frames(record)),
                str(totals.visible),
                str(totals.drawn),
                str(totals.superfluous),
                str(totals.missed),
                str(totals.partly_missed),
                str(totals.missed_pixels),
                _undecided(totals),
                str(totals.violations),
                f"{words.GLYPHS[record.status]} {record.status.replace('_', ' ')}",
            )
        )
    colours = [OF_STATUS[record.status] for record in outcome.cullers]
    OUT.table(headings, rows, left=("culler",), colours=colours)
    if MANNERS.quiet:
        return
    if any(len(record.frames) > 1 for record in outcome.cullers):
        OUT.line("Counts are summed over frames; those of objects are object-frames.")
    rounded = any(finding.code is Code.VERTICES_ROUNDED for finding in outcome.findings)
    said = {record.spec: _beside_the_verdict(record, rounded) for record in outcome.cullers}
    if len(said) > 1 and set(said.values()) == {words.ALL_DECIDED}:
        OUT.line(words.ALL_DECIDED)
    else:
        for spec, text in said.items():
            OUT.line(f"{spec}: {text}")
    if said_policy := words.policy_line(outcome.policy):
        OUT.line(said_policy)
    severity_of = outcome.policy.severity_of
    shown = [
        f
        for f in outcome.findings
        if (MANNERS.verbose or severity_of(f.code) in OF_SEVERITY) and f.code is not Code.MISALIGNED
    ]
    # What fails the run by itself first: it would be lost among many misses.
    shown.sort(key=lambda finding: not fails_run(finding.code, severity_of(finding.code)))
    first = len(shown) if MANNERS.verbose else FINDINGS_SHOWN
    for finding in shown[:first]:
        _print_finding(finding, severity_of(finding.code))
    if rest := len(shown[first:]):
        OUT.line(f"… and {rest} more findings in verdict.json, or with -v")


def _print_finding(finding: Finding, severity: str) -> None:
    # A plug-in's error may bring lines of its own.
    message = " ".join(finding.message.split())
    line = ": ".join(filter(None, (finding.code, words.found_at(finding), message)))
    OUT.line(line, colour=OF_SEVERITY.get(severity), of=finding.code)


def _frames(record: CullerRecord) -> int:
    return len({row.frame for row in record.frames})


def _undecided(totals: Counts) -> str:
    owned = totals.owned_samples
    return words.percent(totals.undecided_samples / owned if owned else None)


def _beside_the_verdict(record: CullerRecord, rounded: bool) -> str:
    """How much was decided, why a verdict says nothing, and what a tolerance excused. `rounded`:
    rounding to float32 left samples open."""
    totals = record.totals
    owned, undecided = totals.owned_samples, totals.undecided_samples
    parts = [words.decided(owned, undecided, rounded=rounded)]
    if record.status is Status.INCONCLUSIVE:
        parts.append(
            words.why_inconclusive(
                frames=_frames(record),
                visible=totals.visible,
                owned=owned,
                undecided=undecided,
                failed=record.failed,
                unsteady=record.unsteady,
                max_undecided=record.max_undecided,
                misaligned=record.misaligned,
            )
        )
    if totals.within_raster_tolerance:
        excused = words.count(totals.within_raster_tolerance)
        lost = words.lost_by_it(record.excused_samples)
        parts.append(f"{excused} excused by {words.tolerance(record.raster)}{lost}.")
    if accepted := words.accepted(totals.small, totals.late, totals.waived):
        parts.append(f"Accepted by the policy: {accepted}.")
    losing = totals.missed + totals.partly_missed - totals.ties
    if ages := words.ages_text(record.ages(), losing):
        parts.append(f"Ages of its misses, in frames: {ages}.")
    return " ".join(filter(None, parts))


def _print_beside_published(name: str, of_paper: papers.Table) -> None:
    OUT.line()
    OUT.line(f"{of_paper.title} ({name}, {of_paper.source})")
    rows = [line.cells[:4] for line in table_lines(of_paper)]
    OUT.table(HEADINGS[:4], rows, left=HEADINGS[:1])
    for claim in (*of_paper.claims, *of_paper.own):
        OUT.line(f"{GLYPHS[claim.grade]} {claim_text(claim)}")
