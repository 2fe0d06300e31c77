"""Coherent hierarchical culling: its hierarchy, what it asks together, and what it costs."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.support.culling_scenes import (
    ASIDE,
    FROM,
    WALLED,
    drawn_by,
    random_camera,
    random_scene,
)
from visref.camera_path import CameraPath, Frame
from visref.conformance import case
from visref.conformance.moving import moved, posed
from visref.conformance.scenes import box, pixel_panel
from visref.conformance.suite import built_case
from visref.culler import Promise, QueryStats
from visref.engines.recalled import RecalledTruths
from visref.errors import InputError
from visref.judging.referee import Referee
from visref.registry import make_culler
from visref.scene import Scene
from visref.timeline import Timeline
from visref_culling.boxes.conservative import inflated, needs_no_query, round_outward
from visref_culling.chc.memory import drawn_by_lot
from visref_culling.chc.multiquery import chance_of_staying_hidden, multiqueries, worth
from visref_culling.chc.nodes import INNER, MOST_SURFACE, NO_PARENT, Nodes
from visref_culling.gl.device import device
from visref_culling.gl.geometry import Geometry, occluders
from visref_culling.gl.view import View
from visref_culling.queries.occlusion_query import BoxQueries
from visref_culling.queries.under_way import BoxesUnderWay

pytestmark = pytest.mark.gl

BOTH = ["chc", "chc++"]
EVERY_WAY = [*BOTH, "chc:query=software", "chc++:query=software", "chc:ahead=1", "chc++:batch=1"]


# The hierarchy.


def random_bounds(count: int, *, absent: float = 0.2, flat: bool = False) -> np.ndarray:
    rng = np.random.default_rng(count)
    centres, half = rng.normal(size=(count, 3)) * 3.0, 10.0 ** rng.uniform(-2, 0, (count, 3))
    if flat:
        centres, half = np.stack([np.arange(count)] * 3, axis=1) * [1.0, 0.0, 0.0], np.full(3, 0.5)
    bounds = np.stack([centres - half, centres + half], axis=1)
    bounds[rng.random(count) < absent] = np.array([[np.inf] * 3, [-np.inf] * 3])
    return bounds


def leaves_below(nodes: Nodes, node: int) -> list[int]:
    if nodes.unit[node] != INNER:
        return [node]
    children = range(nodes.first_child[node], nodes.end_child[node])
    return [leaf for child in children for leaf in leaves_below(nodes, child)]


@pytest.mark.parametrize("count", [0, 1, 2, 8, 9, 64, 65, 200])
def test_each_unit_has_a_leaf_and_each_node_one_parent(count):
    nodes = Nodes(np.random.default_rng(1).permutation(count))
    assert sorted(nodes.unit[nodes.unit != INNER]) == list(range(count))
    if count:
        root = nodes.count - 1
        assert nodes.parent[root] == NO_PARENT
        assert leaves_below(nodes, root) == list(range(count))
    for node in range(nodes.count):
        for child in range(nodes.first_child[node], nodes.end_child[node]):
            assert nodes.parent[child] == node


@pytest.mark.parametrize("count", [1, 9, 65, 200])
def test_a_refitted_node_holds_what_its_leaves_hold_and_no_more(count):
    nodes = Nodes(np.arange(count))
    for absent in (0.0, 0.3, 1.0):
        bounds = random_bounds(count, absent=absent)
        nodes.refit(bounds)
        for node in range(nodes.count):
            held = bounds[leaves_below(nodes, node)]
            there = held[held[:, 0, 0] <= held[:, 1, 0]]
            assert nodes.there[node] == bool(len(there))
            if len(there):
                whole = np.stack([there[:, 0].min(axis=0), there[:, 1].max(axis=0)])
                assert np.array_equal(nodes.boxes[node], whole)
    assert np.isfinite(nodes.boxes).all()


@pytest.mark.parametrize("tight", [0, 1, 3])
@pytest.mark.parametrize("flat", [False, True])
def test_tight_boxes_hold_each_leaf_once_and_have_little_more_surface(tight, flat):
    nodes = Nodes(np.arange(200), tight)
    bounds = random_bounds(200, absent=0.0 if flat else 0.2, flat=flat)
    nodes.refit(bounds)
    deeper = 0
    for node in range(nodes.count):
        boxes = range(nodes.first_tight[node], nodes.end_tight[node])
        held = [leaf for one in boxes for leaf in leaves_below(nodes, one)]
        assert held == leaves_below(nodes, node)
        sides = nodes.boxes[[*boxes, node], 1] - nodes.boxes[[*boxes, node], 0]
        surface = (sides * np.roll(sides, 1, axis=1)).sum(axis=1)
        assert surface[:-1].sum() <= MOST_SURFACE * surface[-1] * (1.0 + 1e-12)
        deeper += list(boxes) != [node]
    # Cubes in a row touch each other, so that all of them have little more surface than the row.
    assert (deeper > 0) == (tight > 0)


def test_a_unit_that_appears_is_found_where_it_is():
    nodes = Nodes(np.arange(20))
    bounds = random_bounds(20, absent=0.0)
    gone = bounds.copy()
    gone[7] = np.array([[np.inf] * 3, [-np.inf] * 3])
    nodes.refit(gone)
    (leaf,) = np.flatnonzero(nodes.unit == 7)
    assert not nodes.there[leaf]
    nodes.refit(bounds)
    assert nodes.there[leaf]
    assert np.array_equal(nodes.boxes[leaf], bounds[7])


# What is asked together.


@pytest.mark.parametrize("seed", range(20))
def test_groups_hold_each_place_once_and_the_likeliest_first(seed):
    rng = np.random.default_rng(seed)
    chances = rng.uniform(0.2, 0.99, rng.integers(0, 40)).tolist()
    groups = multiqueries(chances)
    assert sorted(itertools.chain(*groups)) == list(range(len(chances)))
    ordered = [chances[place] for group in groups for place in group]
    assert ordered == sorted(chances, reverse=True)


@pytest.mark.parametrize("chance", [0.3, 0.6, 0.8, 0.9, 0.95, 0.99])
def test_a_group_of_equals_is_as_large_as_is_worth_most(chance):
    best = max(range(1, 200), key=lambda size: worth(size, chance**size))
    assert len(multiqueries([chance] * 200)[0]) == best


def test_what_will_surely_show_is_asked_alone_and_what_stays_hidden_long_together():
    assert multiqueries([0.1] * 5) == [[0], [1], [2], [3], [4]]
    chances = [chance_of_staying_hidden(frames) for frames in range(8)]
    assert chances == sorted(chances)
    assert 0.0 < chances[0] < chances[-1] < 1.0
    assert len(multiqueries([chances[-1]] * 8)) == 1


def test_lots_are_in_range_and_evenly_drawn():
    drawn = [drawn_by_lot(node, frame, 5) for node in range(100) for frame in range(20)]
    counts = np.bincount(drawn, minlength=5)
    # Of 2,000, with a deviation of 18.
    assert len(counts) == 5
    assert np.abs(counts - 400).max() < 90
    assert drawn == [drawn_by_lot(node, frame, 5) for node in range(100) for frame in range(20)]


# Queries under way.


def test_answers_are_those_of_queries_that_are_waited_for_one_by_one():
    rng = np.random.default_rng(2)
    scene, camera = random_scene(rng, 40), random_camera(rng, 96, 72)
    gpu = device()
    view = View.of(camera, scene, gpu.subpixel_bits)
    target = gpu.target(camera.width, camera.height)
    geometry = Geometry(gpu, scene, scene.object_units(), occluders(scene))
    boxes = inflated(view, scene.object_bounds)
    boxes = boxes[~needs_no_query(view, boxes)]
    starts = range(0, len(boxes) - 3, 3)

    def asked(ask):
        """What is drawn in between is seen by those that follow, and by none before."""
        target.framebuffer.depth_mask = True
        target.framebuffer.clear(depth=1.0)
        gpu.begin_frame()
        found = []
        for number, start in enumerate(starts):
            geometry.draw(view, target, np.array([number]), QueryStats())
            found.append(ask(start))
        return found

    waited = asked(
        lambda start: int(
            BoxQueries(gpu)
            .ask(
                view,
                target,
                round_outward(boxes[start : start + 3]),
                QueryStats(),
                way="sync",
                cull_back_faces=True,
            )
            .sum()
        )
    )
    stats = QueryStats()
    under_way = BoxesUnderWay(BoxQueries(gpu), cull_back_faces=True, state_hook=lambda state: state)
    under_way.begin(view, target, boxes, stats)
    sent = asked(lambda start: under_way.ask([(start, start + 2), (start + 2, start + 3)]))
    assert [under_way.samples(query) for query in sent] == waited
    assert 0 < np.count_nonzero(waited) < len(waited)
    assert (stats.queries, stats.queries_passed) == (len(waited), np.count_nonzero(waited))
    geometry.release()


# What is drawn.


@pytest.mark.parametrize("spec", EVERY_WAY)
def test_nothing_is_late_where_answers_are_waited_for(spec):
    # In the first frame all may be asked about before anything is drawn.
    drawn = drawn_by(spec, [FROM] * 8 + [ASIDE] * 2)
    assert drawn[7] == [0, 2]
    assert drawn[8] == drawn[9] == [1, 2]


@pytest.mark.parametrize(
    "spec", [one + ("," if ":" in one else ":") + "wait=false" for one in EVERY_WAY]
)
def test_without_waiting_what_comes_into_view_is_late_by_one_frame(spec):
    # All is drawn where nothing is known.
    drawn = drawn_by(spec, [FROM] * 8 + [ASIDE] * 2 + [replace(FROM, cut=True)])
    assert drawn[0] == [0, 1, 2]
    assert drawn[7] == [0, 2]
    assert 1 not in drawn[8]
    assert 1 in drawn[9]
    assert drawn[10] == [0, 1, 2]


@pytest.mark.parametrize("spec", BOTH)
def test_each_view_remembers_what_it_saw_itself(spec):
    culler = make_culler(spec + ":wait=false")
    culler.prepare(WALLED)
    left, right = replace(FROM, view="left"), replace(ASIDE, view="right")
    try:
        for _ in range(8):
            drawn = [sorted(culler.cull(one).unit_ids.tolist()) for one in (left, right)]
    finally:
        culler.close()
    assert drawn == [[0, 2], [1, 2]]


@pytest.mark.parametrize("spec", ["chc:wait=false", "chc++:wait=false", "chc++:wait=false,every=1"])
@pytest.mark.parametrize("name", ["fast_turn", "sliding_door", "walk_through_a_city"])
def test_all_that_is_missed_without_waiting_has_just_come_into_view(spec, name):
    built, truths = built_case(name, 0)
    path = built.path.relative_to(built.scene.origin)
    referee = Referee(built.scene, lambda: RecalledTruths(built.scene, path, truths))
    outcome = referee.run(path, range(len(path)), [(spec, make_culler(spec))])
    (record,) = outcome.cullers
    assert not record.failed
    assert set(record.ages()) <= {0}
    # Or nothing would have been shown of what is late.
    if name != "walk_through_a_city":
        assert record.ages()


@pytest.mark.parametrize("spec", [*BOTH, "chc++:query=software"])
def test_nothing_is_drawn_of_what_is_absent_and_what_appears_is(spec):
    objects = [(f"box {k}", box((k, -1.0, -9.0 - k), (k + 0.8, 1.0, -8.0 - k))) for k in range(5)]
    names = [name for name, _ in objects]
    gone = [("box 0", "box 3"), tuple(names), (), ("box 4",)]
    built = posed(objects, [Frame((FROM,), absent=absent) for absent in gone])
    timeline = Timeline(built.scene, built.path)
    culler = make_culler(spec)
    for number, absent in enumerate(gone):
        scene = timeline.at(number)
        culler.update(scene) if number else culler.prepare(scene)
        (camera,) = built.path.views(number)
        drawn = {names[unit] for unit in culler.cull(camera).unit_ids}
        assert not drawn & set(absent)
        assert "box 0" in drawn or "box 0" in absent
    culler.close()


@pytest.mark.parametrize("spec", BOTH)
def test_a_node_follows_what_moves_out_of_it(spec):
    objects = [(f"box {k}", box((k, -1.0, -9.0), (k + 0.8, 1.0, -8.0))) for k in range(20)]
    away = {"box 3": moved(y=50.0), "box 19": moved(x=-60.0)}
    built = posed(objects, [Frame((FROM,)), Frame((FROM,), world_from_object=away)])
    timeline = Timeline(built.scene, built.path)
    culler = make_culler(spec)
    culler.prepare(timeline.at(0))
    culler.update(timeline.at(1))
    nodes = culler.nodes
    assert np.array_equal(nodes.boxes[nodes.unit != INNER], culler.bounds()[nodes.order])
    assert np.array_equal(nodes.boxes[-1], timeline.at(1).bounds)
    culler.close()


# What it costs.


def crowd() -> tuple[Scene, CameraPath]:
    """A wall, and 600 boxes in blocks behind it."""
    objects = [("wall", pixel_panel(FROM, (-20.0, 84.0), (-20.0, 68.0), 5.0))]
    for place in itertools.product(range(10), range(10), range(6)):
        corner = np.array(place) * [0.5, 0.5, -0.5] + [-2.5, -2.5, -8.0]
        objects.append(("box", box(corner, corner + 0.4)))
    return Scene.from_objects([(name, *mesh) for name, mesh in objects]), CameraPath((FROM,) * 6)


def costs(spec: str) -> list[QueryStats]:
    scene, path = crowd()
    culler = make_culler(spec)
    culler.prepare(scene)
    try:
        return [culler.cull(path.views(k)[0]).stats for k in range(len(path))]
    finally:
        culler.close()


def test_hidden_branches_are_asked_about_as_a_whole_and_several_at_once():
    single, several = costs("chc:every=1"), costs("chc++:every=1")
    alone = costs("chc++:every=1,multi=false")
    for found in (single, several, alone):
        assert found[-1].units_drawn == 1
        # 601 leaves have 76 nodes above them, and these 10.
        assert found[-1].queries < 76
    assert several[-1].queries < 0.5 * alone[-1].queries
    # What is asked together is waited for together.
    assert several[-1].batches < single[-1].batches


def test_what_is_gathered_changes_the_state_less_and_is_drawn_together():
    scene, path = case("walk_through_a_city")
    totals = {}
    for spec in BOTH:
        culler = make_culler(spec + ":every=1")
        culler.prepare(scene)
        stats = [culler.cull(path.views(k)[0]).stats for k in range(len(path)) for _ in range(2)]
        culler.close()
        totals[spec] = stats
    for count in ("state_changes", "draw_calls", "batches"):
        one, several = (sum(getattr(s, count) for s in totals[spec]) for spec in BOTH)
        assert several < 0.7 * one, count


def test_what_is_visible_is_not_asked_in_each_frame():
    scene, path = case("walk_through_a_city")
    totals = {}
    for every in (1, 8):
        culler = make_culler(f"chc++:every={every}")
        culler.prepare(scene)
        stats = [culler.cull(path.views(0)[0]).stats for _ in range(12)]
        culler.close()
        totals[every] = sum(one.queries for one in stats[1:])
    assert totals[8] < totals[1]


def test_no_answer_is_waited_for_that_counts_in_the_next_frame():
    assert [one.batches for one in costs("chc++:wait=false")] == [0] * 6


@pytest.mark.parametrize("spec", BOTH)
def test_fragments_are_counted_beside_the_frame_and_change_no_answer(spec):
    plain, counted = costs(spec), costs(spec + ":fragments=true")
    for one, other in zip(plain, counted, strict=True):
        assert other.query_fragments > 0
        assert 0 <= other.query_fragments_passed <= other.query_fragments
        assert other.depth_tests >= other.query_fragments
        assert (one.queries, one.units_drawn) == (other.queries, other.units_drawn)


def test_the_promise_says_what_is_not_waited_for():
    for spec in BOTH:
        for option, promise in {
            "": Promise.CONSERVATIVE,
            ":wait=false": Promise.APPROXIMATE,
            ":threshold=3": Promise.APPROXIMATE,
        }.items():
            culler = make_culler(spec + option)
            assert culler.promise is promise
            culler.close()


@pytest.mark.parametrize(
    "spec",
    [
        "chc:every=0",
        "chc:ahead=0",
        "chc:threshold=-1",
        "chc:query=software,threshold=1",
        "chc++:batch=0",
        "chc++:tight=6",
    ],
)
def test_options_out_of_range_are_refused_by_name(spec):
    with pytest.raises(InputError):
        make_culler(spec)
