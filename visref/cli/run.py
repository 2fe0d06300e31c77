"""visref run: judge cullers on a scene and a camera path."""

from __future__ import annotations

import argparse

from visref.cli.arguments import add_judging_arguments, add_scene_arguments, inputs_of
from visref.cli.judged import judge
from visref.judging.status import Exit
from visref.registry import make_culler


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scene_arguments(parser)
    add_judging_arguments(parser)
    parser.add_argument(
        "--culler",
        action="append",
        required=True,
        metavar="NAME[:option=value,…]",
        help="repeat for several; `visref cullers` lists them; module:Class is your own",
    )
    parser.add_argument(
        "--image-check",
        action="store_true",
        help="redraw each drawn set by GL and compare it with the unculled picture",
    )


def run(given: argparse.Namespace) -> Exit:
    # An unknown culler is said before a large scene is read.
    cullers = [(spec, make_culler(spec)) for spec in given.culler]
    return judge(given, inputs_of(given), cullers, image_check=given.image_check)
