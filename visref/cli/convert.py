"""visref convert: between a one-file recording and the pair of a path and visible sets."""

from __future__ import annotations

import argparse
from pathlib import Path

from visref.cli.arguments import add_memory_argument, memory_of
from visref.cli.manners import add_json
from visref.cli.terminal import OUT
from visref.errors import InputError
from visref.judging.status import Exit
from visref.recordings import pair_of_recording, recording_of_pair
from visref.wording import counted


def add_arguments(parser: argparse.ArgumentParser) -> None:
    for name, what in (
        ("--recording", "the recording to take apart, and with"),
        ("--path-out", "where its camera path goes (.json), and"),
        ("--visible-out", "where its visible sets go (.jsonl); or"),
        ("--path", "a camera path (.json), and with"),
        ("--visible", "visible sets (.jsonl, .csv or .parquet), and"),
        ("--recording-out", "where the recording of both goes (.jsonl)"),
    ):
        parser.add_argument(name, type=Path, metavar="FILE", help=what)
    add_json(parser, "print what was written, for programs")
    add_memory_argument(parser)


def run(given: argparse.Namespace) -> Exit:
    apart = (given.recording, given.path_out, given.visible_out)
    joined = (given.path, given.visible, given.recording_out)
    limit = memory_of(given)
    if all(apart) and not any(joined):
        count, cut_off = pair_of_recording(*apart, max_memory=limit)
        if given.json:
            files = {"path": str(given.path_out), "visible": str(given.visible_out)}
            OUT.json({**files, "frames": count, "cut_off": cut_off or None})
        OUT.remark(f"{given.path_out}, {given.visible_out}: {counted(count, 'frame')}")
        if cut_off:
            OUT.remark(f"{given.recording}: {cut_off}; what is whole was taken")
    elif all(joined) and not any(apart):
        count = recording_of_pair(*joined, max_memory=limit)
        if given.json:
            OUT.json({"recording": str(given.recording_out), "frames": count})
        OUT.remark(f"{given.recording_out}: {counted(count, 'frame')}")
    else:
        raise InputError(
            "what is to be converted?",
            fix="give --recording, --path-out and --visible-out; or --path, --visible and "
            "--recording-out",
        )
    return Exit.NO_VIOLATION
