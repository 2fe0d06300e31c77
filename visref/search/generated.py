"""Generated scenes as a source of trials."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from visref.search.case import Case
from visref.search.grammar import Recipe, built, changed, crossed, random_recipe

# What makes a name its object's own: a number, and that of a name that repeats.
_NUMBER = re.compile(r"( \d+)?(#\d+)?$")

# One box before a camera.
PLAIN = Recipe.from_json(
    {
        "lens": {"kind": "straight", "size": 0, "yfov": 1.0, "near": 0, "far": 0},
        "path": {"kind": "one-frame"},
        "views": {"kind": "one"},
        "world": {"kind": "as-it-is"},
        "things": [
            {"kind": "solid", "x": 0.5, "y": 0.5, "depth": 5.0, "a": 0.1, "b": 0.1, "c": 0.1,
             "one": 0, "far": 0}
        ],
        "same_names": False,
    }
)  # fmt: skip


@dataclass(frozen=True)
class GeneratedScenes:
    """Scenes of the grammar. `moves`: whether things may move in them, which is for cullers that
    say they can be told (`Culler.moves`)."""

    moves: bool = True

    def random(self, rng: np.random.Generator) -> Recipe:
        return random_recipe(rng, moves=self.moves)

    def changed(self, genome: Recipe, rng: np.random.Generator) -> Recipe:
        return changed(genome, rng, moves=self.moves)

    def crossed(self, one: Recipe, other: Recipe, rng: np.random.Generator) -> Recipe:
        return crossed(one, other, rng)

    def written(self, genome: Recipe) -> Any:
        return genome.to_json()

    def read(self, value: Any) -> Recipe:
        return Recipe.from_json(value)

    def case(self, genome: Recipe) -> Case:
        return Case.of(*built(genome))

    def called(self, case: Case) -> Callable[[int], str]:
        """By their kinds."""
        return [kind_of(name) for name in case.scene.names].__getitem__


def kind_of(name: str) -> str:
    """What an object of a generated scene is, by its name."""
    return _NUMBER.sub("", name)
