"""Queries and lookups in Staneker, Bartz and Meissner 2003: sections 2 and 3, Fig. 1."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from visref.papers.contents import (
    Basis,
    Claim,
    Curve,
    Figure,
    Results,
    Row,
    Sense,
    SetUp,
    Table,
    single,
)
from visref.papers.printed.staneker2003 import (
    ALWAYS_VISIBLE,
    LISTS,
    MAP_BYTES,
    MODELS,
    ORDERS,
    QUERY_IN_TRIANGLES,
    TWICE,
)
from visref.papers.staneker2003_records import Turns, TurnsOf, of

# The ways to ask many at once.
WAYS = {"batch": "in a batch", "instanced": "as one of an instanced draw"}

# What "orders of magnitude" must mean at least: it is a plural.
LEAST_ORDERS = 100.0


def latency_table(results: Results) -> Table:
    """Section 2 and Fig. 1."""
    found = results.experiment("latency")
    faster = of(found, lambda f: f["unculled_ms"][-1] / f["culled_ms"][-1])
    cost = of(results.experiment("query-in-triangles"), lambda f: f["query_ms"] / f["triangle_ms"])
    rows = [
        Row("a query in triangles of 25 pixels", QUERY_IN_TRIANGLES, cost, basis=Basis.WITHIN_RUN),
        Row("largest box: back faces drawn over culled", TWICE, faster, digits=2,
            basis=Basis.WITHIN_RUN, note="theirs is almost that"),
    ]  # fmt: skip
    growth = of(found, lambda f: f["unculled_ms"][-1] / f["unculled_ms"][0])
    figure = None
    if found:
        area = tuple(px * px / 1e3 for px in found["sizes_px"])
        curves = tuple(
            Curve(f"{name} back-face culling", area, tuple(1e3 * ms for ms in found[key]))
            for name, key in (("without", "unculled_ms"), ("with", "culled_ms"))
        )
        figure = Figure("front face of the box, thousand pixels", "latency of a query, µs", curves)
        rows += [
            Row(f"a query of {px} × {px} pixels", None, ms, "ms", 3, Basis.HARDWARE)
            for px, ms in zip(found["sizes_px"], found["culled_ms"], strict=True)
        ]
        rows += [
            Row(f"a query of {found['sizes_px'][0]} × {found['sizes_px'][0]} pixels, {words}", None,
                found["each_ms"][way], "ms", 4, Basis.HARDWARE)
            for way, words in WAYS.items()
        ]  # fmt: skip
    claims = (
        Claim(
            "a query's latency grows with its box's pixels: the largest box's over the smallest's",
            Sense.AT_LEAST,
            of(growth, single),
            digits=1,
        ),
        Claim(
            "back-face culling makes a query almost twice as fast, of the largest box",
            Sense.AT_LEAST,
            of(faster, single),
            TWICE,
        ),
    )
    return Table(
        "Latency of an occlusion query",
        "section 2 and Fig. 1",
        tuple(rows),
        claims,
        figure=figure,
    )


def map_table(results: Results, turns: TurnsOf) -> Table:
    """The map's size, lookups beside queries, and the shapes that need no query."""
    lookup, latency = results.experiment("lookup"), results.experiment("latency")
    rows = [
        Row("a map, bytes", MAP_BYTES, of(lookup, lambda f: f["map_bytes"])),
    ]
    if lookup:
        rows += [
            Row(f"a lookup of {tiles} × {tiles} tiles", None, 1e6 * ms, "ns", 1, Basis.HARDWARE)
            for tiles, ms in zip(lookup["tiles"], lookup["lookup_ms"], strict=True)
        ]
    whole = of(latency, lambda f: _quotients(f, "lookup_ms"))
    for words, quotients in (
        ("a lookup of the same box", whole),
        ("its bits alone", of(latency, lambda f: _quotients(f, "bits_ms"))),
    ):
        rows += [
            Row(f"a query over {words}: {which}", ORDERS, of(quotients, pick), "", 0,
                Basis.WITHIN_RUN)
            for which, pick in (("the least of the sizes", min), ("the greatest", max))
        ]  # fmt: skip
    rows += [
        Row(f"{model}: shapes in view that need no query", ALWAYS_VISIBLE,
            of(turns.get(model), _unasked), "%", 1, note="theirs of geometry, by estimates")
        for model in MODELS
    ]  # fmt: skip
    claim = Claim(
        "a lookup costs orders of magnitude less than a query, at least two: the time of a query "
        "over that of a lookup of the same box, the least of the boxes",
        Sense.AT_LEAST,
        of(whole, lambda q: single(min(q))),
        even=LEAST_ORDERS,
        ties=True,
        digits=0,
    )
    lists = SetUp("lists of queries", LISTS)
    return Table("The map", "sections 2 and 3", tuple(rows), (claim,), setup=(lists,))


def _quotients(latency: Mapping[str, Any], lookup: str) -> list[float]:
    """A query's time over a lookup's, by the size of the box."""
    return [a / b for a, b in zip(latency["culled_ms"], latency[lookup], strict=True)]


def _unasked(turns: Turns) -> float:
    """The share of the shapes in view that the map alone shows to be visible."""
    skipped = turns.mean("map", "tests_skipped")
    return skipped / (skipped + turns.mean("map", "queries"))
