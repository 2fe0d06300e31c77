"""PLP and cPLP: octree by brute force, ways of asking that agree, a picture that is whole."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.culling_scenes import box, perspective, quad, random_camera, random_scene
from tests.support.shares import share
from visref.camera import Camera, look_at
from visref.conformance import assert_conforms, conformance_checks
from visref.culler import Promise, QueryStats
from visref.engines import make_engine
from visref.errors import InputError
from visref.findings import Code
from visref.judging.referee import Referee
from visref.judging.status import Exit
from visref.registry import make_culler
from visref.scene import Scene
from visref_culling.boxes.conservative import inflated, round_outward
from visref_culling.gl.device import State, device
from visref_culling.gl.view import View
from visref_culling.plp import ConservativePLPCulling, PLPCulling
from visref_culling.plp.octree import MAX_GROWTH, STEPS, build, octree_of
from visref_culling.plp.solidity import by_area, by_count
from visref_culling.queries.histogram import HistogramQueries
from visref_culling.queries.item_buffer_query import ItemBufferQueries, runs
from visref_culling.queries.occlusion_query import BoxQueries
from visref_datasets_gen import scene_of
from visref_datasets_gen.skyscraper import skyscraper
from visref_datasets_gen.soda_hall import soda_hall

pytestmark = pytest.mark.slow

EMPTY = Scene.from_objects([])
OPTIONS = [
    {"query": "fragment-histogram"},
    {"query": "occlusion-query", "backfaces": True},
    {"query": "item-buffer"},
    {"query": "histogram", "depth": 32},
    {"query": "item-buffer", "image": "restore"},
    {"query": "histogram", "image": "restore"},
    {"order": "front-to-back"},
    {"solidity": "count"},
]


def crowd(seed: int = 0, count: int = 80) -> Scene:
    """Boxes before and behind a wall."""
    rng = np.random.default_rng(seed)
    objects = [("wall", *quad((-3, -3), (3, 3), -6.0))]
    objects += [
        (f"b{k}", *box(tuple(rng.uniform((-5, -4, -14), (5, 4, -2))), 0.2)) for k in range(count)
    ]
    return Scene.from_objects(objects)


# The octree.


@pytest.mark.slow
@settings(deadline=None, max_examples=15)  # the first call compiles
@given(st.integers(0, 10**6), st.integers(2, 30))
def test_octree_tiles_its_root_and_holds_each_triangle_wherever_it_passes(seed, limit):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng)
    octree = build(scene, limit)
    assert (octree.width**3 / STEPS**3).sum() == 1.0
    points = rng.integers(0, STEPS, (200, 3))
    leaf = octree.locate(points)
    assert (points >= octree.corner[leaf]).all()
    assert (points < octree.corner[leaf] + octree.width[leaf, None]).all()
    # Every cell of the grid is in one leaf only: volumes sum to the root's and none is missed.
    corners = scene.vertices.astype(float)[scene.triangles]
    weights = rng.dirichlet((0.5, 0.5, 0.5), 20)
    held = [
        set(part.tolist()) for part in np.split(octree.units.triangles, octree.units.offsets[1:-1])
    ]
    for triangle in range(scene.triangle_count):
        for point in [*(weights @ corners[triangle]), *corners[triangle]]:
            inside = ((point >= octree.bounds[:, 0]) & (point <= octree.bounds[:, 1])).all(axis=1)
            assert all(triangle in held[cell] for cell in np.flatnonzero(inside))


def test_a_scenes_octree_is_built_once_for_each_limit_and_nobody_can_change_it():
    scene, other = crowd(1), crowd(1)
    made = octree_of(scene, 12)
    assert octree_of(scene, 12) is made
    assert octree_of(scene, 20) is not made
    assert octree_of(other, 12) is not made
    assert np.array_equal(octree_of(other, 12).bounds, made.bounds)
    for array in (made.bounds, made.corner, made.width, made.children):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


@pytest.mark.parametrize("limit", [3, 12])
def test_links_are_the_pairs_of_leaves_that_share_a_face(limit):
    octree = build(random_scene(np.random.default_rng(limit), 12), limit)
    links = octree.links()
    start = np.repeat(np.arange(octree.leaf_count), np.diff(links.offsets))
    found = set(zip(start.tolist(), links.to.tolist(), strict=True))
    low, high = octree.corner, octree.corner + octree.width[:, None]
    expected = set()
    for i in range(octree.leaf_count):
        common = np.minimum(high, high[i]) - np.maximum(low, low[i])
        touches = (common >= 0).all(axis=1) & ((common == 0).sum(axis=1) == 1)
        expected |= {(i, int(j)) for j in np.flatnonzero(touches)}
    assert found == expected
    assert len({int(octree.width[i]) for i, _ in found}) > 2
    for k in range(len(start)):
        a, b, axis = octree.bounds[start[k]], octree.bounds[links.to[k]], links.axis[k]
        assert a[1, axis] == b[0, axis] or b[1, axis] == a[0, axis]


@pytest.mark.slow
def test_leaves_are_below_the_limit_unless_halving_tells_nothing_apart():
    scene = scene_of(soda_hall(scale=0.2, frames=1))
    octree = build(scene, 500)
    assert octree.units.sizes.max() < 500
    assert octree.units.sizes.sum() < 2 * scene.triangle_count
    pile = Scene.from_objects([(f"o{k}", *quad((-1, -1), (1, 1), 0.0)) for k in range(50)])
    octree = build(pile, 10)
    assert octree.units.sizes.sum() <= 8 * MAX_GROWTH * pile.triangle_count
    assert octree.leaf_count > 8


@pytest.mark.parametrize(
    "points", [np.zeros((0, 3)), np.zeros((3, 3)), np.eye(3) * 3e38, -np.eye(3) * 1e-44]
)
def test_octree_of_next_to_nothing_and_of_everything(points):
    scene = Scene.from_objects([("o", points, np.arange(len(points)).reshape(-1, 3))])
    octree = build(scene, 2)
    assert set(octree.units.triangles.tolist()) == set(range(scene.triangle_count))
    assert (octree.bounds[:, 0] < octree.bounds[:, 1]).all()


# Solidity.


def test_wall_across_a_cell_is_one_thing_in_the_way_and_none_along_it():
    """Root (0, 0, 0) to (4, 4, 4), eight leaves of side 2. A sheet of two triangles is half a
    thing: one surface, where a wall has two."""
    ends = [(f"end{x}", np.full((3, 3), x), np.array([[0, 1, 2]])) for x in (0.0, 4.0)]
    scene = Scene.from_objects([("sheet", *quad((0.0, 0.0), (4.0, 3.0), 1.0)), *ends])
    octree = build(scene, 4)
    found = by_area(scene, octree)
    near = octree.bounds[:, 0, 2] == 0.0
    high = octree.bounds[:, 0, 1] == 2.0
    assert octree.leaf_count == 8
    assert found[:, :2].max() == 0.0
    # Where an edge is cut rounds a few times, by 2**-53 each.
    assert np.allclose(found[:, 2], np.where(near, np.where(high, 0.25, 0.5), 0.0), rtol=2.0**-50)


def test_solidity_by_count_is_the_share_of_the_fullest_cell():
    octree = build(crowd(1), 12)
    found = by_count(octree)
    sizes = octree.units.sizes
    assert found.max() == 1.0
    assert found[sizes == 0].tolist() == [0.0] * int((sizes == 0).sum())
    assert np.array_equal(np.rint(found * sizes.max()), sizes)
    assert by_count(build(EMPTY, 2)).tolist() == [0.0]


@pytest.mark.gl
@pytest.mark.parametrize(("way", "first"), [("area", "bush"), ("count", "wall")])
def test_by_area_a_wall_hides_more_and_by_count_a_bush(way, first):
    """Eight cells of side 2; the eye is between the near two, with a wall in one and a bush of 40
    small triangles in the other. What stands behind the one that hides less comes first."""
    rng = np.random.default_rng(0)
    twigs = rng.uniform((2.3, 0.3, 2.3), (3.7, 1.7, 3.7), (40, 1, 3)) + 0.05 * rng.random(
        (40, 3, 3)
    )
    ends = [(f"end{k}", np.full((3, 3), k), np.array([[0, 1, 2]])) for k in (0.0, 4.0)]
    scene = Scene.from_objects(
        [
            ("wall", *quad((0.0, 0.0), (1.9, 1.9), 2.5)),
            ("bush", twigs.reshape(-1, 3), np.arange(120).reshape(-1, 3)),
            ("behind the wall", *box((1.0, 1.0, 1.0), 0.2)),
            ("behind the bush", *box((3.0, 1.0, 1.0), 0.2)),
            *ends,
        ]
    )
    pose = look_at((2.0, 1.0, 3.9), (2.0, 1.0, 0.0))
    camera = Camera(pose, 64, 64, near=0.05, far=20.0, yfov=1.5)
    culler = PLPCulling(leaf=41, budget=10**6, solidity=way)
    units = culler.prepare(scene)
    drawn = culler.cull(camera).unit_ids.tolist()
    at = [
        next(
            i for i, u in enumerate(drawn) if scene.object_offsets[k] in units.gather(np.array([u]))
        )
        for k in (2, 3)
    ]
    culler.close()
    assert units.count == 8
    assert (at[0] < at[1]) == (first == "wall")


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 10**6), st.integers(2, 30))
def test_cells_share_a_triangles_area_among_them(seed, limit):
    """What lies in no common face is in one cell only: the projected areas add up."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-5.0, 5.0, (40, 3, 3))
    scene = Scene.from_objects([("o", points.reshape(-1, 3), np.arange(120).reshape(-1, 3))])
    octree = build(scene, limit)
    width = np.diff(octree.bounds, axis=1)[:, 0, :1]
    p = scene.vertices.astype(float)[scene.triangles]
    whole = np.abs(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])).sum(axis=0) / 2.0
    # Half a thing a surface; float64 rounds each of some thousand terms by 2**-53 a few times.
    assert np.allclose(2.0 * (by_area(scene, octree) * width**2).sum(axis=0), whole, rtol=2.0**-38)


