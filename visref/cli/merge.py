"""visref merge: the parts of a run, of a truth, or of labels, put together."""

from __future__ import annotations

import argparse
from pathlib import Path

from visref.cli.judged import print_run
from visref.cli.manners import add_json
from visref.cli.reports import add_report_arguments
from visref.cli.terminal import OUT
from visref.errors import InputError
from visref.judging.status import Exit
from visref.labels.table import is_labels, merge_labels
from visref.merging import merge_runs, merge_truths
from visref.runs import merge_with_scene
from visref.wording import counted


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "parts",
        nargs="+",
        type=Path,
        metavar="PART",
        help="the folders that --shard left, all of them; or truths or labels of parts of a path",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="the run folder, or the truth file"
    )
    parser.add_argument(
        "--scene",
        metavar="SCENE",
        help="the scene that was judged: says why things were missed, as one run does",
    )
    parser.add_argument("--path", metavar="PATH", help="its camera path, where it is a file")
    add_json(parser, "print verdict.json, and nothing else")
    add_report_arguments(parser)


def run(given: argparse.Namespace) -> Exit:
    files = [part for part in given.parts if part.is_file()]
    if not files:
        if given.scene is None:
            if given.path is not None:
                raise InputError("--path without --scene", fix="give both")
            outcome = merge_runs(given.parts, given.out)
        else:
            outcome = merge_with_scene(given.parts, given.out, given.scene, given.path)
        print_run(given.out, outcome)
        return outcome.exit
    if len(files) < len(given.parts):
        raise InputError(
            "some are files and some are folders", fix="give run folders, or truth files"
        )
    labels = [is_labels(file) for file in files]
    if any(labels) and not all(labels):
        raise InputError(
            "some are labels and some are not", fix="merge labels, and truths, by themselves"
        )
    frames = (merge_labels if labels[0] else merge_truths)(files, given.out)
    if given.json:
        OUT.json({"out": str(given.out), "frames": frames})
    OUT.remark(f"{given.out}: {counted(frames, 'frame')}")
    return Exit.NO_VIOLATION
