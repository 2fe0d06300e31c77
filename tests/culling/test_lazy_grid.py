"""The lazy occlusion grid: safe in every variant, as lazy as it says, its parts by brute force."""

import itertools
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.mutants.harness import Method, broken, watch
from tests.mutants.lazy_grid.contract import SUITE
from tests.mutants.lazy_grid.mutants import ALL
from tests.support.culling_scenes import box, ortho, perspective, quad, random_camera, random_scene
from visref.camera_path import CameraPath
from visref.conformance import assert_conforms, case
from visref.culler import QueryStats
from visref.engines.exact import ExactEngine
from visref.errors import InputError
from visref.judging.referee import Referee
from visref.scene import Alpha, Scene
from visref_culling.boxes.conservative import inflated, nearest_depth, needs_no_query
from visref_culling.boxes.hierarchy import BoxTree
from visref_culling.gl.device import device
from visref_culling.gl.view import View
from visref_culling.lazy_grid import LazyGridCulling
from visref_culling.lazy_grid.boxes import triangle_boxes
from visref_culling.lazy_grid.coverage import add_coverage
from visref_culling.lazy_grid.grid import DepthGrid, OcclusionGrid
from visref_culling.lazy_grid.nodes import (
    INNER,
    areas,
    clipped_corners,
    corners_of,
    nodes_in_view,
    pixel_bounds,
)
from visref_culling.queries.areas import Readback, RectangleQueries
from visref_culling.queries.software_depth import SoftwareBuffer

pytestmark = pytest.mark.gl

BUFFERS, UPDATES, QUERIES = ("occlusion", "z"), ("lazy", "busy"), ("readback", "software", "gl")
EVERY_WAY = [
    {"buffer": buffer, "update": update, "query": query}
    for buffer, update, query in itertools.product(BUFFERS, UPDATES, QUERIES)
]
EXTENSIONS = [
    {"probability": 0.7},
    {"whole": 0.5},
    {"large": 200},
    {"whole": 0.01, "large": 1, "probability": 3.0},
]


def make(**options):
    return LazyGridCulling(**{"cell": 8, **options})


def violations(scene, cameras, variants):
    """What the verdict on exact truth convicts, and units drawn, per variant."""
    cullers = [(str(options), make(**options)) for options in variants]
    outcome = Referee(scene, lambda: ExactEngine(scene)).run(
        CameraPath(tuple(cameras)), range(len(cameras)), cullers
    )
    assert not any(record.failed for record in outcome.cullers), outcome.findings
    return [(record.totals.violations, record.totals.drawn) for record in outcome.cullers]


@pytest.mark.slow
@settings(max_examples=12, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), size=st.sampled_from([(1, 1), (33, 17), (24, 24), (9, 40)]))
def test_no_variant_misses_anything_on_random_scenes(seed, size):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, objects=24)
    cameras = [random_camera(rng, *size) for _ in range(2)]
    variants = [dict(way) for way in EVERY_WAY]
    variants[seed % len(variants)] |= EXTENSIONS[seed % len(EXTENSIONS)]
    for k, way in enumerate(variants):
        way["boxes"] = ("objects", "triangles")[(seed + k) % 2]
        way["leaf"], way["depth"] = 3, (24, 32)[k % 2]
    assert [count for count, _ in violations(scene, cameras, variants)] == [0] * len(variants)


def crowd(seed, count=80):
    """A slanted wall with boxes before, behind and beside it; two cameras, one turned."""
    rng = np.random.default_rng(seed)
    wall, faces = quad((-3, -3), (3, 2.3), -5.0)
    wall[:, 2] += 0.3 * wall[:, 0]
    boxes = [
        (f"b{i}", *box(tuple(rng.uniform(-4, 4, 3) * (1, 1, 0.9) - (0, 0, 6)), size))
        for i, size in enumerate(rng.uniform(0.05, 0.5, count))
    ]
    return Scene.from_objects([("wall", wall, faces), *boxes])


