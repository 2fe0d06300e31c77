"""visref check: judge an engine's recorded visible sets."""

from __future__ import annotations

import argparse
from pathlib import Path

from visref.cli.arguments import (
    add_judging_arguments,
    add_scene_arguments,
    inputs_of,
    parse_raster,
    recorded_inputs_of,
)
from visref.cli.judged import judge
from visref.culler import Promise
from visref.files import refuse_inputs
from visref.judging.status import Exit
from visref.recordings.visible_sets import Replay, read_visible_sets
from visref.runs import Misaligned


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scene_arguments(parser)
    add_judging_arguments(parser)
    recorded = parser.add_mutually_exclusive_group(required=True)
    recorded.add_argument(
        "--recording",
        type=Path,
        metavar="FILE",
        help="one file with the cameras and what was drawn (.jsonl), instead of --path and "
        "--visible",
    )
    recorded.add_argument(
        "--visible", type=Path, metavar="FILE", help="what was drawn: .jsonl, .csv or .parquet"
    )
    parser.add_argument(
        "--promise",
        choices=[p.value for p in Promise],
        default=Promise.CONSERVATIVE.value,
        help="what the engine promises (default %(default)s)",
    )
    parser.add_argument(
        "--raster",
        metavar="snap=PX,depth=BITS",
        help="the engine's rasteriser: greatest vertex snap in pixels, depth buffer bits or float",
    )
    parser.add_argument(
        "--if-misaligned",
        choices=[one.value for one in Misaligned],
        default=Misaligned.KEEP.value,
        help="what becomes of the status where the recording fits another input and no engine errs "
        "that way by itself (MISALIGNED; default keep)",
    )


def run(given: argparse.Namespace) -> Exit:
    tolerance = parse_raster("--raster", given.raster) if given.raster is not None else None
    file: Path = given.visible or given.recording
    refuse_inputs(given.out, [file])
    if given.recording is not None:
        inputs, recorded = recorded_inputs_of(given)
    else:
        inputs = inputs_of(given)
        recorded = read_visible_sets(
            file, inputs.scene, inputs.frames, inputs.path, max_memory=inputs.max_memory
        )
    replay = Replay(recorded, inputs.path, Promise(given.promise), tolerance)
    choice = Misaligned(given.if_misaligned)
    return judge(given, inputs, [(file.name, replay)], if_misaligned=choice)
