"""Hey, Tobler and Purgathofer, TR-186-2-01-02, 2001: what is printed there."""

from __future__ import annotations

from visref.papers.published import Printed, PrintedRange

SCENE_TRIANGLES = {
    "forest": Printed(1_694_426, "section 7", "forest scene, triangles"),
    "city": Printed(34_034_176, "section 7", "city scene, triangles"),
}
NAMES = {"forest": "Forest", "city": "City"}
CELL_PX = Printed(32, "section 7", "size of the grid's cells, 32x32 pixels")
TRIANGLES_A_BOX = Printed(1500, "section 7", "city: no more triangles in a bounding box")


def _printed(
    source: str, columns: tuple[str, str], rows: dict[tuple[str, int], tuple[int, int]]
) -> dict[tuple[str, int], tuple[Printed, Printed]]:
    """A figure's two columns, by scene and image width (640 by 480, 1280 by 960)."""
    first, second = columns
    return {
        (scene, width): (
            Printed(one, source, f"{NAMES[scene].lower()} {width}, {first}"),
            Printed(other, source, f"{NAMES[scene].lower()} {width}, {second}"),
        )
        for (scene, width), (one, other) in rows.items()
    }


TRIANGLES_DRAWN = _printed(
    "Fig. 7",
    ("lazy / busy occlusion grid", "no occlusion culling"),
    {
        ("forest", 640): (7_009, 147_969),
        ("forest", 1280): (7_510, 147_969),
        ("city", 640): (11_981, 1_964_918),
        ("city", 1280): (11_775, 1_964_918),
    },
)
PIXEL_QUERIES = _printed(
    "Fig. 8",
    ("lazy occlusion grid", "busy occlusion grid"),
    {
        ("forest", 640): (498, 2_394),
        ("forest", 1280): (650, 6_781),
        ("city", 640): (565, 1_332),
        ("city", 1280): (937, 4_227),
    },
)
FRAME_RATE_GAIN = PrintedRange(
    Printed(1.9, "section 7", "frame-rate higher than without, at least"),
    Printed(5.8, "section 7", "frame-rate higher than without, at most"),
)
READBACK_SHARE = PrintedRange(
    Printed(38, "section 7", "total rendering time spent for glReadPixels, least %", per=100),
    Printed(52, "section 7", "total rendering time spent for glReadPixels, most %", per=100),
)