@pytest.mark.slow
@pytest.mark.parametrize("buffer", BUFFERS)
@pytest.mark.parametrize("query", QUERIES)
def test_lazy_and_busy_draw_the_same_set_and_lazy_asks_less(buffer, query):
    asked = {"lazy": 0, "busy": 0}
    for seed in range(4):
        scene = crowd(seed) if seed else case("walk_through_a_city")[0]
        cameras = [perspective(75, 53)] if seed else list(case("walk_through_a_city")[1])[:2]
        drawn = {}
        for update in UPDATES:
            options = {"buffer": buffer, "query": query, "update": update, "cell": 8}
            drawn[update] = []
            for trace in watch(Method("lazy-grid", make, options, SUITE), scene, cameras):
                assert broken(SUITE, trace) == {}
                drawn[update].append(sorted(trace.drawn))
                asked[update] += trace.stats.queries
        assert drawn["lazy"] == drawn["busy"]
    assert 0 < asked["lazy"] < 0.6 * asked["busy"]


@pytest.mark.slow
@pytest.mark.parametrize("method", ALL, ids=str)
def test_busy_updates_conform(method):
    assert_conforms(lambda: LazyGridCulling(**{**method.options, "update": "busy"}))


@settings(max_examples=15, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10**6),
    buffer=st.sampled_from(BUFFERS),
    query=st.sampled_from(QUERIES),
    extension=st.sampled_from([{}, {"whole": 0.3}, {"large": 30}]),
    cell=st.integers(8, 40),
)
def test_lazy_and_busy_agree_on_random_scenes(seed, buffer, query, extension, cell):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, objects=40)
    cameras = [random_camera(rng, *rng.integers(1, 70, 2).tolist()) for _ in range(2)]
    drawn = []
    for update in UPDATES:
        options = {"buffer": buffer, "query": query, "update": update, "cell": cell}
        culler = make(**options, **extension)
        culler.prepare(scene)
        drawn.append([sorted(culler.cull(camera).unit_ids) for camera in cameras])
        culler.close()
    assert drawn[0] == drawn[1]


def test_every_way_of_asking_draws_about_the_same():
    scene = crowd(5)
    found = violations(scene, [perspective(75, 53)], EVERY_WAY)
    assert {count for count, _ in found} == {0}
    for buffer in BUFFERS:
        sizes = [n for (_, n), way in zip(found, EVERY_WAY, strict=True) if way["buffer"] == buffer]
        # Samples that GL and the software buffer see differently are few.
        assert max(sizes) <= min(sizes) + 3
        assert max(sizes) < 0.6 * scene.object_count


@pytest.mark.slow
@pytest.mark.parametrize("extension", EXTENSIONS, ids=str)
@pytest.mark.parametrize("buffer", BUFFERS)
def test_extensions_of_section_6_stay_safe(extension, buffer):
    scene, path = case("walk_through_a_city")
    variants = [{"buffer": buffer, "query": query, **extension} for query in QUERIES]
    assert [count for count, _ in violations(scene, path, variants)] == [0, 0, 0]


def totals(scene, cameras, **options):
    culler = make(**options)
    culler.prepare(scene)
    answers = [culler.cull(camera) for camera in cameras]
    culler.close()
    return (
        [sorted(answer.unit_ids.tolist()) for answer in answers],
        sum(answer.stats.queries for answer in answers),
    )


def test_probability_saves_queries_and_draws_for_it():
    scene, path = case("walk_through_a_city")
    drawn, asked = totals(scene, path)
    more, fewer = totals(scene, path, probability=1.5)
    assert fewer < asked
    assert sum(map(len, more)) > sum(map(len, drawn))


def test_whole_cell_queries_change_no_answer_and_find_full_cells():
    scene, path = case("walk_through_a_city")
    assert totals(scene, path)[0] == totals(scene, path, whole=0.3)[0]
    # Covered from one side by a wall, then asked in part again and again.
    wall = ("wall", *quad((-32, -24), (32, 24), -5.0))
    parts = [(f"p{k}", *quad((-31, -23), (-25.4, -17.4), -9.0 - k)) for k in range(20)]
    scene = Scene.from_objects([wall, *parts])
    _, asked = totals(scene, [ortho(64, 48)])
    _, whole = totals(scene, [ortho(64, 48)], whole=0.3)
    assert whole < asked


