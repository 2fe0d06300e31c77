"""`--command`: programs as cullers, beside those of `--culler`."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from visref.cli.arguments import parse_raster
from visref.cli.terminal import ERRORS
from visref.culler import Culler, Promise
from visref.errors import InputError
from visref.inputs import Inputs, scene_file
from visref.plug_ins import DEFAULT_TIME_LIMIT_S
from visref.plug_ins.command import Command, CommandCuller
from visref.plug_ins.making import check_time_limit
from visref.scene import unique_names


def add_command_arguments(parser: argparse.ArgumentParser) -> None:
    """Programs as cullers; `commands_of` reads them."""
    parser.add_argument(
        "--command",
        action="append",
        # Each command's function is kept as `command`.
        dest="programs",
        metavar='"PROGRAM … {scene} {path} {visible}"',
        help="a program that reads a scene and a path and writes what it draws (or {recording}, a "
        "one-file recording); repeat for several",
    )
    parser.add_argument(
        "--command-promise",
        choices=[promise.value for promise in Promise],
        metavar="PROMISE",
        help=f"of all programs: {', '.join(Promise)} (default {Promise.CONSERVATIVE})",
    )
    parser.add_argument(
        "--command-raster",
        metavar="snap=PX,depth=BITS",
        help="of all programs: their rasteriser's greatest vertex snap, bits of depth or float",
    )


def add_time_limit(parser: argparse.ArgumentParser) -> None:
    """For every command that runs what others wrote."""
    parser.add_argument(
        "--time-limit",
        type=float,
        default=DEFAULT_TIME_LIMIT_S,
        metavar="SECONDS",
        help="for each call of a culler of your own, and each program (default %(default)g)",
    )


def commands_of(given: argparse.Namespace) -> list[Command]:
    """The programs of --command. Raises InputError for one that cannot be, and where something is
    said of programs and none is named."""
    check_time_limit(given.time_limit)
    texts: Sequence[str] = given.programs or ()
    for option in ("command_promise", "command_raster"):
        if getattr(given, option) is not None and not texts:
            name = f"--{option.replace('_', '-')}"
            raise InputError(f"{name} is given, and no --command", fix="name a program")
    promise = Promise(given.command_promise or Promise.CONSERVATIVE)
    raster = None
    if given.command_raster is not None:
        raster = parse_raster("--command-raster", given.command_raster)
    return [Command.parse(text, promise=promise, raster=raster) for text in texts]


@contextmanager
def command_cullers(
    commands: Sequence[Command],
    names: Sequence[str],
    scene: str,
    inputs: Inputs,
    *,
    time_limit_s: float | None,
    memory_limit: int | None,
) -> Iterator[list[tuple[str, Culler]]]:
    """A culler for each program, with its name, on the scene that the spec `scene` names and the
    path of `inputs`. A generated scene's file is there until the block ends."""
    if not commands:
        yield []
        return
    with tempfile.TemporaryDirectory(prefix="visref-scene-") as folder:
        file = scene_file(scene, Path(folder))
        yield [
            (
                name,
                CommandCuller(
                    command,
                    file,
                    inputs.path,
                    frames=inputs.frames,
                    rest_pose=inputs.rest_pose,
                    cull_backfaces=bool(inputs.settings.get("cull_backfaces")),
                    time_limit_s=time_limit_s,
                    memory_limit=memory_limit,
                    say=saying(name),
                ),
            )
            for name, command in zip(names, commands, strict=True)
        ]


def with_commands(inputs: Inputs, commands: Sequence[Command], names: Sequence[str]) -> Inputs:
    """The inputs, whose settings record the programs under the names that reports give them."""
    if not commands:
        return inputs
    said = {name: _record(command) for name, command in zip(names, commands, strict=True)}
    return replace(inputs, settings={**inputs.settings, "commands": said})


def command_names(specs: Sequence[str], commands: Sequence[Command]) -> tuple[str, ...]:
    """What reports call programs that are judged after the cullers `specs`."""
    every = unique_names([*specs, *(command.name for command in commands)])
    return every[len(specs) :]


def saying(name: str) -> Callable[[str], None]:
    """Shows lines on standard error, behind a culler's name."""
    return lambda line: ERRORS.line(f"{name}: {line}")


def _record(command: Command) -> dict[str, Any]:
    record: dict[str, Any] = {"command": command.text, "promise": command.promise.value}
    if command.raster is not None:
        record["raster"] = vars(command.raster)
    return record
