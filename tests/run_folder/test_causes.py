"""Why something was drawn for nothing: a scene for each cause, and the tests behind them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.hand_made import judged, square
from tests.support.report_runs import ALSO_HIDDEN, EVERYTHING, HIDDEN, OUTSIDE, Scripted, write_run
from visref.camera import Camera, look_at
from visref.culler import CullerError, DrawnSet, check_asked
from visref.engines import make_engine
from visref.registry import make_culler
from visref.run_folder import causes
from visref.run_folder.causes import Cause, boxes_show, superfluous_causes
from visref.run_folder.read import read_run
from visref.run_folder.silhouettes import UnitImage
from visref.scene import Alpha, Scene
from visref.visibility import Doubt

CAMERA = Camera(look_at((0, 0, 10), (0, 0, 0)), 8, 6, near=1.0, far=100.0, ymag=3.0)

# What is hidden stands behind two walls, each of which hides a half of it.
LEFT, RIGHT, BEHIND, WIDE, AWAY, AROUND = range(6)
_LOW = square(-1.05, -1.05, -5.0, 2.0)


def two_parts(first, second):
    """One object of two squares."""
    (a, faces), (b, more) = first, second
    return np.concatenate([a, b]), np.concatenate([faces, more + len(a)])


SCENE = Scene.from_objects(
    [
        ("left", *square(-10.0, -5.0, 0.0, 10.0)),
        ("right", *square(0.0, -5.0, 1.0, 3.0 + 7.0)),
        ("behind", *_LOW),
        # Hidden behind the left wall and far out of view: between lies only its box, above both.
        ("wide", *two_parts(square(-3.0, 1.0, -2.0, 1.0), square(50.0, 1.0, 5.0, 1.0))),
        ("away", *square(40.0, 0.0, 0.0, 2.0)),
        # The camera stands in its box, and sees neither of its parts.
        ("around", *two_parts(square(60.0, 0.0, -20.0, 1.0), square(-60.0, 0.0, 20.0, 1.0))),
    ]
)
BOTH = [LEFT, RIGHT]


def cause_of(unit, order, asked_at=None, *, scene=SCENE, camera=CAMERA, ordered=True):
    truth = make_engine("exact", scene).frame(camera)
    units = scene.object_units()
    order = np.array(order, np.int32)
    asked = None if asked_at is None else np.array(asked_at, np.int32)
    verdict = judged(scene, truth, units, order)
    assert unit in verdict.superfluous_units
    drawn = DrawnSet(order, asked_at=asked, ordered=ordered)
    found = superfluous_causes(scene, truth, units, drawn, verdict.superfluous_units)
    assert set(found) == set(verdict.superfluous_units.tolist())
    return found[unit]


@pytest.mark.parametrize(
    ("order", "asked_at", "cause"),
    [
        ([*BOTH, BEHIND], [-1, -1, 2], Cause.COARSE),
        ([*BOTH, BEHIND], [-1, -1, -1], Cause.SKIPPED),
        ([*BOTH, BEHIND], None, Cause.HIDDEN),
        # One wall hides only a half of it, whichever.
        ([*BOTH, BEHIND], [-1, -1, 1], Cause.ORDER),
        ([RIGHT, LEFT, BEHIND], [-1, -1, 1], Cause.ORDER),
        ([*BOTH, BEHIND], [-1, -1, 0], Cause.ORDER),
        # Not asked, but asking when it was drawn would not have helped either.
        ([LEFT, BEHIND, RIGHT], [-1, -1, -1], Cause.ORDER),
        ([LEFT, BEHIND, RIGHT], None, Cause.ORDER),
        ([BEHIND, *BOTH], [0, 1, 1], Cause.ORDER),
        # A wall that is never drawn is later than everything.
        ([LEFT, BEHIND], [0, 1], Cause.ORDER),
    ],
)
def test_a_hidden_box_is_told_by_what_had_been_drawn_when_it_was_asked(order, asked_at, cause):
    assert cause_of(BEHIND, order, asked_at) is cause


@pytest.mark.parametrize("asked_at", [None, [0, 1, 2, 3]])
def test_what_no_question_about_boxes_spares_is_the_boxs_fault(asked_at):
    assert cause_of(WIDE, [*BOTH, BEHIND, WIDE], asked_at) is Cause.BOX
    assert cause_of(AROUND, [*BOTH, BEHIND, AROUND], asked_at) is Cause.BOX
    assert cause_of(AWAY, [*BOTH, BEHIND, AWAY], asked_at) is Cause.OUTSIDE


def test_a_list_without_order_says_nothing_of_what_came_later():
    assert cause_of(BEHIND, [BEHIND, *BOTH], ordered=False) is Cause.HIDDEN
    assert cause_of(WIDE, [WIDE, *BOTH], ordered=False) is Cause.BOX


def test_only_what_writes_depth_hides():
    """A pane and a wall seen from its back stand before the hidden one, and hide nothing."""
    pane = Scene.from_objects(
        [("wall", *square(-9.0, -9.0, 0.0, 18.0)), ("front", *square(-9.0, -9.0, 2.0, 18.0)),
         ("behind", *_LOW)]
    )  # fmt: skip
    assert cause_of(2, [1, 2, 0], [-1, -1, -1], scene=pane) is Cause.SKIPPED
    glass = np.array([Alpha.OPAQUE] * 2 + [Alpha.BLEND] * 2 + [Alpha.OPAQUE] * 2, np.uint8)
    assert cause_of(2, [1, 2, 0], [-1] * 3, scene=replace(pane, alpha=glass)) is Cause.ORDER
    turned = pane.triangles.copy()
    turned[2:4] = turned[2:4, ::-1]
    one_sided = np.array([False, False, True, True, False, False])
    back = replace(pane, triangles=turned, one_sided=one_sided)
    assert cause_of(2, [1, 2, 0], [-1] * 3, scene=back) is Cause.ORDER
    front = replace(pane, one_sided=one_sided)
    assert cause_of(2, [1, 2, 0], [-1] * 3, scene=front) is Cause.SKIPPED


def test_an_undecided_sample_proves_no_box_hidden():
    truth = make_engine("exact", SCENE).frame(CAMERA)
    units, ids = SCENE.object_units(), np.array([BEHIND], np.int32)
    drawn = DrawnSet(np.array([LEFT, RIGHT, BEHIND], np.int32))
    middle = np.array([3 * CAMERA.width + 4])
    doubtful = replace(truth, doubt=Doubt.of(middle, np.zeros(1, np.int32)))
    assert superfluous_causes(SCENE, truth, units, drawn, ids) == {BEHIND: Cause.HIDDEN}
    assert superfluous_causes(SCENE, doubtful, units, drawn, ids) == {BEHIND: Cause.BOX}


def test_of_very_many_units_some_are_explained_evenly_picked(monkeypatch):
    monkeypatch.setattr(causes, "MAX_UNITS", 3)
    scene = Scene.from_objects([(f"away{i}", *square(40.0, 0.0, 0.0)) for i in range(9)])
    truth = make_engine("exact", scene).frame(CAMERA)
    every = np.arange(9, dtype=np.int32)
    found = superfluous_causes(scene, truth, scene.object_units(), DrawnSet(every), every)
    assert list(found) == [0, 4, 8]


def box_mesh(low, high):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return np.where(corners == 1, high, low), np.array(faces)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)  # the first call compiles
@given(
    st.lists(st.integers(-40, 40), min_size=3, max_size=3),
    st.lists(st.integers(1, 30), min_size=3, max_size=3),
    st.lists(st.integers(-9, 9), min_size=3, max_size=3),
    st.booleans(),
    st.sampled_from((4.3, 9.7, 21.1, np.inf)),
)
def test_a_box_shows_where_its_surface_lies_before_the_depth(low, size, look, perspective, wall):
    """Against the exact engine on the box as a mesh, whose near side lies beyond the near plane."""
    low = np.array(low) / 4.0 + (0.0, 0.0, -12.0)
    high = low + np.array(size) / 4.0
    lens = {"yfov": 1.1} if perspective else {"ymag": 4.0}
    camera = Camera(
        look_at((0.1, 0.2, 20.3), (look[0] + 0.07, look[1] + 0.03, -11.0)), 12, 9,
        near=0.5, far=500.0, shift_x_px=0.25, **lens,
    )  # fmt: skip
    scene = Scene.from_objects([("box", *box_mesh(low, high))])
    depth = make_engine("exact", scene).frame(camera).buffer.depth
    expected = (
        bool((depth < wall + 15.0).any()) if np.isfinite(wall) else bool(np.isfinite(depth).any())
    )
    limit = np.full((camera.height, camera.width), wall + 15.0)
    box = np.stack([low, high])[None]
    assert boxes_show(camera, box, limit).tolist() == [expected]
    nearness = (1.0 / limit if perspective else -limit).astype(np.float32)
    nearness[np.isinf(limit)] = -np.inf
    assert boxes_show(camera, box, nearness, nearness=True).tolist() == [expected]


def test_a_box_that_touches_the_surface_before_it_does_not_show():
    """Its face lies in the wall's plane: to rounding no nearer, and so hidden."""
    # Off by what a float32 engine may make of ten.
    depth = np.full((6, 8), 10.0 * (1.0 + 2.0**-23))
    touching = np.array([[-1.0, -1.0, -3.0], [1.0, 1.0, 0.0]])
    nearer = touching + np.array([0.0, 0.0, 1e-4])
    assert boxes_show(CAMERA, np.stack([touching, nearer]), depth).tolist() == [False, True]