def test_large_boxes_are_asked_in_whole_cells():
    """A box behind a horizon that cuts its border cells: hidden, unless it counts as large."""
    hill = ("hill", *quad((-32, -24), (32, 5), -5.0))
    house = ("house", *quad((-10, -6), (10, 4), -9.0))
    scene = Scene.from_objects([hill, house])
    for buffer in BUFFERS:
        assert totals(scene, [ortho(64, 48)], buffer=buffer)[0] == [[0]]
        assert totals(scene, [ortho(64, 48)], buffer=buffer, large=100)[0] == [[0, 1]]


def test_hidden_behind_a_horizon_in_every_way():
    hill = ("hill", *quad((-40, -40), (40, 5), -5.0))
    houses = [(f"h{k}", *quad((-30 + 6 * k, -6), (-26 + 6 * k, 4), -9.0 - k)) for k in range(9)]
    tower = ("tower", *quad((-3, -6), (3, 7), -30.0))
    scene = Scene.from_objects([hill, *houses, tower])
    for way in EVERY_WAY:
        assert totals(scene, [ortho(64, 48)], **way)[0] == [[0, 10]]


def test_no_update_draws_what_meets_the_frustum():
    scene = Scene.from_objects(
        [
            ("wall", *quad((-9, -9), (9, 9), -5)),
            ("behind", *quad((-1, -1), (1, 1), -7)),
            ("beside", *quad((100, -1), (102, 1), -7)),
        ]
    )
    assert totals(scene, [ortho(16, 16)], update="none") == ([[0, 1]], 0)
    assert totals(scene, [ortho(16, 16)]) == ([[0]], 1 + 3)


def test_nothing_in_view_and_nothing_at_all():
    scene = Scene.from_objects([("o", *quad((0, 0), (1, 1), 50.0))])
    for way in EVERY_WAY:
        assert totals(scene, [ortho(16, 16)], **way) == ([[]], 0)
        assert totals(Scene.from_objects([]), [ortho(16, 16)], **way) == ([[]], 0)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"cell": 7}, "cell is 7"),
        ({"cell": 65}, "cell is 65"),
        ({"leaf": 0}, "leaf is 0"),
        ({"whole": 1.5}, "whole is 1.5"),
        ({"probability": -0.1}, "probability is -0.1"),
        ({"large": -1}, "large is -1"),
    ],
)
def test_option_out_of_range_is_one_clear_line(options, line):
    with pytest.raises(InputError, match=line):
        LazyGridCulling(**options)


def test_counted_fragments_are_the_queried_areas_and_the_drawn_triangles():
    wall, poster = ("wall", *quad((-8, -8), (8, 8), -5)), ("poster", *quad((-4, -4), (4, 4), -7))
    scene = Scene.from_objects([wall, poster])
    for buffer in BUFFERS:
        culler = make(buffer=buffer, query="gl", fragments=True)
        culler.prepare(scene)
        stats = culler.cull(ortho(32, 32)).stats
        culler.close()
        # The poster's 8 by 8 pixels fall into four cells; the wall is 16 by 16.
        assert (stats.queries, stats.query_fragments) == (4, 64)
        assert stats.depth_tests == 64 + 256


# The hierarchy's leaves.


