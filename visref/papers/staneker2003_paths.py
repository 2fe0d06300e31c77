"""Figs. 8 to 11 of Staneker, Bartz and Meissner 2003: frame rates and polygons along the paths."""

from __future__ import annotations

from functools import partial

from visref.papers.contents import Curve, Figure, Row, Table
from visref.papers.staneker2003_records import WALL, Turns, of

FIGURES = {"Angio": 8, "FormulaOne": 9, "BoomBox": 10, "City": 11}
# As the experiments call the methods that take turns.
TURNS = {"single": "single", "single with OM": "map", "multiple": "multiple"}


def path_tables(model: str, taken: Turns | None) -> tuple[Table, ...]:
    """Frame rates and polygons by frame: the paper plots them and prints no values."""
    rates = polygons = None
    if taken is not None:
        places = tuple(float(place) for place in range(taken.frames))
        label = "frame, of those measured along the path"
        rates = Figure(
            label,
            "frames a second",
            tuple(
                Curve(words, places, tuple(1e3 / ms for ms in taken.numbers(name, WALL)))
                for words, name in TURNS.items()
            ),
        )
        drawn = taken.numbers("single", "triangles_drawn")
        hidden = [a - b for a, b in zip(taken.found["triangles_in_view"], drawn, strict=True)]
        polygons = Figure(
            label,
            "thousand polygons inside the view frustum",
            tuple(
                Curve(words, places, tuple(count / 1e3 for count in counts))
                for words, counts in (("visible", drawn), ("occluded", hidden))
            ),
        )
    seen = of(taken, _visible_share)
    note = "plotted there, not printed"
    source = f"Fig. {FIGURES[model]}"
    return (
        Table(
            f"{model}: frame rates along the path",
            source,
            tuple(
                Row(
                    f"{words}: slowest frame's rate over the fastest's",
                    None,
                    of(taken, partial(_spread, name=name)),
                    "",
                    2,
                    note=note,
                )
                for words, name in TURNS.items()
            ),
            figure=rates,
        ),
        Table(
            f"{model}: polygons along the path",
            source,
            (Row("visible, of those inside the view frustum", None, seen, "%", note=note),),
            figure=polygons,
        ),
    )


def _spread(taken: Turns, name: str) -> float:
    times = taken.numbers(name, WALL)
    return min(times) / max(times)


def _visible_share(taken: Turns) -> float:
    in_view: list[float] = taken.found["triangles_in_view"]
    return sum(taken.numbers("single", "triangles_drawn")) / sum(in_view)