@pytest.mark.parametrize("lens", [{"ymag": 3.0}, {"yfov": 1.0}])
def test_a_box_around_one_sample_shows_there_and_nowhere_else(lens):
    camera = Camera(look_at((0.3, 0.2, 10.0), (0, 0, 0)), 8, 6, near=1.0, far=100.0, **lens)
    for y in range(camera.height):
        for x in range(camera.width):
            origin, step = camera.ray(x, y)
            at = origin + 12.0 * step
            box = np.stack([at - 0.01, at + 0.01])[None]
            depth = np.full((camera.height, camera.width), np.inf)
            assert boxes_show(camera, box, depth).all()
            depth[y, x] = 11.0
            assert not boxes_show(camera, box, depth).any()


def test_of_a_box_across_the_near_plane_what_lies_beyond_it_shows():
    """A floor from behind the eye to far ahead covers the lower samples alone."""
    camera = Camera(look_at((0, 0, 10), (0, 0, 0)), 8, 6, near=1.0, far=100.0, yfov=1.2)
    floor = np.array([[[-50.0, -1.2, -60.0], [50.0, -1.0, 20.0]]])
    for y, expected in ((0, False), (2, False), (3, True), (5, True)):
        depth = np.full((6, 8), 0.5)
        depth[y, 4] = np.inf
        assert boxes_show(camera, floor, depth).tolist() == [expected]