# Asking.


def ways(view, target, boxes, **how):
    """The samples of each way of asking about the same boxes."""
    gl = device()
    hardware = BoxQueries(gl)
    found = {
        way: hardware.ask(view, target, boxes, QueryStats(), way=way, **how)
        for way in ("sync", "batch", "instanced", "counted")
    }
    hardware.release()
    for name, kind in (("item-buffer", ItemBufferQueries), ("histogram", HistogramQueries)):
        items = kind(gl)
        items.begin(view.camera.width, view.camera.height)
        stats = QueryStats()
        found[name] = items.ask(view, target.scratch, boxes, stats, whole_front=False, **how)
        assert stats.queries == len(boxes)
        assert stats.batches == len(items.passes)
        items.release()
    return found


@pytest.mark.gl
@pytest.mark.parametrize("count", [1, 20, 255, 256, 300])
@pytest.mark.parametrize("size", [(33, 17), (150, 130)])
def test_all_ways_of_asking_find_the_same_boxes(count, size):
    rng = np.random.default_rng(count)
    camera = perspective(*size)
    scene = crowd(count)
    culler = ConservativePLPCulling(order="frustum")
    culler.prepare(scene)
    target = device().target(*size, channels=4)
    culler.geometry.begin()
    device().clear(State(target.framebuffer, culler.geometry.program))
    culler.geometry.draw(
        culler.view_of(camera), target, np.arange(culler.units.count), QueryStats()
    )
    depth = target.read_depth().copy()
    centres = rng.uniform((-4, -4, -12), (4, 4, -3), (count, 3))
    bounds = centres[:, None] + np.array([-1.0, 1.0])[:, None] * rng.uniform(
        0.05, 1.0, (count, 1, 1)
    )
    view = View.of(camera, scene, 8)
    boxes = round_outward(inflated(view, bounds))
    found = ways(view, target, boxes, cull_back_faces=True)
    assert np.array_equal(target.read_depth(), depth)
    visible = found["sync"] > 0
    assert count < 20 or 0 < visible.sum() < count
    for samples in found.values():
        assert np.array_equal(samples > 0, visible)
    assert np.array_equal(found["sync"], found["counted"])
    assert np.array_equal(found["item-buffer"], found["histogram"])
    culler.close()


