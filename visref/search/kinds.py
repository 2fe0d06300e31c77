"""What generated scenes are written in: kinds of parts, and the numbers that each is drawn with.

A part is a JSON object, `{"kind": "gap", "x": 0.31, …}`: the kind says which genes there are, and
how a part with given genes is built. So any part can be drawn anew, changed a little, or taken from
another scene, and a scene on disk is its parts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from visref.camera import Camera
from visref.conformance.building import Cutout, Mesh, pixel_point, together
from visref.scene import Alpha

Part = dict[str, Any]

# A gene's share of its range that a small change moves it by, as a standard deviation.
_STEP = 0.1


@dataclass(frozen=True)
class Gene:
    """A number of a part, from `low` to `high`. `how`: "even", "log" (its logarithm is even), or
    "whole" (both ends included)."""

    low: float
    high: float
    how: str = "even"

    def draw(self, rng: np.random.Generator) -> float:
        return self._at(float(rng.random()))

    def near(self, value: float, rng: np.random.Generator) -> float:
        """A value not far from another."""
        if self.how == "whole" and self.high - self.low < 8:
            return self.draw(rng)
        low, high = self._scaled(self.low), self._scaled(self.high)
        share = (self._scaled(value) - low) / (high - low) if high > low else 0.0
        return self._at(float(np.clip(share + rng.normal(0.0, _STEP), 0.0, 1.0)))

    def _scaled(self, value: float) -> float:
        return math.log(value) if self.how == "log" else value

    def _at(self, share: float) -> float:
        if self.how == "whole":
            # The last share, 1, is the highest too.
            return float(min(self.high, math.floor(self.low + share * (self.high - self.low + 1))))
        low, high = self._scaled(self.low), self._scaled(self.high)
        value = low + share * (high - low)
        # Six digits: enough for any place in an image, and short on disk.
        return float(f"{math.exp(value) if self.how == 'log' else value:.6g}")


@dataclass(frozen=True)
class Kind:
    """A kind of part. `weight`: how often it is drawn beside the others of its catalogue; `about`:
    what goes wrong there."""

    name: str
    weight: float
    about: str
    genes: Mapping[str, Gene]
    build: Callable[..., Any]

    def draw(self, rng: np.random.Generator) -> Part:
        return {"kind": self.name, **{name: gene.draw(rng) for name, gene in self.genes.items()}}


Catalogue = dict[str, Kind]


def register(
    catalogue: Catalogue, weight: float, **genes: Gene
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """A decorator that puts what builds a part into a catalogue, under its own name; its docstring
    says what goes wrong there."""

    def kind(build: Callable[..., Any]) -> Callable[..., Any]:
        name = build.__name__.replace("_", "-")
        about = " ".join((build.__doc__ or "").split())
        catalogue[name] = Kind(name, weight, about, genes, build)
        return build

    return kind


def draw_part(catalogue: Catalogue, rng: np.random.Generator) -> Part:
    """A part of any kind, by the kinds' weights."""
    kinds = list(catalogue.values())
    weights = np.array([kind.weight for kind in kinds])
    return kinds[int(rng.choice(len(kinds), p=weights / weights.sum()))].draw(rng)


def changed_part(catalogue: Catalogue, part: Part, rng: np.random.Generator) -> Part:
    """The part with one or two of its genes changed: a little, or drawn anew."""
    genes = catalogue[part["kind"]].genes
    result = dict(part)
    for name in rng.permutation(list(genes))[: int(rng.integers(1, 3))]:
        gene, value = genes[str(name)], part[str(name)]
        result[str(name)] = gene.near(value, rng) if rng.random() < 0.6 else gene.draw(rng)
    return result


def whole(low: int, high: int) -> Gene:
    return Gene(low, high, "whole")


def log(low: float, high: float) -> Gene:
    return Gene(low, high, "log")


# Places, as shares of the image's width or height; and view depths.
PLACE = Gene(0.0, 1.0)
DEPTH = log(1.5, 60.0)
SEED = whole(0, 9999)
YES = whole(0, 1)


@dataclass(eq=False)
class Piece:
    """An object of a generated scene."""

    name: str
    mesh: Mesh
    alpha: Alpha = Alpha.OPAQUE
    one_sided: bool = False
    cutout: Cutout | None = None


@dataclass(eq=False)
class Stage:
    """Where parts are laid out: `view`, the camera that looks down -Z from the origin, in whose
    pixels most of them are given."""

    view: Camera
    pieces: list[Piece] = field(default_factory=list)

    @property
    def width(self) -> int:
        return self.view.width

    @property
    def height(self) -> int:
        return self.view.height

    def column(self, share: float) -> float:
        """The pixel column that a share of the width falls into."""
        return float(min(self.width - 1, math.floor(share * self.width)))

    def row(self, share: float) -> float:
        return float(min(self.height - 1, math.floor(share * self.height)))

    def rect(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        depth: float,
        depth_right: float | None = None,
    ) -> Mesh:
        """A rectangle by its sides in pixel coordinates; its left end, or all of it, at `depth`."""
        right = depth if depth_right is None else depth_right
        corners = [(x[0], y[1], depth), (x[1], y[1], right), (x[1], y[0], right)]
        corners.append((x[0], y[0], depth))
        points = np.array([pixel_point(self.view, *corner) for corner in corners])
        return points, np.array([[0, 1, 2], [0, 2, 3]])

    def triangle(self, corners: list[tuple[float, float]], depth: float) -> Mesh:
        points = np.array([pixel_point(self.view, x, y, depth) for x, y in corners])
        return points, np.array([[0, 1, 2]])

    def flagged(self, mesh: Mesh, x: float, y: float, flag: float) -> Mesh:
        """The mesh with a speck near the eye at a pixel, so that its box begins there and it comes
        first from front to back; without one unless `flag`."""
        if not flag:
            return mesh
        depth = max(1.0, 1.05 * self.view.near)
        return together(mesh, self.rect((x - 0.1, x + 0.1), (y - 0.1, y + 0.1), depth))

    def put(self, name: str, mesh: Mesh, **how: Any) -> None:
        self.pieces.append(Piece(name, mesh, **how))

    def space(self, x: float, y: float, depth: float) -> Any:
        """(3,) float64, the point at a share of the width and height, at a depth."""
        return pixel_point(self.view, x * self.width - 0.5, y * self.height - 0.5, depth)

    def pixel(self, depth: float) -> float:
        """A pixel's side, in world units, at a depth."""
        step = 2.0 * float(np.linalg.norm(self.view.up_step))
        return step * depth if self.view.is_perspective else step