@pytest.mark.parametrize("lens", [{"ymag": 3.0}, {"yfov": 1.0}])
@pytest.mark.parametrize(
    ("low_m", "high_m", "expected"),
    [
        (0.2, 0.9, False),
        (0.2, 1.1, True),
        (-5.0, 0.9, False),
        (99.0, 120.0, True),
        (101.0, 120.0, False),
    ],
)
def test_only_what_lies_between_near_and_far_shows(lens, low_m, high_m, expected):
    camera = Camera(look_at((0, 0, 10), (0, 0, 0)), 8, 6, near=1.0, far=100.0, **lens)
    box = np.array([[[-0.3, -0.3, 10.0 - high_m], [0.3, 0.3, 10.0 - low_m]]])
    # In perspective a box far away is smaller than the samples' spacing.
    box[:, :, :2] *= max(high_m, 1.0) if "yfov" in lens else 3.0
    assert boxes_show(camera, box, np.full((6, 8), np.inf)).tolist() == [expected]


@pytest.mark.parametrize("lens", [{"ymag": 4.0}, {"yfov": 1.0}])
def test_depth_drawn_again_is_the_exact_engines(lens):
    camera = Camera(look_at((3.1, 2.2, 9.3), (0, 0, 0)), 24, 18, near=1.0, far=90.0, **lens)
    meshes = [
        box_mesh((-3.0, -2.0, 0.1), (1.0, 2.0, 1.3)),
        box_mesh((0.2, -1.0, -4.0), (4.0, 1.0, 3.0)),
    ]
    scene = Scene.from_objects([(f"box{i}", *mesh) for i, mesh in enumerate(meshes)])
    image = UnitImage(scene, camera, scene.object_units(), (18, 24))
    image.draw(np.array([1], np.int32))
    image.draw(np.array([0], np.int32))
    exact = make_engine("exact", scene).frame(camera).buffer
    assert np.array_equal(image.owner >= 0, exact.triangle >= 0)
    hit = exact.triangle >= 0
    nearness = -exact.depth if "ymag" in lens else 1.0 / exact.depth
    np.testing.assert_allclose(image.nearness[hit], nearness[hit], rtol=2.0**-22)
    assert np.isneginf(image.nearness[~hit]).all()


