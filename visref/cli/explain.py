"""visref explain: replay a witness from the run folder alone."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from visref.cli.manners import GREEN, RED, add_json
from visref.cli.terminal import OUT
from visref.files import refuse_inputs
from visref.judging.status import Exit
from visref.numerals import whole_number
from visref.run_folder.explain import draw_neighbourhood, explain, picture_beside
from visref.run_folder.layout import WITNESSES


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, metavar="RUN")
    parser.add_argument("--frame", type=whole_number, required=True, metavar="F")
    parser.add_argument("--object", required=True, metavar="O", help="object id or name")
    parser.add_argument("--culler", metavar="NAME", help="default: every culler that missed it")
    parser.add_argument(
        "--picture", type=Path, metavar="FILE.png", help="default: beside the witness in RUN"
    )
    add_json(parser)


def run(given: argparse.Namespace) -> Exit:
    explanations = explain(given.run, given.frame, given.object, given.culler)
    pictures = [
        _picture(given, explanation.witness, index)
        for index, explanation in enumerate(explanations)
    ]
    for explanation, picture in zip(explanations, pictures, strict=True):
        draw_neighbourhood(explanation, picture)
    if given.json:
        OUT.json(
            [
                {"holds": one.holds, "lines": one.lines, "picture": str(picture)}
                | {"witness": dict(one.witness)}
                for one, picture in zip(explanations, pictures, strict=True)
            ]
        )
    else:
        for explanation, picture in zip(explanations, pictures, strict=True):
            for line in (*explanation.lines, f"the neighbourhood: {picture}"):
                OUT.line(line)
            if explanation.holds:
                OUT.line("the claim holds", colour=GREEN, of="the claim holds")
            else:
                OUT.line("THE CLAIM DOES NOT HOLD", colour=RED, of="THE CLAIM DOES NOT HOLD")
    holds = all(explanation.holds for explanation in explanations)
    return Exit.NO_VIOLATION if holds else Exit.VIOLATION


def _picture(given: argparse.Namespace, witness: Mapping[str, Any], index: int) -> Path:
    """Where the picture of the witness with this index goes."""
    if given.picture is None:
        return picture_beside(given.run, witness)
    first: Path = given.picture
    picture = first.with_stem(f"{first.stem}-{index + 1}") if index else first
    earlier = set((given.run / WITNESSES).glob("*.png"))
    refuse_inputs(picture, set(given.run.rglob("*")) - earlier)
    return picture
