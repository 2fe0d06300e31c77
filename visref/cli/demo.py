"""visref demo: four cullers, one of them broken on purpose, on a generated city."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from visref.cli.judged import print_outcome
from visref.cli.manners import add_json
from visref.cli.terminal import OUT, frame_bar
from visref.doing import doing
from visref.inputs import open_inputs
from visref.judging.status import Exit
from visref.registry import make_culler
from visref.report.writing import write_report
from visref.runs import judge_to_folder

SCENE = "city:scale=0.2,frames=24"
SIZE = (960, 720)
CULLERS = ("none", "frustum", "occlusion-query", "visref_culling.broken:HastyQueryCulling")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, default=Path("demo"), metavar="DIR")
    add_json(parser, "print what was written and each culler's status, for programs")


def run(given: argparse.Namespace) -> Exit:
    inputs = open_inputs(SCENE)
    inputs = replace(inputs, path=inputs.path.resized(*SIZE))
    cullers = [(spec, make_culler(spec)) for spec in CULLERS]
    folder = given.out / "run"
    with frame_bar(len(inputs.frames)) as bar:
        outcome = judge_to_folder(inputs, cullers, folder, image_check=True, listeners=[bar])
    with doing("writing the page"):
        page = write_report([folder], given.out)
    if given.json:
        statuses = {record.spec: record.status for record in outcome.cullers}
        OUT.json({"page": str(page), "run": str(folder), "cullers": statuses})
        return Exit.NO_VIOLATION
    print_outcome(outcome)
    OUT.remark()
    OUT.remark("The last culler is broken on purpose, so that you see what a violation looks like.")
    OUT.remark(f"The report: {page}. Next: open it in a browser")
    return Exit.NO_VIOLATION
