"""visref run: judge cullers on a scene and a camera path."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from visref.cli.arguments import (
    add_judging_arguments,
    add_scene_arguments,
    inputs_of,
    memory_of,
    policy_of,
)
from visref.cli.command_facts import facts_of, packages_of
from visref.cli.commands import (
    add_command_arguments,
    add_time_limit,
    command_cullers,
    command_names,
    commands_of,
    saying,
    with_commands,
)
from visref.cli.judged import judge, print_verdict
from visref.cli.reports import add_report_arguments
from visref.cli.stamp import stands, write_stamp
from visref.cli.terminal import OUT
from visref.culler import Culler
from visref.errors import InputError
from visref.inputs import Inputs
from visref.judging.policy import Policy
from visref.judging.status import Exit
from visref.memory import default_budget
from visref.numerals import whole_number
from visref.plug_ins import Making, check_cullers, check_time_limit, is_ours, making_cullers
from visref.registry import find_culler
from visref.run_folder.read import read_run
from visref.runs import MakingAnew


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scene_arguments(parser)
    add_judging_arguments(parser)
    add_report_arguments(parser)
    parser.add_argument(
        "--culler",
        action="append",
        metavar="NAME[:option=value,…]",
        help="repeat for several; `visref cullers` lists them; module:Class is your own",
    )
    add_command_arguments(parser)
    parser.add_argument(
        "--fragments",
        action="store_true",
        help="count fragments and depth tests in every culler on board that can, outside its time",
    )
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
    parser.add_argument(
        "--repeat",
        type=whole_number,
        default=1,
        metavar="N",
        help="ask each culler N times about all frames, each time made anew: one that answers "
        "otherwise is inconclusive (default 1)",
    )
    parser.add_argument(
        "--stamp",
        type=Path,
        metavar="FILE",
        help="says by which command the run folder was left: where that is this one, nothing is "
        "judged again",
    )


def run(given: argparse.Namespace) -> Exit:
    specs, commands = given.culler or [], commands_of(given)
    if given.fragments:
        specs = [counting_fragments(spec) for spec in specs]
    if not specs and not commands:
        raise InputError("there is nothing to judge", fix="give --culler or --command")
    given_limit = memory_of(given)
    limit = default_budget() if given_limit is None else given_limit
    making = Making(given.in_process, given.time_limit, limit, say=_say)
    policy = policy_of(given)
    names = command_names(specs, commands)

    def programs_on(inputs: Inputs) -> AbstractContextManager[list[tuple[str, Culler]]]:
        return command_cullers(
            commands,
            names,
            given.scene,
            inputs,
            time_limit_s=given.time_limit,
            memory_limit=limit,
        )

    alone = "--in-process" if given.in_process else "--command" if commands else ""
    # An unknown culler is said before a large scene is read.
    check_cullers(specs)
    check_time_limit(given.time_limit)
    inputs = with_commands(inputs_of(given), commands, names)

    anew: MakingAnew = MakingSpecs(tuple(specs), making)
    if commands:

        @contextmanager
        def with_programs() -> Iterator[list[tuple[str, Culler]]]:
            with making_cullers(specs, making) as cullers, programs_on(inputs) as programs:
                yield [*cullers, *programs]

        anew = with_programs

    command = facts_of(
        given,
        inputs,
        policy,
        cullers=specs,
        programs=given.programs or (),
        files={"truth": given.truth},
        options={
            "pictures": given.pictures,
            "superfluous rows": given.superfluous_rows,
            "image check": given.image_check,
            "repeat": given.repeat,
            "in process": given.in_process,
        },
    )
    stamp: Path | None = given.stamp
    if stamp is not None:
        if given.shard is not None:
            raise InputError("--stamp and --shard", fix="stamp the whole run")
        if stands(stamp, given.out, {**command, "day": _day(policy)}):
            OUT.remark(f"{given.out} stands as this command left it; nothing was judged again")
            if given.json:
                print_verdict(given.out)
            return read_run(given.out, objects=False).exit
    outcome = judge(
        given,
        inputs,
        anew,
        policy=policy,
        image_check=given.image_check,
        repeat=given.repeat,
        alone=alone,
        command=command,
        opening=partial(inputs_of, given),
        packages=packages_of(specs),
    )
    if stamp is not None:
        write_stamp(stamp, given.out, {**command, "day": _day(policy)})
    return outcome.exit


def counting_fragments(spec: str) -> str:
    """A culler's spec with its fragments counted, where it comes with visref and can; one that says
    what it wants is left as it is."""
    if not is_ours(spec):
        return spec
    found, options = find_culler(spec)
    if "fragments" not in found.options or "fragments" in options:
        return spec
    return f"{spec}{',' if options else ':'}fragments=true"


def _day(policy: Policy | None) -> str:
    """On which a policy's waivers are asked whether they expired: with another one a run that goes
    on may end otherwise."""
    return "" if policy is None or policy.today is None else policy.today.isoformat()


@dataclass(frozen=True)
class MakingSpecs:
    """Makes cullers by their specs, here or in another process."""

    specs: tuple[str, ...]
    making: Making

    def __call__(self) -> AbstractContextManager[list[tuple[str, Culler]]]:
        return making_cullers(self.specs, self.making)


def _say(spec: str, line: str) -> None:
    saying(spec)(line)