class WrappedIds(ItemBufferQueries):
    def channels(self, count):
        return 1


@pytest.mark.gl
def test_differential_sees_ids_that_wrap_at_256():
    """The 256th of 256 boxes, alone in view, has the background's byte."""
    camera = perspective(64, 64)
    view, target = View.of(camera, EMPTY, 8), device().target(64, 64, channels=4)
    bounds = np.repeat([[(50.0, 50.0, -5.0), (51.0, 51.0, -4.0)]], 256, axis=0)
    bounds[255] = (-1.0, -1.0, -5.0), (1.0, 1.0, -4.0)
    boxes = round_outward(inflated(view, bounds))
    found = {}
    for kind in (ItemBufferQueries, WrappedIds):
        items = kind(device())
        device().clear(State(target.framebuffer, items.program))
        items.begin(64, 64)
        samples = items.ask(
            view, target.scratch, boxes, QueryStats(), whole_front=True, cull_back_faces=True
        )
        found[kind] = np.flatnonzero(samples).tolist()
        items.release()
    assert found == {ItemBufferQueries: [255], WrappedIds: []}


@pytest.mark.gl
def test_item_buffer_reads_active_tiles_and_one_channel_while_ids_fit_a_byte():
    camera = perspective(200, 130)
    view, target = View.of(camera, EMPTY, 8), device().target(200, 130, channels=4)
    items = ItemBufferQueries(device())
    device().clear(State(target.framebuffer, items.program))
    # At depth 4 a pixel is 8 / 130 wide: a box just below the image's middle, in one tile.
    bounds = np.array([[(-0.3, -0.9, -4.2), (0.3, -0.4, -4.0)]])
    read = []
    items.begin(200, 130)
    for count in (1, 256, 1):
        stats = QueryStats()
        boxes = round_outward(inflated(view, np.repeat(bounds, count, axis=0)))
        items.ask(view, target.scratch, boxes, stats, whole_front=True, cull_back_faces=True)
        read.append(stats.bytes_read_back)
    tile = 64 * 64
    assert items.active.shape == (3, 4)
    assert items.active.sum() == 1
    # One box: the whole image, and no second pass for nobody. Then the one tile left, in as
    # many passes as boxes lie on each other, four bytes while there are more than 255.
    assert read == [200 * 130, tile * (4 + 255), tile]
    items.release()


