"""Small scenes for hypotheses, drawn in pixels, and what each hypothesis says of them.

A hypothesis says which objects a culler with one certain mistake would drop. In each scene here
that follows from the geometry, worked out beside it; nothing of `visref.causes` is used to build
one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from visref.camera import Camera
from visref.causes.evidence import Answer, Answers
from visref.causes.search import HYPOTHESES
from visref.causes.sights import At, Hypothesis, Moments, Sights
from visref.conformance.building import Case, Mesh, box, camera, pixel_panel, pixel_point, together
from visref.engines.exact import ExactEngine
from visref.recordings.spool import Spool
from visref.timeline import Timeline

Place = tuple[int, str]


@dataclass(frozen=True, eq=False)
class Stage:
    """A case, a frame and a view of it that are asked about, and by frame and view what a culler
    drew, the names of units, and which objects it missed."""

    case: Case
    frame: int = 0
    view: str = ""
    drawn: Mapping[Place, Sequence[str]] = field(default_factory=dict)
    too_small: Sequence[str] = ()
    missed: Mapping[Place, Sequence[str]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Claim:
    """On a stage, each of the variants of a cause drops the objects named and keeps the others;
    None where it says nothing. `seen`: what is dropped shows."""

    build: Callable[[], Stage]
    cause: str
    variants: tuple[str, ...]
    drops: str | None
    seen: bool = True


def claims(build: Callable[[], Stage], *lines: str, seen: bool = True) -> list[Claim]:
    """Claims about a stage, a line each: "cause: variant; variant -> object object"; after the
    arrow "says nothing" stands for that."""
    made = []
    for line in lines:
        said, _, drops = line.partition("->")
        cause, _, variants = said.partition(":")
        names = tuple(one.strip() for one in variants.split(";"))
        told = None if drops.strip() == "says nothing" else drops
        made.append(Claim(build, cause.strip(), names, told, seen))
    return made


def cases_of(made: Sequence[Claim]) -> list[tuple[Claim, str]]:
    return [(claim, variant) for claim in made for variant in claim.variants]


def named(case: tuple[Claim, str]) -> str:
    claim, variant = case
    return f"{claim.cause}-{variant or 'plain'}-{claim.build.__name__}"


def hypothesis(cause: str, variant: str) -> Hypothesis:
    (found,) = [one for one in HYPOTHESES if (one.cause, one.variant) == (cause, variant)]
    return found


@cache
def at(build: Callable[[], Stage]) -> At:
    """All units of a stage, as hypotheses are asked about them."""
    stage = build()
    scene = stage.case.scene
    path = stage.case.path.relative_to(scene.origin)
    timeline = Timeline(scene, path)
    units = stage.case.units or scene.object_units()
    moments = Moments(timeline, path, path.numbers, lambda: ExactEngine(timeline.still))
    answers = Answers(units, [answer(stage, place) for place in stage.drawn])
    ids = np.arange(units.count, dtype=np.int32)
    too_small = np.array([name in stage.too_small for name in scene.names])
    return At(Sights(moments, answers), stage.frame, stage.view, ids, too_small)


def answer(stage: Stage, place: Place) -> Answer:
    scene = stage.case.scene
    drawn = np.array([scene.id_of_name[name] for name in stage.drawn[place]], np.int32)
    missed = np.array([scene.id_of_name[name] for name in stage.missed.get(place, ())], np.int32)
    return Answer.of(*place, drawn, np.sort(missed), Spool())


def names(asked: At, flags) -> set[str]:
    return {asked.scene.names[i] for i in np.flatnonzero(flags)}


def check(claim: Claim, variant: str) -> None:
    """That the hypothesis says of its stage what is claimed."""
    asked = at(claim.build)
    kept = hypothesis(claim.cause, variant).tell(asked)
    if claim.drops is None:
        assert kept is None
        return
    assert kept is not None
    assert kept.dtype == np.bool_
    assert kept.shape == asked.ids.shape
    wanted = set(claim.drops.split())
    assert names(asked, ~kept) == wanted
    if claim.seen:
        assert wanted <= names(asked, asked.now.seen)


# What scenes are drawn with.


def plain(width: int = 32, height: int = 24, **changes) -> Camera:
    """Orthographic, a pixel a unit, at the origin, looking down -Z."""
    return camera(width=width, height=height, **{"ymag": height / 2, "near": 0.5, **changes})


def wide(width: int = 48, height: int = 48, **changes) -> Camera:
    """Perspective, at depth 1 the image reaches 1 up and down."""
    return camera(width=width, height=height, **{"yfov": np.pi / 2, **changes})


def sheet(view: Camera, columns, rows, depth: float, *, but: Sequence[tuple] = ()) -> Mesh:
    """Whole pixels at a depth, from one to another column and row, both counted, but for some: a
    square each, whose sides lie between samples."""
    flags = np.zeros((view.height, view.width), np.bool_)
    flags[rows[0] : rows[1] + 1, columns[0] : columns[1] + 1] = True
    for hole_columns, hole_rows in but:
        flags[hole_rows[0] : hole_rows[1] + 1, hole_columns[0] : hole_columns[1] + 1] = False
    return together(
        *(
            pixel_panel(view, (left - 0.5, right + 0.5), (top - 0.5, bottom + 0.5), depth)
            for left, right, top, bottom in _rectangles(flags)
        )
    )


def _rectangles(flags) -> Iterator[tuple[int, int, int, int]]:
    """What covers the pixels set, each once: first and last column, first and last row."""
    left = flags.copy()
    while left.any():
        top, first = np.argwhere(left)[0]
        row = left[top, first:]
        width = len(row) if row.all() else int(np.argmin(row))
        whole = left[top:, first : first + width].all(axis=1)
        height = len(whole) if whole.all() else int(np.argmin(whole))
        left[top : top + height, first : first + width] = False
        yield int(first), int(first + width - 1), int(top), int(top + height - 1)


def block(view: Camera, columns, rows, depths) -> Mesh:
    """A box of an orthographic view, from pixel coordinates and depths."""
    ends = [pixel_point(view, columns[i], rows[1 - i], depths[1 - i]) for i in (0, 1)]
    return box(np.min(ends, axis=0), np.max(ends, axis=0))


def straight(x, y, depths) -> Mesh:
    """A box before a camera at the origin that looks down -Z, from x, y and depths."""
    return box((x[0], y[0], -depths[1]), (x[1], y[1], -depths[0]))
