"""The occupancy map: safe with every option, compiled as stepwise, saving what it promises."""

import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.mutants.occupancy_map.stepwise import StepwiseOccupancyMap, each_tile
from tests.support.culling_scenes import box, ortho, perspective, quad, random_camera, random_scene
from visref.camera import Camera
from visref.culler import Promise
from visref.errors import InputError
from visref.scene import Scene, Units
from visref_culling.baselines import SingleQueryCulling
from visref_culling.boxes.conservative import inflated
from visref_culling.boxes.rectangles import screen_rectangles
from visref_culling.gl.device import device
from visref_culling.gl.view import View
from visref_culling.occupancy_map import OccupancyMapCulling
from visref_culling.occupancy_map.parts import parts_of
from visref_culling.occupancy_map.tiles import (
    DRAW_NOW,
    OUTSIDE,
    TILES,
    WORDS,
    Grid,
    covered,
    mark,
    tiles_under,
)

EMPTY = Scene.from_objects([])
OPTIONS = [
    {},
    {"maps": 1},
    {"maps": 1, "query": "batch", "parts": 1},
    {"query": "sync", "scale": "scene", "parts": 5},
    {"query": "instanced", "backfaces": True},
    {"corners": True},
    {"maps": 1, "corners": True, "scale": "scene"},
    {"depth": 32, "corners": True, "query": "instanced"},
    {"thread": True},
    {"thread": True, "corners": True, "scale": "scene"},
]


def crowd(seed=0, count=60, reach=(4.0, 4.0), wall=True):
    """Boxes in front of, behind and beside a wall."""
    rng = np.random.default_rng(seed)
    objects = [("wall", *quad((-3, -3), (3, 3), -5.0))] if wall else []
    for i in range(count):
        centre = rng.uniform(-1, 1, 3) * (*reach, 3.5) - (0, 0, 6)
        objects.append((f"b{i}", *box(tuple(centre), rng.uniform(0.05, 0.5))))
    return Scene.from_objects(objects)


def visible_of(culler, scene, camera):
    ids = culler.raster.item_buffer(camera)
    return np.unique(scene.object_of_triangle[ids[ids >= 0]])


def watch(culler):
    steps = []
    culler.observer = lambda step, data: steps.append((step, dict(data)))
    return steps


# The bits.


@settings(deadline=None)  # the first call compiles
@given(st.integers(0, 2**32 - 1))
def test_compiled_bits_are_those_of_a_plain_grid(seed):
    rng = np.random.default_rng(seed)
    words, grid = np.zeros(WORDS, np.uint32), np.zeros((TILES, TILES), bool)
    assert words.nbytes == 2048
    for _ in range(20):
        c0, c1 = np.sort(rng.integers(0, TILES, 2))
        r0, r1 = np.sort(rng.integers(0, TILES, 2))
        if rng.random() < 0.5:  # mostly small: large ones soon cover everything
            c1, r1 = min(c1, c0 + 3), min(r1, r0 + 3)
        assert covered(words, c0, r0, c1, r1) == grid[r0 : r1 + 1, c0 : c1 + 1].all()
        mark(words, c0, r0, c1, r1)
        grid[r0 : r1 + 1, c0 : c1 + 1] = True
        assert covered(words, c0, r0, c1, r1)
        bits = np.unpackbits(words.view(np.uint8), bitorder="little").reshape(TILES, TILES)
        assert np.array_equal(bits, grid)


