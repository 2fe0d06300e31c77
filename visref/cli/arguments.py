"""Arguments that several commands take."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from visref.cli.manners import add_json
from visref.culler import (
    LEAST_DEPTH_BITS,
    MOST_DEPTH_BITS,
    MOST_SNAP_PX,
    RasterTolerance,
    check_tolerance,
)
from visref.errors import InputError
from visref.inputs import Inputs, open_inputs, open_recorded
from visref.judging.policy import Policy
from visref.judging.policy_file import day_of, read_policy
from visref.memory import parse_size
from visref.numerals import decimal_number, whole_number
from visref.picking import Shard
from visref.recordings.visible_sets import VisibleSets
from visref.registry import DEFAULT_ENGINE, ENGINES, available

# How the workers of a cluster come by the scene.
SCENE_TO_WORKERS = ("path", "send")


def add_scene_arguments(parser: argparse.ArgumentParser) -> None:
    """The scene, the path and who casts the truth; `inputs_of` reads them."""
    parser.add_argument(
        "scene",
        metavar="SCENE",
        help="a file (GLB, glTF, OBJ, PLY, …) or a generated scene (city:scale=0.05)",
    )
    parser.add_argument(
        "--path", metavar="PATH", help="a camera path (JSON), or a glTF file with cameras"
    )
    parser.add_argument("--frames", metavar="A:B:STEP", help="a part of the path, as a slice")
    parser.add_argument(
        "--engine",
        default=DEFAULT_ENGINE,
        metavar="NAME[:option=value]",
        help=f"{', '.join(available(ENGINES))} (default {DEFAULT_ENGINE})",
    )
    parser.add_argument("--threads", type=whole_number, metavar="N", help="default: all cores")
    parser.add_argument(
        "--cull-backfaces",
        action="store_true",
        help="triangles whose material is not double-sided show their front only",
    )
    parser.add_argument(
        "--lenient", action="store_true", help="drop triangles with a NaN or infinite vertex"
    )
    parser.add_argument(
        "--rest-pose",
        action="store_true",
        help="what the scene's file animates stands as it does at rest, whatever the path's time",
    )
    add_memory_argument(parser)


def add_memory_argument(parser: argparse.ArgumentParser) -> None:
    """For every command that reads a scene; `memory_of` reads it."""
    parser.add_argument(
        "--max-memory",
        metavar="SIZE",
        help="refuse inputs that need more, such as 2G (default: 3/4 of what is free)",
    )


def memory_of(given: argparse.Namespace) -> int | None:
    """Bytes of --max-memory, None where it is not given. Raises InputError for no size."""
    return None if given.max_memory is None else parse_size(given.max_memory)


def add_judging_arguments(parser: argparse.ArgumentParser) -> None:
    """Where the run folder goes and what goes into it; `visref.cli.judged` reads them."""
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the run folder")
    add_json(parser, "print verdict.json, and nothing else")
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="FILE",
        help="a truth file, instead of casting again; its engine looks at what was missed",
    )
    parser.add_argument(
        "--pictures",
        type=whole_number,
        default=4,
        metavar="N",
        help="frames to draw (default 4), and of each culler's misses the first, the last and the "
        "worst of 2 N objects, and one of each cause",
    )
    parser.add_argument(
        "--superfluous-rows",
        action="store_true",
        help="list what was drawn for nothing in every frame: without it, in those that have "
        "pictures, and elsewhere what a promise forbids; all of it is counted",
    )
    parser.add_argument(
        "--policy", type=Path, metavar="FILE", help="what you accept (visref.toml), and why"
    )
    parser.add_argument(
        "--today",
        metavar="YYYY-MM-DD",
        help="the day on which the policy's waivers are asked whether they expired (default: "
        "the clock's, UTC)",
    )
    add_shard_argument(parser)
    parser.add_argument(
        "--workers",
        type=whole_number,
        metavar="N",
        help="processes that judge a part of the frames each (default: a core each, where frames "
        "and memory are enough; 1 to measure times)",
    )
    add_dask_arguments(parser)


def add_dask_arguments(parser: argparse.ArgumentParser) -> None:
    """A cluster in place of workers; `visref.cli.judged` reads them."""
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="judge on the workers of a Dask scheduler (tcp://HOST:PORT), or `local`: on --workers "
        "processes that Dask starts here",
    )
    parser.add_argument(
        "--dask-scene",
        choices=SCENE_TO_WORKERS,
        help="workers read the scene by its path (default), or it is sent to them",
    )
    parser.add_argument(
        "--dask-frames",
        type=whole_number,
        metavar="N",
        help="frames of a task (default: by the number of workers, at most 100)",
    )


def add_shard_argument(parser: argparse.ArgumentParser) -> None:
    """For commands whose work can be shared out; `shard_of` reads it."""
    parser.add_argument(
        "--shard",
        metavar="I/N",
        help="judge only the I-th of N parts of the frames; `visref merge` makes the whole of all",
    )


def shard_of(given: argparse.Namespace) -> Shard | None:
    """The part that --shard names, None without it. Raises InputError for no part."""
    if given.shard is None:
        return None
    number, _, count = given.shard.partition("/")
    try:
        shard = Shard(whole_number(number), whole_number(count))
        if not 1 <= shard.number <= shard.count:
            raise ValueError
    except ValueError as error:
        raise InputError(
            f"--shard {given.shard} is no part", fix="write I/N, such as 2/4, with I from 1 to N"
        ) from error
    return shard


def policy_of(given: argparse.Namespace) -> Policy | None:
    """The policy of --policy, None without one. Raises InputError for anything wrong with it."""
    if given.policy is None:
        if given.today is not None:
            raise InputError("--today is given, and no --policy", fix="give both, or neither")
        return None
    try:
        today = None if given.today is None else day_of(given.today)
    except ValueError as error:
        raise InputError(f"--today is {given.today}", fix="write YYYY-MM-DD") from error
    return read_policy(given.policy, today=today)


def inputs_of(given: argparse.Namespace) -> Inputs:
    """What the scene arguments name. Raises InputError for anything wrong with it."""
    return open_inputs(given.scene, path=given.path, **_settings_of(given))


def recorded_inputs_of(given: argparse.Namespace) -> tuple[Inputs, VisibleSets]:
    """What the scene arguments and --recording name, and what was drawn. Raises InputError for
    anything wrong with it."""
    if given.path is not None:
        raise InputError(
            "--path and --recording", fix="leave --path out: a recording has its cameras"
        )
    return open_recorded(given.scene, given.recording, **_settings_of(given))


def _settings_of(given: argparse.Namespace) -> dict[str, Any]:
    return {
        "frames": given.frames,
        "engine": given.engine,
        "threads": given.threads,
        "cull_backfaces": given.cull_backfaces,
        "lenient": given.lenient,
        "rest_pose": given.rest_pose,
        "max_memory": memory_of(given),
    }


def parse_raster(option: str, text: str) -> RasterTolerance:
    """The tolerance `snap=PX,depth=BITS` that an option's value declares. Raises InputError."""
    values = dict(part.partition("=")[::2] for part in text.split(","))
    fix = (
        f"write snap=0.004,depth=24 (at most {MOST_SNAP_PX} pixels; {LEAST_DEPTH_BITS} to "
        f"{MOST_DEPTH_BITS} bits, or float)"
    )
    try:
        if set(values) != {"snap", "depth"} or text.count(",") != 1:
            raise ValueError
        bits = None if values["depth"] == "float" else whole_number(values["depth"])
        declared = RasterTolerance(decimal_number(values["snap"]), bits)
    except ValueError as error:
        raise InputError(f"{option} {text} is not understood", fix=fix) from error
    try:
        return check_tolerance(declared)
    except ValueError as error:
        raise InputError(f"{option} {text}: {error}", fix=fix) from error
