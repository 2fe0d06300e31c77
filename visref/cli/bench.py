"""visref bench: speed against error, where to stop paying."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path

from visref.bench import BenchRun, write_bench
from visref.bench.verdict import headline, sentences
from visref.cli.arguments import add_scene_arguments, inputs_of
from visref.cli.manners import add_json
from visref.cli.terminal import OUT, frame_bar
from visref.errors import InputError
from visref.files import refuse_inputs, replacing_folder
from visref.inputs import Inputs
from visref.judging.status import Exit
from visref.picking import evenly_picked
from visref.report.bench_folder import BENCH_FOLDER, MARKER
from visref.run_folder.inside import json_inside

FRAMES = 6


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scene_arguments(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    add_json(parser, "print bench.json, and nothing else")
    # Every engine is measured, against this one.
    parser.set_defaults(engine="exact")


def run(given: argparse.Namespace) -> Exit:
    if find_spec("matplotlib") is None:
        raise InputError("the plot needs matplotlib", fix="run: pip install 'visref[plots]'")
    inputs = inputs_of(given)
    refuse_inputs(given.out, inputs.files)
    frames = _some_frames(inputs) if given.frames is None else list(inputs.frames)
    scene, path, threads = inputs.scene, inputs.path, inputs.threads
    with frame_bar(len(frames)) as bar, replacing_folder(given.out, kind=BENCH_FOLDER) as folder:
        measured = BenchRun(scene, path, frames, threads).run(bar.on_frame_done)
        write_bench(folder, measured, scene, path, threads)
    if given.json:
        OUT.json(json_inside(given.out, MARKER, "measure it again"))
        return Exit.NO_VIOLATION
    for line in (headline(measured), *sentences(measured)):
        OUT.line(line)
    OUT.remark()
    OUT.remark(f"The page: {given.out / 'bench.html'}. Next: open it in a browser")
    return Exit.NO_VIOLATION


def _some_frames(inputs: Inputs) -> list[int]:
    """`FRAMES` of the frames at most, evenly picked."""
    return [inputs.frames[i] for i in evenly_picked(len(inputs.frames), FRAMES)]
