"""What the occupancy map promises to save, checked by watching its steps.

A query is skipped if and only if some tile under the box's rectangle is unset; bits are only
ever set during a frame; all are cleared at its start; rendered shapes mark every tile that they
may touch. The checkers compute in plain Python from the scene and the camera what should have
happened; none of them uses the method's own code.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from tests.mutants.harness import Suite, Trace
from visref.camera import Camera
from visref.scene import Scene

SUITE = Suite(
    {
        "U1": "depth mask left on in a batch",
        "U2": "results shifted by one",
        "U3": "a shape that passes map 4 is dropped instead of joining list 5",
        "W4": "an empty clipped rectangle counts as all set (only a query too many)",
        "U5": "last list not flushed",
        "W6": "skipped shapes not marked",
        "W7": "map not cleared",
        "W8": "tiles rounded inward when marking",
        "W9": "any and all swapped",
        "W10": "wrong bit stride",
        "W11": "arranging map not marked",
        "W12": "back-to-front order",
    },
    # Five full lists; shapes outside the view; many small shapes. More than one frame: what one
    # leaves behind spoils the next. At this size a tile has several pixels, and neither side is a
    # multiple of a tile's.
    watched=("stacks_of_sheets", "object_crossing_the_near_plane", "crowd", "eye_inside_an_object"),
    cameras=lambda path: path.resized(201, 133).cameras[:5],
    keeps=("maps",),
)

TILES = 128

# How far a method's inflated box may stand off the true one, in pixels: twice the rasteriser's
# snap of half a 256th and the float32 roundings of a small window come to less than half.
SLACK_PX = 0.02


@SUITE.contract
def all_bits_are_cleared_at_the_start(trace: Trace) -> Iterator[str]:
    (first,) = trace.of("tiles")
    if first["maps"].any():
        yield f"{bits(first['maps'])} bits are set before the first shape is decided"


@SUITE.contract
def bits_are_only_ever_set(trace: Trace) -> Iterator[str]:
    start = next(i for i, event in enumerate(trace.events) if event.step == "tiles")
    for before, after in itertools.pairwise(trace.events[start:]):
        if (before.data["maps"] & ~after.data["maps"]).any():
            yield f"bits are unset between '{before.step}' and '{after.step}'"


@SUITE.contract
def rectangles_hold_the_box_and_little_more(trace: Trace) -> Iterator[str]:
    """Outward for safety and tight for the saving."""
    (event,) = trace.of("tiles")
    limit = np.array([trace.camera.width, trace.camera.height])
    for unit, found in zip(event["units"], event["rectangles"], strict=True):
        low, high, slack = rectangle_of(trace.camera, corners(trace.scene, int(unit)))
        least = _pixels(low, high, limit)
        most = _pixels(low - slack, high + slack, limit)
        inside = (found[:2] <= least[:2]).all() and (found[2:] >= least[2:]).all()
        if least_is_empty(least):
            inside = True
        tight = (found[:2] >= most[:2]).all() and (found[2:] <= most[2:]).all()
        if not (inside and tight):
            yield f"unit {unit}: {found.tolist()} is not between {least} and {most}"


@SUITE.contract
def tiles_hold_every_pixel_of_the_rectangle(trace: Trace) -> Iterator[str]:
    """What a lookup asks about."""
    (event,) = trace.of("tiles")
    shown = ~empty(event["rectangles"])
    found = event["tiles"].under[shown]
    expected = [
        tiles_under(event["rectangles"][shown], region) for region in possible_regions(trace)
    ]
    if not any(np.array_equal(found, tiles) for tiles in expected):
        at = int(np.argmax((found != expected[0]).any(axis=1)))
        unit = event["units"][shown][at]
        yield f"unit {unit}: tiles {found[at].tolist()}, not {expected[0][at].tolist()}"


@SUITE.contract
def marks_hold_every_triangle_and_no_more_than_the_box(trace: Trace) -> Iterator[str]:
    """What drawing a shape marks: every tile that one of its triangles may touch."""
    (event,) = trace.of("lists")
    drawn = set(trace.drawn)
    complaints: list[str] = []
    for region in possible_regions(trace):
        lines = []
        for place, unit in enumerate(event["units"].tolist()):
            if unit not in drawn:
                continue
            marked = grid_of_marks(event, place)
            box = grid(event["tiles"].under[place : place + 1])
            touched = grid(tiles_under(triangle_rectangles(trace, unit), region))
            if (touched & ~marked).any() or (marked & ~box).any():
                lines.append(
                    f"unit {unit}: {(touched & ~marked).sum()} tiles under its triangles are left "
                    f"out, {(marked & ~box).sum()} outside its box's marked"
                )
        if not lines:
            return
        complaints = complaints or lines
    yield from complaints


@SUITE.contract
def shapes_come_front_to_back(trace: Trace) -> Iterator[str]:
    (event,) = trace.of("tiles")
    before = (-np.inf, 0.0, -1)
    for unit in event["units"].tolist():
        points = corners(trace.scene, unit)
        depth, slack = trace.camera.pixel_of(points)[1], inflation(trace.camera, points)
        if depth.min() < before[0] - before[1] - slack:
            yield f"unit {unit} at depth {depth.min():.6g} comes after unit {before[2]}"
        before = (float(depth.min()), slack, unit)
    order = {unit: place for place, unit in enumerate(event["units"].tolist())}
    for query in trace.of("query"):
        places = [order[unit] for unit in query["units"].tolist()]
        if places != sorted(places):
            yield "a list's queries are not in the order of the traversal"


@SUITE.contract
def each_shape_is_decided_exactly_once(trace: Trace) -> Iterator[str]:
    (event,) = trace.of("tiles")
    asked = asked_units(trace)
    for name, units in (("drawn", trace.drawn), ("asked", asked)):
        twice = {unit for unit in units if units.count(unit) > 1}
        if twice:
            yield f"units {sorted(twice)} are {name} more than once"
    shown = event["units"][~empty(event["rectangles"])].tolist()
    undecided = set(shown) - set(trace.drawn) - set(asked)
    if undecided:
        yield f"units {sorted(undecided)} are neither drawn nor asked"
    unheard = set(trace.drawn) & set(asked) ^ set(passed_units(trace))
    if unheard:
        yield f"the answers for units {sorted(unheard)} are not followed"


@SUITE.contract
def outside_shapes_cost_nothing(trace: Trace) -> Iterator[str]:
    (event,) = trace.of("tiles")
    outside = set(event["units"][empty(event["rectangles"])].tolist())
    costly = outside & (set(trace.drawn) | set(asked_units(trace)))
    if costly:
        yield f"units {sorted(costly)} meet no pixel and are drawn or asked"


@SUITE.contract
def drawn_shapes_mark_every_tile(trace: Trace) -> Iterator[str]:
    """At the end the first map holds the tiles of what was drawn, and no others."""
    (event,) = trace.of("lists")
    found = bits_of(event["maps"][0])
    drawn = set(trace.drawn)
    expected = np.zeros((TILES, TILES), bool)
    for place, unit in enumerate(event["units"].tolist()):
        if unit in drawn:
            expected |= grid_of_marks(event, place)
    if not np.array_equal(expected, found):
        yield (
            f"{(expected & ~found).sum()} tiles of drawn shapes are unset, "
            f"{(found & ~expected).sum()} set with nothing drawn there"
        )


@SUITE.contract
def query_is_skipped_if_and_only_if_a_tile_is_unset(trace: Trace) -> Iterator[str]:
    asked, expected = set(asked_units(trace)), set(replay(trace))
    if asked != expected:
        yield (
            f"asked in vain: units {sorted(asked - expected)}; "
            f"skipped though covered: {sorted(expected - asked)}"
        )


@SUITE.contract
def lists_are_arranged_as_the_paper_says(trace: Trace) -> Iterator[str]:
    (lists,) = trace.of("lists")
    found = dict(zip(lists["units"].tolist(), lists["list_of"].tolist(), strict=True))
    wrong = {unit: (found[unit], k) for unit, k in replay(trace).items() if found[unit] != k}
    if wrong:
        unit, (got, want) = next(iter(wrong.items()))
        yield f"{len(wrong)} units; first is {unit} in list {got}, not {want}"
    # What goes out together is a list, whole.
    if not one_by_one(trace):
        together = [event["units"].tolist() for event in box_queries(trace)]
        of_list = {k: [u for u in found if found[u] == k] for k in set(found.values()) if k > 0}
        if not trace.options.get("corners") and together != [of_list[k] for k in sorted(of_list)]:
            yield "the queries that go out together are not the lists"


@SUITE.contract
def no_more_batches_than_lists(trace: Trace) -> Iterator[str]:
    lists = trace.options.get("maps", 5)
    rounds = 2 if trace.options.get("corners") else 1
    if one_by_one(trace):
        return
    if len(trace.of("query")) > lists * rounds:
        yield f"{len(trace.of('query'))} times queries go out, for {lists} lists"
    waits = trace.options.get("query", "auto") in ("auto", "batch", "instanced")
    if waits and (trace.stats.batches or 0) > lists * rounds:
        yield f"{trace.stats.batches} stalls for {lists} lists"


# What should have happened, in plain Python.


def replay(trace: Trace) -> dict[int, int]:
    """The list that each shape belongs to, of those that need a query: section 3. It takes the
    tiles of lookups and marks as told; those have contracts of their own."""
    (event,) = trace.of("tiles")
    (lists,) = trace.of("lists")
    maps = np.zeros((trace.options.get("maps", 5), TILES, TILES), bool)
    visible = set(passed_units(trace))
    list_of: dict[int, int] = {}
    outside = empty(event["rectangles"])
    for place, unit in enumerate(event["units"].tolist()):
        if outside[place]:
            continue
        at = part_of_grid(event["tiles"].under[place])
        if lists["sure"][place] or not maps[0][at].all():
            maps[0] |= grid_of_marks(lists, place)
            continue
        number = 1
        while number < len(maps) and maps[number][at].all():
            number += 1
        list_of[unit] = number
        if number < len(maps):
            maps[number][at] = True
        if one_by_one(trace) and unit in visible:
            maps[0] |= grid_of_marks(lists, place)
    return list_of


def possible_regions(trace: Trace) -> list[np.ndarray]:
    """Pixels x0, y0, x1, y1 that the tiles are spread over. More than one answer where that is
    the scene's rectangle, which is known to a pixel only."""
    camera = trace.camera
    window = np.array([0, 0, camera.width - 1, camera.height - 1])
    if trace.options.get("scale") != "scene":
        return [window]
    low, high, _ = rectangle_of(camera, box_corners(*trace.scene.bounds))
    inside = (low >= 1).all() and (high < [camera.width - 1, camera.height - 1]).all()
    depth = camera.pixel_of(box_corners(*trace.scene.bounds))[1]
    if not inside or depth.min() <= camera.near:
        return [window]
    around = np.floor([*low, *high]).astype(int)
    return [around + offset for offset in itertools.product((0, -1), (0, -1), (0, 1), (0, 1))]