@pytest.mark.parametrize(
    "asked_at", [[0], [0, 1, -1, 2], [0.0, 0.0, 0.0], [[0, 0, 0]], [-2, 0, 0], [0, 2, 0], "abc"]
)
def test_a_claim_about_asking_that_cannot_be_true_is_refused(asked_at):
    with pytest.raises(CullerError, match="asked_at"):
        check_asked(asked_at, 3)


def test_asked_at_its_own_draw_or_never_is_accepted():
    assert check_asked([0, 1, -1], 3).tolist() == [0, 1, -1]
    assert check_asked([], 0).tolist() == []
    assert check_asked(None, 3) is None


def test_a_run_records_what_it_drew_for_nothing_and_why_in_the_planned_pictures_frames(tmp_path):
    drawn = [HIDDEN, *[unit for unit in EVERYTHING if unit != HIDDEN]]
    folder = write_run(tmp_path / "run", [("c", Scripted(drawn))], pictures=(0, 3))
    rows = pq.read_table(folder / "objects.parquet").to_pylist()
    found = {(row["frame"], row["unit"]): row["cause"] for row in rows}
    for frame in (0, 3):
        assert found[frame, HIDDEN] == "occluder_drawn_later"
        assert found[frame, ALSO_HIDDEN] == "box_hidden"
        assert found[frame, OUTSIDE] == "outside_view"
    assert {frame for frame, _ in found} == {0, 3}
    assert read_run(folder).superfluous_causes("c") == {
        "occluder_drawn_later": 2,
        "box_hidden": 2,
        "outside_view": 2,
    }


class Watching:
    """Follows what a GL culler draws and asks, step by step."""

    def __init__(self):
        self.drawn, self.asked = 0, {}

    def __call__(self, step, data):
        if step == "draw":
            self.drawn += len(data["units"])
        elif step == "query":
            self.asked |= dict.fromkeys(data["units"].tolist(), self.drawn)


@pytest.mark.gl
@pytest.mark.parametrize(
    "spec",
    ["none", "frustum", "occlusion-query", "occlusion-query:query=batch,size=3", "occupancy-map",
     "occupancy-map:maps=1", "cplp:budget=4,leaf=4", "cplp:budget=4,leaf=4,query=item-buffer"],
)  # fmt: skip
def test_cullers_tell_when_they_asked(spec):
    rows = [(f"s{i}", *square(-4.05 + (i * 5) % 7, -2.05 + i % 3, -i, 2.0)) for i in range(14)]
    scene = Scene.from_objects(rows)
    culler = make_culler(spec)
    units = culler.prepare(scene)
    culler.observer = Watching()
    drawn = culler.cull(CAMERA)
    told = dict(zip(drawn.unit_ids.tolist(), drawn.asked_at.tolist(), strict=True))
    assert units.count >= len(told) > 3
    assert told == {unit: culler.observer.asked.get(unit, -1) for unit in told}
    culler.close()


@pytest.mark.gl
def test_a_method_that_asks_in_its_own_way_and_does_not_say_so_tells_nothing():
    culler = make_culler("cplp:query=item-buffer,image=restore,leaf=4")
    culler.prepare(SCENE)
    assert culler.cull(CAMERA).asked_at is None
    culler.close()


@pytest.mark.gl
def test_the_lazy_grid_tells_of_leaves_whose_cells_it_asked_and_of_no_others():
    scene = Scene.from_objects(
        [("near", *square(-4.05, -3.05, 5.0, 3.3))]
        + [(f"s{i}", *square(-4.05 + (i * 5) % 7, -2.05 + i % 3, -i, 2.0)) for i in range(9)]
    )
    asked = {}
    for update in ("lazy", "none"):
        culler = make_culler(f"lazy-grid:update={update},cell=8")
        culler.prepare(scene)
        drawn = culler.cull(replace(CAMERA, width=64, height=48))
        check_asked(drawn.asked_at, len(drawn.unit_ids))
        asked[update] = int(np.count_nonzero(drawn.asked_at >= 0))
        if update == "lazy":
            assert asked[update] <= drawn.stats.queries
        culler.close()
    assert asked["lazy"] > 0
    assert asked["none"] == 0