def test_runs_of_tiles():
    assert runs(np.array([[1, 1, 0, 1], [0, 0, 0, 0], [1, 1, 1, 1]], bool)) == [
        (0, 0, 2),
        (0, 3, 4),
        (2, 0, 4),
    ]


# Safety.


def assert_whole_picture(culler, scene, camera) -> int:
    """The drawn set makes the unculled picture, each triangle drawn once; returns how many
    triangles were spared."""
    answer = culler.cull(camera)
    drawn = culler.units.mask(answer.unit_ids, scene.triangle_count)
    whole = culler.raster.image(camera, np.ones(scene.triangle_count, bool)).copy()
    assert np.array_equal(culler.raster.image(camera, drawn), whole)
    assert answer.stats.triangles_drawn == drawn.sum()
    return scene.triangle_count - int(drawn.sum())


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_picture_is_whole_from_anywhere(options):
    spared = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        scene = random_scene(rng) if seed % 2 else crowd(seed)
        culler = ConservativePLPCulling(
            leaf=(3, 12)[seed % 2], budget=(0, 30)[seed // 2], **options
        )
        culler.prepare(scene)
        for _ in range(3):
            size = [(1, 1), (1, 200), (33, 17), (150, 130)][seed % 4]
            spared += assert_whole_picture(culler, scene, random_camera(rng, *size))
        culler.close()
    assert spared > 200


@pytest.mark.slow
@pytest.mark.gl
@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10**9), st.sampled_from(OPTIONS), st.integers(2, 20), st.integers(0, 60))
def test_picture_is_whole_for_any_scene_cells_and_budget(seed, options, leaf, budget):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, 12)
    culler = ConservativePLPCulling(leaf=leaf, budget=budget, **options)
    culler.prepare(scene)
    assert_whole_picture(culler, scene, random_camera(rng, 70, 50))
    culler.close()


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize("options", OPTIONS[:6], ids=str)
def test_eye_outside_inside_between_cells_and_in_a_solid(options):
    scene = crowd(3)
    culler = ConservativePLPCulling(leaf=8, budget=0, **options)
    culler.prepare(scene)
    octree = culler.octree
    middle = octree.bounds[np.argmax(octree.width)]
    solid = scene.vertices[scene.triangles[scene.object_offsets[1]]].mean(axis=0)
    eyes = {
        "outside": octree.low - 3.0,
        "far outside": octree.low + octree.side * 40.0,
        "inside": middle.mean(axis=0),
        "corner of cells": middle[0],
        "edge of cells": np.array([*middle[0, :2], middle[:, 2].mean()]),
        "face of cells": np.array([middle[0, 0], *middle[:, 1:].mean(axis=0)]),
        "corner of the root": octree.low,
        "in a solid": solid.astype(float),
    }
    for eye in eyes.values():
        pose = look_at(eye, octree.low + 0.45 * octree.side)
        for camera in (
            Camera(pose, 90, 70, near=0.05, far=math.inf, yfov=1.2),
            Camera(pose, 90, 70, near=-1.0, far=200.0, ymag=4.0),
        ):
            assert_whole_picture(culler, scene, camera)
    culler.close()