@pytest.mark.parametrize(("c0", "c1"), [(0, 31), (31, 32), (32, 63), (0, 127), (127, 127), (5, 5)])
def test_one_unset_tile_at_any_end_of_a_row_is_seen(c0, c1):
    words = np.zeros(WORDS, np.uint32)
    mark(words, 0, 0, TILES - 1, TILES - 1)
    assert (words == 0xFFFFFFFF).all()
    for column in (c0, c1):
        holed = words.copy()
        holed[7 * 4 + column // 32] &= ~np.uint32(1 << (column % 32))
        assert not covered(holed, c0, 5, c1, 9)
        assert covered(holed, c0, 8, c1, 9)


# Safety.


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_every_visible_object_is_drawn(options):
    culler = OccupancyMapCulling(**options)
    culled = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        scene = random_scene(rng) if seed % 2 else crowd(seed)
        culler.prepare(scene)
        sizes = [(1, 1), (1, 200), (33, 17), (150, 130)]
        for _ in range(3):
            camera = random_camera(rng, *sizes[seed % 4])
            drawn = culler.cull(camera).unit_ids
            assert len(np.setdiff1d(visible_of(culler, scene, camera), drawn)) == 0
            assert len(set(drawn)) == len(drawn)
            culled += scene.object_count - len(drawn)
    assert culled > 100
    culler.close()


@pytest.mark.gl
def test_min_pixels_leaves_out_small_objects_and_says_so():
    scene = Scene.from_objects(
        [("large", *quad((0, 0), (5, 1), -5.0)), ("small", *quad((-3, 0), (-1, 1), -5.0))]
    )
    for min_pixels, drawn in ((0, [0, 1]), (2, [0, 1]), (5, [0])):
        culler = OccupancyMapCulling(min_pixels=min_pixels)
        culler.prepare(scene)
        assert culler.cull(ortho(16, 12)).unit_ids.tolist() == drawn
        assert culler.promise.convicts == (min_pixels == 0)
        culler.close()
    assert OccupancyMapCulling.promise is Promise.CONSERVATIVE
    with pytest.raises(InputError, match="min_pixels is -1"):
        OccupancyMapCulling(min_pixels=-1)


@pytest.mark.gl
def test_small_object_around_the_eye_is_never_left_out_for_its_size():
    scene = Scene.from_objects([("around", *box((0, 0, 0), 0.05))])
    culler = OccupancyMapCulling(min_pixels=1000)
    culler.prepare(scene)
    assert culler.cull(perspective(8, 8, near=0.01)).unit_ids.tolist() == [0]
    culler.close()


# Compiled against stepwise.


def decisions(culler, seed):
    """What a culler decides on a few frames: drawn, costs, lists, and the maps at the end."""
    rng = np.random.default_rng(seed)
    culler.prepare(crowd(seed, count=40, reach=(2.0, 2.0) if seed % 2 else (6.0, 6.0)))
    found = []
    for camera in (perspective(150, 100), random_camera(rng, 40, 30), ortho(12, 12)):
        steps = watch(culler)
        drawn = culler.cull(camera)
        (lists,) = (data for step, data in steps if step == "lists")
        kept = [lists[name].tolist() for name in ("units", "list_of", "maps")]
        found.append((drawn.unit_ids.tolist(), drawn.stats.counts(), *kept))
    return found


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_compiled_traversal_decides_as_the_stepwise_one(options):
    shipped, stepwise = OccupancyMapCulling(**options), StepwiseOccupancyMap(**options)
    for seed in range(6):
        assert decisions(shipped, seed) == decisions(stepwise, seed)
    shipped.close()
    stepwise.close()


class GoesOnPastAnswers(OccupancyMapCulling):
    """Decides by the map as it is before the answers that are still out."""

    def arrange(self, *state, stop_after_run):
        return super().arrange(*state, stop_after_run=False)


@pytest.mark.gl
def test_stepwise_traversal_tells_where_a_run_must_end():
    broken, stepwise = GoesOnPastAnswers(maps=1), StepwiseOccupancyMap(maps=1)
    assert any(decisions(broken, seed) != decisions(stepwise, seed) for seed in range(6))
    broken.close()
    stepwise.close()


@pytest.mark.gl
def test_second_thread_changes_nothing_and_is_gone_when_the_culler_is_closed():
    for seed in range(3):
        alone, beside = OccupancyMapCulling(), OccupancyMapCulling(thread=True)
        assert decisions(beside, seed) == decisions(alone, seed)
        alone.close()
        beside.close()
        assert not [one for one in threading.enumerate() if one.name.startswith("arranging")]


# Parts.


@pytest.mark.parametrize("cells", [1, 2, 7])
def test_parts_hold_their_shape_and_lie_in_its_box(cells):
    scene = random_scene(np.random.default_rng(cells))
    units = Units(np.array([0, 5, 5, 40]), np.arange(40, dtype=np.int32))
    boxes, offsets = parts_of(scene, units, cells)
    assert offsets.tolist()[0] == 0
    assert offsets[1] == offsets[2]
    assert len(boxes) == offsets[-1] <= 40
    for unit in (0, 2):
        own = boxes[offsets[unit] : offsets[unit + 1]]
        bounds = scene.bounds_of(units)[unit]
        assert own[:, 0].min(axis=0).tolist() == bounds[0].tolist()
        assert own[:, 1].max(axis=0).tolist() == bounds[1].tolist()
        for triangle in units.gather(np.array([unit], np.int32)):
            corners = scene.vertices[scene.triangles[triangle]]
            holds = (own[:, 0] <= corners.min(axis=0)) & (corners.max(axis=0) <= own[:, 1])
            assert holds.all(axis=1).any()
    assert len(boxes) == 2 if cells == 1 else len(boxes) > 2


@pytest.mark.gl
def test_drawn_shapes_mark_every_tile_that_they_touch():
    """Against the picture: wherever depth was written, the first map is set."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        culler = OccupancyMapCulling(parts=1 + seed % 3)
        scene = crowd(seed, wall=False)
        culler.prepare(scene)
        camera = perspective(300, 200) if seed % 2 else random_camera(rng, 300, 200)
        culler.cull(camera)
        rows, columns = np.nonzero(culler.target_for(camera).read_depth() < 1.0)
        assert len(rows) > 100
        bits = np.unpackbits(culler.maps[0].view(np.uint8), bitorder="little").reshape(TILES, TILES)
        assert bits[rows // 2, columns // 3].all()  # 2 and 3 pixels a tile
        assert not bits.all()
        culler.close()


@pytest.mark.gl
@pytest.mark.parametrize("maps", [1, 5])
def test_parts_of_what_is_not_drawn_are_not_even_projected(maps):
    culler = OccupancyMapCulling(maps=maps)
    culler.prepare(crowd(1, reach=(2.0, 2.0)))
    steps = watch(culler)
    drawn = set(culler.cull(perspective(150, 100)).unit_ids.tolist())
    (lists,) = (data for step, data in steps if step == "lists")
    parts = lists["tiles"].parts
    shapes = [parts.tiles[slice(*parts.first[k : k + 2])] for k in range(len(lists["units"]))]
    marking = {
        int(unit)
        for unit, own in zip(lists["units"], shapes, strict=True)
        if (own[:, 2] >= own[:, 0]).any()
    }
    assert marking == drawn
    assert 10 < len(drawn) < len(lists["units"])
    culler.close()


def test_parts_out_of_range_are_bad_input():
    for parts in (0, 33):
        with pytest.raises(InputError, match=f"parts is {parts}"):
            OccupancyMapCulling(parts=parts)


# The saving.


def check_contract(steps, lists_count):
    """Replay the decisions on sets of tiles: a query is skipped if and only if some tile under
    the rectangle is unset (or the box needs none), lists fill as the paper says, each shape is
    decided once."""
    (tiles,) = (data["tiles"] for step, data in steps if step == "tiles")
    (lists,) = (data for step, data in steps if step == "lists")
    asked = [u for s, d in steps if s == "query" and not d["corners_only"] for u in d["units"]]
    shown = {
        int(unit)
        for step, data in steps
        if step == "query"
        for unit, visible in zip(data["units"], data["visible"], strict=True)
        if visible
    }
    maps = [set() for _ in range(lists_count)]
    one_by_one = lists_count == 1
    skipped = set()
    for place, unit in enumerate(lists["units"]):
        sure, number = lists["sure"][place], lists["list_of"][place]
        if number == OUTSIDE:
            continue
        under = set(each_tile(tiles.under[place]))
        parts = tiles.parts.tiles[slice(*tiles.parts.first[place : place + 2])]
        touched = {tile for part in parts for tile in each_tile(part)}
        assert touched <= under
        if sure or under - maps[0]:
            assert number == DRAW_NOW
            maps[0] |= touched
            skipped.add(int(unit))
            continue
        free = [m for m in range(1, lists_count) if under - maps[m]]
        assert number == (free[0] if free else lists_count)
        if free:
            maps[free[0]] |= under
        if one_by_one and int(unit) in shown:
            maps[0] |= touched
    drawn = [int(u) for step, data in steps if step == "draw" for u in data["units"]]
    assert len(asked) == len(set(asked))
    assert not skipped & {int(u) for u in asked}
    assert sorted(drawn) == sorted(skipped | shown)
    return skipped


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize("maps", [1, 5])
@pytest.mark.parametrize("scale", ["window", "scene"])
def test_query_is_skipped_if_and_only_if_a_tile_under_the_box_is_unset(maps, scale):
    culler = OccupancyMapCulling(maps=maps, scale=scale)
    saved = 0
    for seed in range(8):
        culler.prepare(crowd(seed, reach=(2.0, 2.0)))
        for camera in (perspective(150, 100), ortho(13, 12), perspective(300, 200)):
            steps = watch(culler)
            stats = culler.cull(camera).stats
            saved += len(check_contract(steps, maps))
            assert stats.tests_skipped is not None
            assert stats.batches <= 5 or maps == 1
    assert saved > 50
    culler.close()


class ForgetsToMark(StepwiseOccupancyMap):
    def mark_skipped(self, place, tiles):
        pass


class MarksInward(StepwiseOccupancyMap):
    def tiles_to_mark(self, tiles):
        return tiles + np.array([1, 1, -1, -1])


class AnyForAll(StepwiseOccupancyMap):
    def covered(self, number, tiles):
        return any(self.is_set(number, column, row) for column, row in each_tile(tiles))


class WrongStride(StepwiseOccupancyMap):
    def address(self, column, row):
        return row + column // 32, column % 32


class NeverClears(StepwiseOccupancyMap):
    def clear_maps(self):
        pass


class ArrangingMapNotMarked(StepwiseOccupancyMap):
    def mark_arranged(self, place, number, tiles):
        pass


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize(
    "broken",
    [ForgetsToMark, MarksInward, AnyForAll, WrongStride, NeverClears, ArrangingMapNotMarked],
)
def test_contract_check_sees_every_wasteful_step(broken):
    culler = broken()
    caught = 0
    for seed in range(4):
        culler.prepare(crowd(seed, reach=(4.0, 3.0), wall=False))
        camera = perspective(150, 100)
        culler.cull(camera)
        steps = watch(culler)
        culler.cull(camera)
        try:
            check_contract(steps, 5)
        except AssertionError:
            caught += 1
    culler.close()
    assert caught


@pytest.mark.gl
def test_map_saves_most_fragments_of_visible_boxes_where_little_is_hidden():
    scene = crowd(5, count=150, reach=(9.0, 6.0), wall=False)
    camera = perspective(320, 240)
    passed = {}
    for culler in (SingleQueryCulling(fragments=True), OccupancyMapCulling(maps=1, fragments=True)):
        culler.prepare(scene)
        result = culler.cull(camera)
        passed[culler.name] = result.stats.query_fragments_passed
        assert len(np.setdiff1d(visible_of(culler, scene, camera), result.unit_ids)) == 0
        culler.close()
    assert passed["occupancy-map"] < 0.5 * passed["occlusion-query"]


@pytest.mark.gl
@pytest.mark.parametrize("query", ["sync", "batch", "instanced"])
def test_corner_test_spares_the_box_whose_corner_shows_and_costs_the_one_whose_do_not(query):
    blade = ("blade", np.array([(-20, -20, -4), (20, 20, -4), (20, 19, -4)]), [(0, 1, 2)])
    wall = ("wall", *quad((-20, -20), (20, 20), -6.0))
    behind = ("behind", *box((0, 0, -8), 10.0))
    for front, without, with_corners in (
        (blade, (1, 1, 400), (1, 1, 8)),
        (wall, (1, 0, 400), (2, 0, 408)),
    ):
        scene = Scene.from_objects([front, (behind[0], behind[1] - (0, 0, 10), behind[2])])
        for corners, expected in ((False, without), (True, with_corners)):
            culler = OccupancyMapCulling(corners=corners, query=query, fragments=True)
            culler.prepare(scene)
            stats = culler.cull(ortho(64, 48)).stats
            assert (stats.queries, stats.queries_passed, stats.query_fragments) == expected
            culler.close()


@pytest.mark.gl
def test_scene_in_view_spreads_the_tiles_over_its_own_rectangle():
    scene = Scene.from_objects([("a", *box((2, 1, -5), 0.5))])
    culler = OccupancyMapCulling(scale="scene")
    culler.prepare(scene)
    camera = perspective(640, 480)
    view = View.of(camera, scene, device().subpixel_bits)
    whole = screen_rectangles(view, inflated(view, scene.bounds[None]))[0]
    assert culler.region(view) == tuple(whole)
    pose = np.eye(4)
    pose[:3, 3] = (2, 1, -5)  # the eye in the box, then the box cut by the window's edge
    for other in (
        Camera(pose, 640, 480, 0.1, yfov=1.0),
        Camera(np.eye(4), 640, 480, 0.1, yfov=0.5),
    ):
        region = culler.region(View.of(other, scene, device().subpixel_bits))
        assert region == (0, 0, 639, 479)
    culler.close()
    plain = OccupancyMapCulling()
    plain.prepare(scene)
    assert plain.region(view) == (0, 0, 639, 479)
    plain.close()


@pytest.mark.gl
def test_paper_window_has_tiles_of_48_pixels():
    scene = Scene.from_objects([("a", *quad((-99, -99), (99, 99), -5.0))])
    culler = OccupancyMapCulling()
    culler.prepare(scene)
    frame = culler.begin(perspective(1024, 768))
    rectangles = np.array([[0, 0, 7, 5], [8, 6, 8, 6], [0, 0, 1023, 767], [9, 9, 8, 9]], np.int32)
    grid = culler.tiles(frame, rectangles).grid
    assert grid == Grid(0, 0, 8, 6)
    tiles = tiles_under(rectangles, grid)
    assert tiles[:3].tolist() == [[0, 0, 0, 0], [1, 1, 1, 1], [0, 0, 127, 127]]
    assert each_tile(tiles[3]) == []
    culler.close()
