"""visref run: judge cullers on a scene and a camera path."""

from __future__ import annotations

import argparse

from visref.cli.arguments import add_judging_arguments, add_scene_arguments, inputs_of, memory_of
from visref.cli.judged import judge
from visref.cli.terminal import ERRORS
from visref.judging.status import Exit
from visref.memory import default_budget
from visref.plug_ins import DEFAULT_TIME_LIMIT_S, Making, making_cullers


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
        "--in-process",
        action="store_true",
        help="run your own cullers in visref's process, to debug them: no limits hold there",
    )
    parser.add_argument(
        "--time-limit",
        type=float,
        default=DEFAULT_TIME_LIMIT_S,
        metavar="SECONDS",
        help="for each call of a culler of your own (default %(default)g)",
    )
    parser.add_argument(
        "--image-check",
        action="store_true",
        help="redraw each drawn set by GL and compare it with the unculled picture",
    )


def run(given: argparse.Namespace) -> Exit:
    given_limit = memory_of(given)
    limit = default_budget() if given_limit is None else given_limit
    making = Making(given.in_process, given.time_limit, limit, say=_say)
    # An unknown culler is said before a large scene is read.
    with making_cullers(given.culler, making) as cullers:
        return judge(given, inputs_of(given), cullers, image_check=given.image_check)


def _say(spec: str, line: str) -> None:
    ERRORS.line(f"{spec}: {line}")