@pytest.mark.gl
def test_ray_through_an_edge_that_cells_share_keeps_the_chain():
    """Eye and target lie on a grid line of the octree; only the target fills its cells."""
    target = box((8.0, 8.0, 8.0), 0.01)
    far = [(f"far{k}", *box((x, y, z), 0.01)) for k, (x, y, z) in enumerate(np.ndindex(2, 2, 2))]
    far = [
        (name, 16.0 * np.round(points / 16.0 + 0.0) + points * 1e-3, faces)
        for name, points, faces in far
    ]
    ends = [("end", np.array([[0, 0, 0], [16, 16, 16], [0, 0, 0]], float), np.array([[0, 1, 2]]))]
    scene = Scene.from_objects([("target", *target), *far, *ends])
    for options in OPTIONS[:4]:
        culler = ConservativePLPCulling(leaf=2, budget=0, **options)
        culler.prepare(scene)
        for eye in ((8.0, 8.0, -4.0), (8.0, 8.0, 2.0), (-3.0, -3.0, -3.0), (8.0, -5.0, 8.0)):
            pose = look_at(eye, (8.0, 8.0, 8.0), (0.2, 1.0, 0.1))
            assert_whole_picture(culler, scene, Camera(pose, 65, 65, 0.01, yfov=0.02))
        culler.close()


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize("at", [0, 2, 7])
def test_cplp_conforms(at):
    """To its share: `tests/mutants` has more ways to run it."""
    checks = share(conformance_checks(moving=False), at)
    assert_conforms(lambda: ConservativePLPCulling(leaf=8, budget=20, **OPTIONS[at]), checks=checks)


# What it costs.


@pytest.mark.slow
@pytest.mark.gl
def test_ways_of_asking_draw_the_same_cells_in_as_many_rounds():
    scene = crowd(5)
    camera = perspective(100, 80)
    answers = []
    for options in OPTIONS[:6]:
        culler = ConservativePLPCulling(leaf=8, budget=40, fragments=True, **options)
        culler.prepare(scene)
        answer = culler.cull(camera)
        stats = answer.stats
        answers.append((sorted(answer.unit_ids.tolist()), stats.iterations, stats.queries))
        assert stats.depth_tests > stats.query_fragments > 0
        culler.close()
    assert all(answer == answers[0] for answer in answers)
    assert answers[0][1] > 2


@pytest.mark.gl
def test_larger_budget_never_draws_less_and_is_passed_by_less_than_a_cell():
    scene = crowd(2)
    camera = perspective(64, 48)
    drawn = []
    for budget in (0, 50, 300, 10**6):
        culler = PLPCulling(leaf=20, budget=budget)
        units = culler.prepare(scene)
        answer = culler.cull(camera)
        mask = units.mask(answer.unit_ids, scene.triangle_count)
        assert answer.stats.triangles_drawn == mask.sum() < budget + 20
        assert answer.stats.queries == 0
        drawn.append(set(np.flatnonzero(mask).tolist()))
        culler.close()
    assert drawn[0] < drawn[1] < drawn[2] < drawn[3]