def tiles_under(rectangles: np.ndarray, region: np.ndarray) -> np.ndarray:
    """(k, 4) columns and rows of tiles under rectangles of pixels."""
    size = np.ceil((region[2:] - region[:2] + 1) / TILES).astype(int)
    low, high = (rectangles[:, i : i + 2] - region[:2] for i in (0, 2))
    tiles = np.clip(np.concatenate([low // size, high // size], axis=1), 0, TILES - 1)
    tiles[empty(rectangles)] = (0, 0, -1, -1)
    return tiles


def triangle_rectangles(trace: Trace, unit: int) -> np.ndarray:
    """(k, 4) pixels that the bounding rectangle of each of a unit's triangles meets."""
    scene, camera = trace.scene, trace.camera
    own = scene.triangles[slice(*scene.object_offsets[unit : unit + 2])]
    points = scene.vertices[own].astype(np.float64)
    at, depth = camera.pixel_of(points.reshape(-1, 3))
    at, depth = at.reshape(-1, 3, 2) + 0.5, depth.reshape(-1, 3)
    low, high = at.min(axis=1), at.max(axis=1)
    for triangle in np.flatnonzero(depth.min(axis=1) < camera.near):
        low[triangle], high[triangle], _ = rectangle_of(camera, points[triangle])
    return _pixels(low, high, np.array([camera.width, camera.height]))


def box_corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(8, 3), corner numbers differing in one bit where they share an edge."""
    return np.array(list(itertools.product(*np.stack([low, high]).T)))


def rectangle_of(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Least and greatest window coordinates (pixel k is k ... k + 1) of the part beyond the
    near plane of the hull of some points, and the slack that a box's inflation earns; (inf,
    -inf) if there is none."""
    depth = camera.pixel_of(points)[1]
    kept = list(points[depth >= camera.near])
    # Where any two points' connection crosses: the hull's part lies between those.
    for i, j in itertools.combinations(range(len(points)), 2):
        if (depth[i] < camera.near) != (depth[j] < camera.near):
            t = (camera.near - depth[i]) / (depth[j] - depth[i])
            kept.append(points[i] + t * (points[j] - points[i]))
    if not kept:
        return np.full(2, np.inf), np.full(2, -np.inf), 0.0
    at, depth_kept = camera.pixel_of(np.array(kept))
    # A step of the box's inflation in pixels where it is nearest; an edge that leaves the
    # window is longer there by as much.
    pixel = 2.0 * float(np.linalg.norm(camera.right_step))
    pixel *= float(depth_kept.min()) if camera.is_perspective else 1.0
    steep = 1.0 + float(np.abs(at).max()) / camera.height
    slack = SLACK_PX + steep * inflation(camera, points) / pixel
    return at.min(axis=0) + 0.5, at.max(axis=0) + 0.5, slack


def corners(scene: Scene, unit: int) -> np.ndarray:
    return box_corners(*scene.object_bounds[unit])


def inflation(camera: Camera, points: np.ndarray) -> float:
    """By how much a box may be inflated, in world units: a share of a pixel, and of what
    float32 rounds, at its farthest corner."""
    reach = float(np.linalg.norm(points - camera.eye, axis=1).max())
    pixel = 2.0 * float(np.linalg.norm(camera.right_step))
    return SLACK_PX * pixel * (reach if camera.is_perspective else 1.0) + 1e-5 * reach


def _pixels(low: np.ndarray, high: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """(..., 4) x0, y0, x1, y1 of the pixels that window coordinates (..., 2) meet."""
    first = np.floor(np.clip(low, 0, limit))
    last = np.floor(np.clip(high, -1, limit - 1))
    return np.concatenate([first, last], axis=-1).astype(int)


def least_is_empty(rectangle: np.ndarray) -> bool:
    return bool(empty(rectangle[None])[0])


def empty(rectangles: np.ndarray) -> np.ndarray:
    return (rectangles[:, 2] < rectangles[:, 0]) | (rectangles[:, 3] < rectangles[:, 1])


def part_of_grid(row: np.ndarray) -> tuple[slice, slice]:
    """The part of a grid under columns and rows c0, r0, c1, r1, inclusive."""
    c0, r0, c1, r1 = row.tolist()
    return slice(r0, r1 + 1), slice(c0, c1 + 1)


def grid(rows: np.ndarray) -> np.ndarray:
    """(rows, columns) bool, True under any of some tiles' rows (c0, r0, c1, r1)."""
    result = np.zeros((TILES, TILES), bool)
    for row in rows:
        result[part_of_grid(row)] = True
    return result


def grid_of_marks(event: dict[str, Any], place: int) -> np.ndarray:
    """What drawing a shape marks, as the method told."""
    parts = event["tiles"].parts
    return grid(parts.tiles[slice(*parts.first[place : place + 2])])


def bits_of(words: np.ndarray) -> np.ndarray:
    """(rows, columns) bool of a map: rows of 128 bits, the least bit first."""
    unpacked = np.unpackbits(words.astype("<u4").view(np.uint8), bitorder="little")
    return unpacked.reshape(TILES, TILES).astype(bool)


def bits(maps: np.ndarray) -> int:
    return int(np.unpackbits(np.ascontiguousarray(maps).view(np.uint8)).sum())


def one_by_one(trace: Trace) -> bool:
    sync = trace.options.get("query", "auto") in ("auto", "sync")
    return bool(trace.options.get("maps", 5) == 1 and sync)


def box_queries(trace: Trace) -> list[dict[str, Any]]:
    return [e for e in trace.of("query") if not e["corners_only"] and len(e["units"])]


def asked_units(trace: Trace) -> list[int]:
    """Units asked, by box or by corners, each asking once."""
    by_box = [unit for event in box_queries(trace) for unit in event["units"].tolist()]
    settled = [
        unit
        for event in trace.of("query")
        if event["corners_only"]
        for unit, seen in zip(event["units"].tolist(), event["visible"], strict=True)
        if seen
    ]
    return by_box + settled


def passed_units(trace: Trace) -> list[int]:
    return [
        unit
        for event in trace.of("query")
        for unit, seen in zip(event["units"].tolist(), event["visible"], strict=True)
        if seen
    ]
