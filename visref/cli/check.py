"""visref check: judge an engine's recorded visible sets."""

from __future__ import annotations

import argparse
from pathlib import Path

from visref.cli.arguments import add_judging_arguments, add_scene_arguments, inputs_of
from visref.cli.judged import judge
from visref.culler import Promise, RasterTolerance
from visref.errors import InputError
from visref.files import refuse_inputs
from visref.judging.status import Exit
from visref.recordings.visible_sets import Replay, read_visible_sets


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scene_arguments(parser)
    add_judging_arguments(parser)
    parser.add_argument(
        "--visible", type=Path, required=True, metavar="FILE", help=".jsonl, .csv or .parquet"
    )
    parser.add_argument(
        "--promise", choices=[p.value for p in Promise], default=Promise.CONSERVATIVE.value
    )
    parser.add_argument(
        "--raster",
        metavar="snap=PX,depth=BITS",
        help="the engine's rasteriser: greatest vertex snap in pixels, depth buffer bits or float",
    )


def run(given: argparse.Namespace) -> Exit:
    refuse_inputs(given.out, [given.visible])
    inputs = inputs_of(given)
    recorded = read_visible_sets(given.visible, inputs.scene, inputs.frames, len(inputs.path))
    tolerance = _raster(given.raster) if given.raster is not None else None
    replay = Replay(recorded, inputs.path, Promise(given.promise), tolerance)
    return judge(given, inputs, [(given.visible.name, replay)])


def _raster(text: str) -> RasterTolerance:
    values = dict(part.partition("=")[::2] for part in text.split(","))
    try:
        if set(values) != {"snap", "depth"}:
            raise ValueError
        snap_px = float(values["snap"])
        depth_bits = None if values["depth"] == "float" else int(values["depth"])
        if not 0.0 <= snap_px < 1.0 or (depth_bits is not None and not 8 <= depth_bits <= 32):
            raise ValueError
    except ValueError as error:
        raise InputError(
            f"--raster {text} is not understood",
            fix="write snap=0.004,depth=24 (pixels below 1; 8 to 32 bits, or float)",
        ) from error
    return RasterTolerance(snap_px, depth_bits)