@settings(max_examples=40, deadline=None, derandomize=True)
@given(count=st.integers(0, 300), limit=st.integers(1, 40), seed=st.integers(0, 99))
def test_leaves_hold_every_triangle_once_in_as_few_boxes_as_the_limit_allows(count, limit, seed):
    rng = np.random.default_rng(seed)
    # Few values, so that many centroids are equal.
    points = rng.integers(0, 4, (max(1, 3 * count), 3)).astype(np.float32)
    scene = Scene.from_objects([("o", points, np.arange(3 * count).reshape(-1, 3))])
    units = triangle_boxes(scene, limit)
    assert np.array_equal(np.sort(units.triangles), np.arange(count))
    assert units.count == -(-count // limit)
    assert units.sizes.max(initial=0) <= limit
    assert units.sizes.max(initial=0) - units.sizes.min(initial=limit) <= limit / 2 + 1


def test_leaves_are_compact():
    grid = np.stack(np.meshgrid(*[np.arange(32.0)] * 2), axis=-1).reshape(-1, 2)
    order = np.random.default_rng(3).permutation(len(grid))
    points = np.zeros((3 * len(grid), 3))
    points[:, :2] = np.repeat(grid[order], 3, axis=0) + np.tile([(0, 0), (1, 0), (0, 1)], (1024, 1))
    scene = Scene.from_objects([("o", points, np.arange(len(points)).reshape(-1, 3))])
    bounds = scene.bounds_of(triangle_boxes(scene, 16))
    # 64 boxes of 4 by 4 squares.
    assert (bounds[:, 1, :2] - bounds[:, 0, :2]).max() <= 5.0


# Nodes in the view, and their pixels.


@pytest.mark.parametrize("seed", range(4))
def test_nodes_lead_to_every_unit_in_the_view_through_boxes_that_hold_it(seed):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, objects=150)
    tree = BoxTree(scene.object_bounds)
    view = View.of(random_camera(rng, 32, 24), scene, 8)
    nodes = nodes_in_view(tree, view)
    leaves = nodes.unit != INNER
    assert np.array_equal(np.sort(nodes.unit[leaves]), tree.in_frustum(view))
    reached = {0} if len(leaves) else set()
    for node in range(len(leaves)):
        children = range(nodes.first_child[node], nodes.first_child[node] + nodes.children[node])
        assert not (leaves[node] and len(children))
        reached |= set(children)
        for child in children:
            assert (nodes.boxes[child, 0] >= nodes.boxes[node, 0]).all()
            assert (nodes.boxes[child, 1] <= nodes.boxes[node, 1]).all()
    assert reached == set(range(len(leaves)))


def test_area_of_a_box_is_the_samples_that_it_covers():
    scene = Scene.from_objects([("o", *quad((-4.4, -2.0), (3.5, 1.2), -5.0))])
    view = View.of(ortho(16, 12), scene, 8)
    boxes = inflated(view, scene.object_bounds)
    found = areas(*pixel_bounds(view, corners_of(boxes)), 16, 12)
    # Samples lie at x = -7.5, -6.5, ...: from -3.5 to 3.5, whose edge is just touched, and
    # y from 0.5 down to -1.5.
    assert found.tolist() == [[4, 5, 12, 8]]


@pytest.mark.parametrize("seed", range(6))
def test_area_holds_every_pixel_that_the_object_gets_from_the_rasteriser(seed):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng)
    culler = make()
    culler.prepare(scene)
    for _ in range(3):
        view = View.of(random_camera(rng, 41, 29), scene, device().subpixel_bits)
        boxes = inflated(view, scene.object_bounds)
        corners = corners_of(boxes)
        beyond = (corners @ view.depth_row).max(axis=1) >= view.camera.near
        crossing = needs_no_query(view, boxes)
        points = np.where(
            crossing[:, None, None],
            clipped_corners(view, boxes),
            np.concatenate([corners, corners, corners[:, :4]], axis=1),
        )
        found = areas(*pixel_bounds(view, points[beyond]), 41, 29)
        for unit, (x0, y0, x1, y1) in zip(np.flatnonzero(beyond), found, strict=True):
            alone = np.zeros(scene.triangle_count, bool)
            alone[slice(*scene.object_offsets[unit : unit + 2])] = True
            ys, xs = np.nonzero(culler.raster.image(view.camera, alone) >= 0)
            assert ((xs >= x0) & (xs < x1) & (ys >= y0) & (ys < y1)).all()
    culler.close()


def test_box_across_the_near_plane_gets_the_area_of_what_lies_beyond_it():
    scene = Scene.from_objects([("floor", *box((0.0, -3.0, 0.0), (50.0, 1.0, 50.0)))])
    view = View.of(perspective(32, 24), scene, 8)
    boxes = inflated(view, scene.object_bounds)
    assert needs_no_query(view, boxes).all()
    # Its upper edge 50 away is at y = -2 / 50: just below the middle row.
    found = areas(*pixel_bounds(view, clipped_corners(view, boxes)), 32, 24)
    assert found.tolist() == [[0, 12, 32, 24]]


