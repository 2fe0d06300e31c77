"""visref truth: cast who owns which samples, to a Parquet file."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

import numpy as np

from visref.between.search import geometric_line
from visref.cli.arguments import add_scene_arguments, inputs_of
from visref.cli.manners import add_json
from visref.cli.terminal import OUT, frame_bar
from visref.findings import Severity
from visref.judging.status import Exit
from visref.labels.writing import LabelFiles
from visref.runs import truth_to_file
from visref.wording import counted

_WRITTEN = {
    "--labels": "a row per frame, view and object",
    "--images": "instance ids, depth, masks of whole objects",
    "--coco": "COCO annotations",
    "--bop": "a BOP dataset",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scene_arguments(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.parquet")
    add_json(parser)
    parser.add_argument(
        "--geometric",
        type=Path,
        metavar="FILE.parquet",
        help="look between the samples too: who is visible anywhere in the image, with a witness",
    )
    labels = parser.add_argument_group("labels for people who make data")
    labels.add_argument(
        "--labels",
        type=Path,
        metavar="FILE.parquet",
        help="every object of every frame, hidden ones too: what shows of it, what hides the rest",
    )
    labels.add_argument(
        "--images", type=Path, metavar="DIR", help="instance ids, depth, masks of whole objects"
    )
    labels.add_argument("--coco", type=Path, metavar="FILE.json", help="COCO's annotations")
    labels.add_argument(
        "--bop", type=Path, metavar="DIR", help="a BOP dataset: poses, masks, models"
    )


def run(given: argparse.Namespace) -> Exit:
    inputs = inputs_of(given)
    frames = len(inputs.frames)
    files = LabelFiles(given.labels, given.images, given.coco, given.bop)
    with frame_bar(frames) as bar:
        cast = truth_to_file(
            inputs, given.out, geometric=given.geometric, labels=files, listeners=[bar]
        )
    if given.json:
        OUT.json(
            {
                "out": str(given.out),
                "frames": frames,
                "objects": inputs.scene.object_count,
                "visible": int(np.count_nonzero(cast.visible)),
                "engine": inputs.engine,
                "findings": [
                    {"code": one.code, "severity": one.rule.severity, "message": one.message}
                    for one in cast.findings
                ],
            }
        )
        return Exit.NO_VIOLATION
    OUT.remark(
        f"{given.out}: {frames} frames, {np.count_nonzero(cast.visible)} of "
        f"{inputs.scene.object_count} objects visible in some frame (engine {inputs.engine})"
    )
    if given.geometric is not None:
        OUT.remark(f"{given.geometric}: {geometric_line(cast.between)}")
    for option, path in files.asked.items():
        OUT.remark(f"{path}: {_WRITTEN[option]}")
    if cast.left_out:
        OUT.remark(
            f"not in {given.bop} wherever they bend or are scaled: "
            f"{counted(len(cast.left_out), 'object')}, such as '{cast.left_out[0]}'"
        )
    for finding in cast.findings:
        if finding.rule.severity is not Severity.INFO:
            OUT.line(f"{finding.code}: {finding.message}")
    OUT.remark(f"Next: `visref run` and `check` take it: --truth {shlex.quote(str(given.out))}")
    return Exit.NO_VIOLATION
