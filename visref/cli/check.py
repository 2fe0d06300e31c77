"""visref check: judge an engine's recorded visible sets."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from visref.camera_path import CameraPath
from visref.cli.arguments import (
    add_judging_arguments,
    add_scene_arguments,
    inputs_of,
    parse_raster,
    policy_of,
    recorded_inputs_of,
)
from visref.cli.command_facts import facts_of, packages_of
from visref.cli.judged import judge
from visref.cli.reports import add_report_arguments
from visref.cli.terminal import OUT
from visref.culler import Culler, Promise, RasterTolerance
from visref.errors import InputError
from visref.files import refuse_inputs, replacing_file
from visref.inputs import Inputs
from visref.judging.outcome import RunOutcome
from visref.judging.policy_file import ADOPTED, adopted, to_toml
from visref.judging.status import Exit
from visref.recordings.visible_sets import Replay, VisibleSets, read_visible_sets
from visref.runs import Misaligned
from visref.scene import Scene
from visref.wording import counted


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_scene_arguments(parser)
    add_judging_arguments(parser)
    add_report_arguments(parser)
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
        "--write-waivers",
        type=Path,
        metavar="FILE",
        help="a new policy that waives every violation found, for a first adoption: each entry "
        "wants a reason from you",
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
    policy = policy_of(given)
    waivers: Path | None = given.write_waivers
    # What stands there already has reasons that somebody wrote by hand.
    if waivers is not None and waivers.exists():
        raise InputError("cannot write here: it exists", source=str(waivers), fix="name a new file")
    if waivers is not None and given.shard is not None:
        raise InputError("--write-waivers and --shard", fix="write waivers of the whole run")
    refuse_inputs(given.out, [file, waivers])
    if given.recording is not None:
        inputs, recorded = recorded_inputs_of(given)
    else:
        inputs = inputs_of(given)
        recorded = read_visible_sets(
            file, inputs.scene, inputs.frames, inputs.path, max_memory=inputs.max_memory
        )

    anew = Replaying(file.name, recorded, inputs.path, Promise(given.promise), tolerance)
    outcome = judge(
        given,
        inputs,
        anew,
        policy=policy,
        if_misaligned=Misaligned(given.if_misaligned),
        recorded=True,
        command=facts_of(
            given,
            inputs,
            policy,
            files={"truth": given.truth, "recording": file},
            options={
                "pictures": given.pictures,
                "superfluous rows": given.superfluous_rows,
                "name of the recording": file.name,
                "promise": given.promise,
                "raster": tolerance,
                "misaligned": given.if_misaligned,
            },
        ),
        opening=partial(_inputs_again, given),
        packages=packages_of([]),
    )
    if given.write_waivers is not None:
        _write_waivers(given.write_waivers, outcome, inputs.scene)
    return outcome.exit


@dataclass(frozen=True, eq=False)
class Replaying:
    """Makes a recording's culler, here or in another process."""

    name: str
    recorded: VisibleSets
    path: CameraPath
    promise: Promise
    raster: RasterTolerance | None

    @contextmanager
    def __call__(self) -> Iterator[list[tuple[str, Culler]]]:
        yield [(self.name, Replay(self.recorded, self.path, self.promise, self.raster))]


def _inputs_again(given: argparse.Namespace) -> Inputs:
    return inputs_of(given) if given.recording is None else recorded_inputs_of(given)[0]


def _write_waivers(file: Path, outcome: RunOutcome, scene: Scene) -> None:
    policy = adopted(outcome.policy, outcome, scene)
    with replacing_file(file) as written:
        written.write_text(f"{ADOPTED}{to_toml(policy)}", encoding="utf-8")
    added = len(policy.waivers) - len(outcome.policy.waivers)
    if not added:
        OUT.remark(f"Waivers: {file} has no new entry, there is nothing to waive")
        return
    entries = counted(added, "entry", "entries")
    OUT.remark(f"Waivers: {file} has {entries} without a reason yet; fill each in, or leave it out")