# The grid.


@pytest.mark.slow
@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    width=st.integers(1, 40),
    height=st.integers(1, 40),
    cell=st.integers(1, 17),
    corners=st.tuples(*[st.floats(0, 1)] * 4),
    all_internal=st.booleans(),
)
def test_cells_of_a_box_are_border_or_internal_by_their_pixels(
    width, height, cell, corners, all_internal
):
    (x0, x1), (y0, y1) = (
        sorted((int(a * side), int(b * side)))
        for a, b, side in zip(corners[:2], corners[2:], (width - 1, height - 1), strict=True)
    )
    area = (x0, y0, x1 + 1, y1 + 1)
    grid = OcclusionGrid(width, height, cell, 0.0)
    inside = np.zeros((height, width), bool)
    inside[y0 : y1 + 1, x0 : x1 + 1] = True
    grid.mark((0, 0, width, height))
    free, internal, border = grid.scan(grid.spans(area, all_internal), 0.0)
    assert not free
    kinds = {tuple(c): "internal" for c in internal.tolist()}
    kinds |= {tuple(c): "border" for c in border.tolist()}
    assert len(kinds) == len(internal) + len(border)
    for row in range(-(-height // cell)):
        for column in range(-(-width // cell)):
            left, top, right, bottom = grid.area((column, row))
            pixels = inside[top:bottom, left:right]
            assert pixels.size
            whole = pixels.all() or (all_internal and pixels.any())
            expected = "internal" if whole else "border" if pixels.any() else None
            assert kinds.get((column, row)) == expected


def test_scan_tells_what_the_states_tell():
    grid = OcclusionGrid(32, 8, 8, 0.0)
    everything = grid.spans((0, 0, 32, 8), False)
    assert grid.scan(everything, 0.0)[0]
    grid.mark((0, 0, 32, 8))
    for column in range(4):
        grid.set((column, 0), full=True)
    free, internal, border = grid.scan(everything, 0.0)
    assert (free, len(internal), len(border)) == (False, 0, 0)
    # Full overrides outdated; free in part shows an internal cell and not a border cell.
    grid.mark((0, 0, 32, 8))
    assert grid.scan(everything, 0.0)[0] is False
    grid.set((1, 0), full=False)
    assert grid.scan(everything, 0.0)[0]
    free, internal, border = grid.scan(grid.spans((9, 0, 32, 8), False), 0.0)
    assert (free, internal.tolist(), border.tolist()) == (False, [], [[1, 0]])


def test_depths_between_the_bounds_are_asked_and_all_others_known():
    grid = DepthGrid(8, 8, 8, 0.0, 1.0)
    whole, part = grid.spans((0, 0, 8, 8), False), grid.spans((0, 0, 7, 8), False)
    assert grid.scan(whole, 0.3)[0]
    assert grid.scan(part, 0.3)[0]
    grid.mark((3, 3, 4, 4))
    assert len(grid.scan(whole, 0.3)[1]) == 1
    grid.learn((0, 0), 0.4, 0.6)
    assert grid.scan(whole, 0.4)[0]
    assert len(grid.scan(whole, 0.5)[1]) == 1
    assert [len(cells) for cells in grid.scan(whole, 0.61)[1:]] == [0, 0]
    # What is reached in a cell need not be reached in a part of it.
    assert len(grid.scan(part, 0.3)[2]) == 1
    # The farther bound outlives a draw, the nearer does not.
    grid.mark((0, 0, 1, 1))
    assert len(grid.scan(whole, 0.4)[1]) == 1
    assert [len(cells) for cells in grid.scan(whole, 0.61)[1:]] == [0, 0]


def test_untouched_background_shows_a_border_cell_and_touched_background_is_asked():
    grid = DepthGrid(16, 8, 8, 0.0, 1.0)
    part = grid.spans((1, 0, 8, 8), False)
    assert grid.scan(part, 0.5)[0]
    grid.mark((0, 0, 1, 1))
    assert not grid.scan(part, 0.5)[0]
    grid.learn((0, 0), 1.0, 1.0)
    assert not grid.scan(part, 0.5)[0]


# Ways of asking.


def test_rectangle_query_and_readback_agree_on_every_area_and_depth():
    rng = np.random.default_rng(11)
    for bits in (24, 32):
        scene = crowd(7, 30)
        culler = LazyGridCulling(depth=bits, update="none")
        culler.prepare(scene)
        camera = perspective(45, 31)
        culler.cull(camera)
        view, target, stats = culler.view_of(camera), culler.target_for(camera), QueryStats()
        by_pixel = Readback()
        by_query = RectangleQueries(device(), lambda state: state, lambda samples: samples > 0)
        for way in (by_pixel, by_query):
            way.begin(view, target, stats)
        whole = target.read_depth()
        for _ in range(60):
            x, y = (np.sort(rng.integers(0, side + 1, 2)) for side in (45, 31))
            area = (int(x[0]), int(y[0]), int(x[1]) + (x[0] == x[1]), int(y[1]) + (y[0] == y[1]))
            if area[2] > 45 or area[3] > 31:
                continue
            inside = whole[area[1] : area[3], area[0] : area[2]]
            assert by_pixel.any_free(area) == by_query.any_free(area) == (inside.max() == 1.0)
            for depth in (*rng.uniform(0.5, 1.0, 3), 1.0):
                farthest = by_pixel.reach(area, depth)
                assert farthest == (inside.max(), inside.max())
                # Away from the step at which the rasteriser rounds the rectangle's depth.
                if abs(depth - inside.max()) > 2.0**-23:
                    reached, below = by_query.reach(area, depth)
                    assert (depth <= reached) == (depth <= inside.max())
                    assert reached <= inside.max()
                    assert below >= inside.max()
        by_query.release()
        culler.close()


def test_depth_of_a_box_is_never_behind_what_the_rasteriser_stores():
    rng = np.random.default_rng(4)
    for _ in range(12):
        scene = random_scene(rng, objects=6)
        for bits in (24, 32):
            culler = LazyGridCulling(depth=bits)
            culler.prepare(scene)
            camera = random_camera(rng, 32, 24)
            view, target, stats = culler.view_of(camera), culler.target_for(camera), QueryStats()
            culler.areas.begin(view, target, stats)
            boxes = inflated(view, culler.unit_boxes)
            for unit in np.flatnonzero(~needs_no_query(view, boxes)):
                culler.clear(target, stats)
                culler.geometry.draw(view, target, np.array([unit]), stats)
                depth = culler.areas.depth_of(nearest_depth(view, boxes[[unit]]))[0]
                assert depth <= target.read_depth().min()
            culler.close()


def software(scene, camera, units=None, *, marks_only=False, occludes=None):
    opaque = np.ones(scene.triangle_count, bool) if occludes is None else occludes
    buffer = SoftwareBuffer(scene, scene.object_units(), opaque, marks_only=marks_only)
    buffer.begin(View.of(camera, scene, 8), None, QueryStats())
    buffer.drawn(np.arange(scene.object_count) if units is None else units)
    return buffer.depth


@pytest.mark.parametrize("seed", range(8))
def test_software_buffer_is_never_nearer_than_the_exact_depth(seed):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng)
    if seed % 2:
        sided = rng.random(scene.triangle_count) < 0.5
        scene = Scene(scene.vertices, scene.triangles, scene.object_offsets, scene.names, sided)
    engine = ExactEngine(scene)
    filled = owned = 0
    for _ in range(4):
        camera = random_camera(rng, 40, 30)
        truth = engine.frame(camera).buffer
        depth, marks = software(scene, camera), software(scene, camera, marks_only=True)
        assert (depth >= truth.depth).all()
        assert np.array_equal(marks == 0.0, np.isfinite(depth))
        filled += np.isfinite(depth).sum()
        owned += (truth.triangle >= 0).sum()
        both = np.isfinite(depth)
        assert np.allclose(depth[both], truth.depth[both], rtol=1e-3)
    assert filled > 0.999 * owned > 0


def test_software_buffer_fills_a_wall_up_to_the_samples_on_its_edges():
    camera = ortho(16, 12)
    scene = Scene.from_objects([("o", *quad((-4.2, -3.3), (4.1, 3.2), -5.0))])
    depth = software(scene, camera)
    # Columns -3.5 ... 3.5 and rows 2.5 ... -2.5; samples on the diagonal are in doubt.
    expected = np.zeros((12, 16), bool)
    expected[3:9, 4:12] = True
    assert (np.isfinite(depth) <= expected).all()
    assert np.count_nonzero(np.isfinite(depth)) >= 6 * 8 - 8
    assert 5.0 <= depth.min() <= np.nextafter(np.float32(5.0), np.float32(6.0))


def test_software_buffer_takes_no_glass_and_no_back_faces():
    camera = ortho(16, 12)
    front = ("front", *quad((-4.2, -3.3), (4.1, 3.2), -5.0))
    back = ("back", quad((-4.2, -3.3), (4.1, 3.2), -4.0)[0], quad((0, 0), (1, 1), 0)[1][:, ::-1])
    scene = Scene.from_objects([front, back])
    sided = Scene(
        scene.vertices, scene.triangles, scene.object_offsets, scene.names, np.ones(4, bool)
    )
    glass = np.array([1, 1, 0, 0], bool)
    found = (
        software(scene, camera),
        software(sided, camera),
        software(scene, camera, occludes=glass),
    )
    assert [round(float(depth.min()), 5) for depth in found] == [4.0, 5.0, 5.0]


def test_software_buffer_fills_what_crosses_the_near_plane():
    ground = np.array([[-50, -1, 50], [50, -1, 50], [50, -1, -50], [-50, -1, -50]], float)
    scene = Scene.from_objects([("ground", ground, quad((0, 0), (1, 1), 0)[1])])
    camera = perspective(32, 24)
    depth = software(scene, camera)
    truth = ExactEngine(scene).frame(camera).buffer
    assert np.count_nonzero(np.isfinite(depth)) > 0.95 * np.count_nonzero(truth.triangle >= 0) > 0
    assert (depth >= truth.depth).all()


def test_software_buffer_convicts_nothing_without_a_rasterisers_tolerance():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        scene = random_scene(rng, objects=40)
        engine = ExactEngine(scene)
        for buffer in BUFFERS:
            culler = make(query="software", buffer=buffer)
            culler.prepare(scene)
            for _ in range(2):
                camera = random_camera(rng, 40, 30)
                drawn = culler.cull(camera).unit_ids
                owners = engine.frame(camera).buffer.triangle
                visible = np.unique(scene.object_of_triangle[owners[owners >= 0]])
                assert set(visible.tolist()) <= set(drawn.tolist())
            culler.close()


def test_coverage_adds_the_areas_of_triangles_to_their_cells():
    camera = ortho(32, 16)
    scene = Scene.from_objects(
        [
            ("half", *quad((-16, -8), (0, 8), -5.0)),
            ("small", *quad((-16, 0), (-12, 4), -6.0)),
            ("glass", *quad((0, -8), (16, 8), -5.0)),
        ]
    )
    scene = Scene(
        scene.vertices,
        scene.triangles,
        scene.object_offsets,
        scene.names,
        alpha=np.array([0, 0, 0, 0, Alpha.BLEND, Alpha.BLEND], np.uint8),
    )
    grid = OcclusionGrid(32, 16, 16, 0.5)
    opaque = scene.alpha == Alpha.OPAQUE
    add = partial(add_coverage, grid, View.of(camera, scene, 8), scene, scene.object_units())
    add(opaque, 0)
    assert grid.covered == pytest.approx(np.array([[1.0, 0.0]]))
    add(opaque, 1)
    assert grid.covered == pytest.approx(np.array([[1.0 + 16 / 256, 0.0]]))
    add(opaque, 2)
    assert grid.covered == pytest.approx(np.array([[1.0 + 16 / 256, 0.0]]))
