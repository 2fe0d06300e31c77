"""Staneker, Bartz and Meissner, PVG 2003: what is printed there."""

from __future__ import annotations

from visref.papers.published import Printed, PrintedRange, PrintedWords


def _printed(
    source: str,
    columns: tuple[str, ...],
    rows: dict[str, tuple[float, ...]],
    *,
    per: float = 1.0,
) -> dict[str, tuple[Printed, ...]]:
    """A table's numbers by model."""
    return {
        model: tuple(
            Printed(value, source, f"{model}, {column}", per=per)
            for column, value in zip(columns, values, strict=True)
        )
        for model, values in rows.items()
    }


MODELS = _printed(
    "Table 3",
    ("shapes", "num polygons", "average polygons/shape"),
    {
        "Angio": (177, 419_639, 2_370),
        "BoomBox": (530, 644_268, 1_215),
        "FormulaOne": (306, 746_827, 2_441),
        "City": (1_900, 4_059_195, 2_134),
    },
)
FRAME_RATE_HP = _printed(
    "Table 1",
    ("without OM", "with OM"),
    {"Angio": (7.0, 7.8), "BoomBox": (10.8, 11.1), "FormulaOne": (6.3, 6.5)},
)
BOX_PIXELS = _printed(
    "Table 2",
    ("without OM", "with OM"),
    {
        "Angio": (2_953_200, 382_450),
        "BoomBox": (3_469_702, 1_365_960),
        "FormulaOne": (1_217_297, 544_213),
    },
)
PIXELS_LEFT = _printed(
    "Table 2",
    ("% with OM",),
    {"Angio": (13,), "BoomBox": (39,), "FormulaOne": (45,)},
    per=100,
)
FRAME_RATE = _printed(
    "Table 4",
    ("single ocq", "single ocq OM", "multiple ocq"),
    {
        "Angio": (20.3, 22.8, 30.5),
        "BoomBox": (28.0, 28.4, 37.9),
        "FormulaOne": (17.7, 18.4, 24.9),
        "City": (17.2, 18.5, 30.7),
    },
)
SPEED_UP = _printed(  # the map over none, multiple queries over single ones with a map
    "Table 5",
    ("% single ocq OM", "% multiple ocq"),
    {"Angio": (12, 34), "BoomBox": (1, 33), "FormulaOne": (4, 35), "City": (8, 66)},
    per=100,
)
MAP_BYTES = Printed(2_048, "section 3.1", "Occupancy Map size, bytes")
LISTS = Printed(5, "section 3.2", "multiple occlusion queries are sufficient: five")
ALWAYS_VISIBLE = PrintedRange(
    Printed(5, "section 2", "% of the geometry always not occluded, least", per=100),
    Printed(10, "section 2", "% of the geometry always not occluded, most", per=100),
)
QUERY_IN_TRIANGLES = Printed(
    190, "section 2", "triangles of 25 pixels to one query, after Severson"
)
TWICE = Printed(2, "section 2", "with backface culling the query is almost twice as fast")
ORDERS = PrintedWords("orders of magnitude", "section 3.1")