@pytest.mark.gl
def test_budget_for_everything_leaves_nothing_to_find():
    scene = crowd(2)
    culler = ConservativePLPCulling(leaf=20, budget=10**6)
    culler.prepare(scene)
    stats = culler.cull(perspective(64, 48)).stats
    assert (stats.iterations, stats.queries) == (0, 0)
    culler.close()


@pytest.mark.slow
@pytest.mark.gl
def test_more_budget_means_fewer_rounds_and_fewer_extra_triangles():
    dataset = soda_hall(scale=0.25, frames=5)
    scene = scene_of(dataset)
    rounds, extra = [], []
    for budget in (500, 5000, 40000):
        culler = ConservativePLPCulling(leaf=1000, budget=budget)
        culler.prepare(scene)
        estimate = PLPCulling(leaf=1000, budget=budget)
        estimate.prepare(scene)
        stats = [culler.cull(camera).stats for camera in dataset.path.resized(128, 128)]
        first = [estimate.cull(camera).stats for camera in dataset.path.resized(128, 128)]
        rounds.append(sum(s.iterations for s in stats))
        pairs = zip(stats, first, strict=True)
        extra.append(sum(s.triangles_drawn - f.triangles_drawn for s, f in pairs))
        culler.close()
        estimate.close()
    assert rounds[0] > rounds[1] > rounds[2]
    assert extra[0] > extra[1] > extra[2]


@pytest.mark.gl
def test_cells_are_not_taken_for_boxes_that_hold_their_triangles():
    """Walls go through many cells; that no cell's box holds them whole is no fault."""
    dataset = soda_hall(scale=0.1, frames=1).resized(64, 64)
    scene = scene_of(dataset)
    referee = Referee(scene, lambda: make_engine("embree", scene))
    cullers = [("cplp", ConservativePLPCulling(leaf=200, budget=100))]
    outcome = referee.run(dataset.path, [0], cullers)
    octree = cullers[0][1].octree
    assert (scene.bounds_of(octree.units)[:, 1] > octree.bounds[:, 1]).any()
    assert outcome.exit is Exit.NO_VIOLATION
    assert Code.BOUNDS_TOO_SMALL not in {finding.code for finding in outcome.findings}


def test_names_options_and_promises():
    assert make_culler("plp:budget=7").promise is Promise.APPROXIMATE
    made = make_culler("cplp:query=item-buffer,budget=1000,leaf=300,image=restore")
    assert made.promise is Promise.CONSERVATIVE
    assert (made.budget, made.leaf, made.restores) == (1000, 300, True)
    for spec in ("plp:budget=-1", "cplp:leaf=1", "plp:query=histogram", "cplp:image=restore"):
        with pytest.raises(InputError):
            make_culler(spec)


# The scenes.


@pytest.mark.slow
def test_soda_hall_is_three_equal_floors_of_rooms():
    dataset = soda_hall(frames=20)
    scene = scene_of(dataset)
    assert 1_000_000 < scene.triangle_count < 1_150_000
    floors = [node for node in dataset.nodes if node.name.startswith("floor")]
    names = [[child.name[7:] for child in floor.children] for floor in floors]
    assert names[0] == names[1] == names[2]
    assert [floor.parent_from_node[0, 3] for floor in floors] == [0.0, 58.5, 117.0]
    octree = build(scene, 5000)
    assert octree.units.sizes.max() < 5000
    assert 1000 < octree.leaf_count < 2000
    x = np.array([camera.eye[0] for camera in dataset.path])
    assert x[0] > 170.0
    assert x[-1] < 10.0
    low, high = scene.bounds
    assert all((camera.eye > low).all() and (camera.eye < high).all() for camera in dataset.path)
    assert len(soda_hall(scale=0.1).path) == 500


def test_skyscraper_is_54_modules_of_almost_20000_triangles():
    dataset = skyscraper(frames=3)
    assert len(dataset.nodes) == 54
    assert 19_000 < scene_of(dataset).triangle_count / 54 < 20_000


@pytest.mark.parametrize("make", [soda_hall, skyscraper])
@pytest.mark.parametrize("wrong", [{"scale": 0.0}, {"scale": math.nan}, {"frames": 0}])
def test_impossible_scenes_are_refused(make, wrong):
    with pytest.raises(InputError):
        make(**wrong)
