"""visref run: judge cullers on a scene and a camera path."""

from __future__ import annotations

import argparse

from visref.cli.arguments import add_judging_arguments, add_scene_arguments, inputs_of, memory_of
from visref.cli.commands import (
    add_command_arguments,
    add_time_limit,
    command_cullers,
    command_names,
    commands_of,
    saying,
    with_commands,
)
from visref.cli.judged import judge
from visref.errors import InputError
from visref.judging.status import Exit
from visref.memory import default_budget
from visref.plug_ins import Making, making_cullers


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scene_arguments(parser)
    add_judging_arguments(parser)
    parser.add_argument(
        "--culler",
        action="append",
        metavar="NAME[:option=value,…]",
        help="repeat for several; `visref cullers` lists them; module:Class is your own",
    )
    add_command_arguments(parser)
    parser.add_argument(
        "--in-process",
        action="store_true",
        help="run your own cullers in visref's process, to debug them: no limits hold there",
    )
    add_time_limit(parser)
    parser.add_argument(
        "--image-check",
        action="store_true",
        help="redraw each drawn set by GL and compare it with the unculled picture",
    )


def run(given: argparse.Namespace) -> Exit:
    specs, commands = given.culler or [], commands_of(given)
    if not specs and not commands:
        raise InputError("there is nothing to judge", fix="give --culler or --command")
    given_limit = memory_of(given)
    limit = default_budget() if given_limit is None else given_limit
    making = Making(
        given.in_process, given.time_limit, limit, say=lambda spec, line: saying(spec)(line)
    )
    # An unknown culler is said before a large scene is read.
    with making_cullers(specs, making) as cullers:
        names = command_names(specs, commands)
        inputs = with_commands(inputs_of(given), commands, names)
        with command_cullers(
            commands,
            names,
            given.scene,
            inputs,
            time_limit_s=given.time_limit,
            memory_limit=limit,
        ) as programs:
            return judge(given, inputs, [*cullers, *programs], image_check=given.image_check)
