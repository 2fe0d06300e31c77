"""Three-pass culling: safe where it says so, measured where not, and what it promises to save."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.mutants.harness import Method, departures, watch
from tests.mutants.three_pass.contract import SUITE, depths_left_and_afresh, pieces
from tests.mutants.three_pass.mutants import BOXES, PUBLISHED, SAFE, SMALL, NotCleared
from tests.property.test_every_culler import QUIET
from tests.support import strategies
from visref.camera import Camera, look_at
from visref.cli.main import main
from visref.conformance.suite import (
    assert_conforms,
    case,
    exact_truths,
    judge_on,
)
from visref.culler import Promise, QueryStats
from visref.engines.embree import EmbreeEngine
from visref.errors import InputError
from visref.judging.referee import Referee
from visref.scene import Alpha, Scene
from visref.trials.hardcases import State, run_hard_cases
from visref_culling.gl.device import device
from visref_culling.three_pass import ThreePassCulling
from visref_culling.three_pass.parts import TRIANGLES_A_BOX, parts_of
from visref_culling.three_pass.small_image import FarthestDepth, small_camera
from visref_culling.three_pass.stand_ins import simplified, stand_ins
from visref_culling.three_pass.tiles import divided, tiles_of
from visref_datasets_gen.dataset import scene_of
from visref_datasets_gen.seismic import seismic

pytestmark = pytest.mark.gl

# Conservative, with what the catalogue of options does not try: its whole numbers.
CONSERVATIVE = [
    {"extra": 0},
    {"extra": 0, "reduction": 1},
    {"reduction": 1},
    {"scale": 2, "extra": 0, "reduction": 3},
    {"scale": 4, "extra": 5, "reduction": 1},
    {"scale": 8, "extra": 0, "reduction": 1, "depth": 32},
    {"scale": 4, "fragments": True},
    {"extra": 0, "tile": 8, "reduction": 1},
    {"extra": 4, "tile": 3, "reduction": 2, "scale": 2},
]


def conservative(**options) -> ThreePassCulling:
    return ThreePassCulling(mode="conservative", **options)


@pytest.fixture(scope="module")
def survey():
    made = seismic(scale=0.02, frames=10)
    return scene_of(made), made.path.resized(160, 120)


# What the mutants leave open.


@pytest.mark.slow
@pytest.mark.parametrize(
    "options", [{}, {"scale": 4}, {"threshold": 5}, {"reduction": 10}], ids=str
)
def test_published_mode_keeps_every_contract_on_a_survey(options, survey):
    scene, path = survey
    method = Method("survey", ThreePassCulling, {**PUBLISHED.options, **options}, SUITE)
    assert departures(method, [(scene, path.cameras[:4])]) == {}


@pytest.mark.slow
@pytest.mark.parametrize("method", SAFE, ids=str)
def test_without_the_second_clear_the_conservative_picture_is_the_same_bit_for_bit(method, survey):
    """Why U3 is equivalent there."""
    kind = type("NotCleared", (NotCleared, ThreePassCulling), {})
    broken = Method("not cleared", kind, method.options, SUITE)
    for scene, cameras in [*SUITE.watched_scenes(), (survey[0], survey[1].cameras[::3])]:
        for trace in watch(broken, scene, cameras):
            left, afresh = depths_left_and_afresh(trace)
            assert np.array_equal(left, afresh)


# The conservative mode is safe.


@pytest.mark.slow
@pytest.mark.parametrize("options", CONSERVATIVE, ids=str)
def test_conservative_mode_conforms(options):
    assert_conforms(lambda: conservative(**options))


@pytest.mark.slow
@QUIET
@given(
    built=strategies.cases(),
    reduction=st.sampled_from([1, 2, 10]),
    extra=st.sampled_from([0, 2, 1000]),
    scale=st.sampled_from([1, 2, 4, 8]),
    tile=st.sampled_from([0, 1, 5]),
)
def test_conservative_mode_misses_nothing_of_what_hypothesis_finds(
    built, reduction, extra, scale, tile
):
    def make() -> ThreePassCulling:
        return conservative(reduction=reduction, extra=extra, scale=scale, tile=tile)

    problems, _ = judge_on(make, built, exact_truths(built))
    assert problems == ()


@pytest.mark.slow
def test_conservative_mode_is_right_on_every_hard_case():
    names = ("reduction=1", "extra=0,reduction=1", "extra=0,reduction=1,scale=4")
    specs = [f"three-pass:mode=conservative,{options}" for options in names]
    table = run_hard_cases([], specs)
    wrong = {
        (case.name, spec): str(table.cells[case.name][spec])
        for case in table.cases
        for spec in specs
        if table.cells[case.name][spec].state is not State.RIGHT
    }
    assert wrong == {}


@pytest.mark.slow
def test_conservative_mode_misses_nothing_between_layers_and_culls(survey):
    scene, path = survey
    options = [{"extra": 0, "reduction": r, "scale": s} for r in (1, 10, 100) for s in (1, 4)]
    cullers = [(str(chosen), conservative(**chosen)) for chosen in options]
    outcome = Referee(scene, lambda: EmbreeEngine(scene)).run(path, range(len(path)), cullers)
    drawn = {}
    for record in outcome.cullers:
        assert record.totals.confirmed == 0, record.spec
        assert record.totals.visible > 100
        drawn[record.spec] = record.totals.drawn
    # Fewer occluders and coarser proxies hide less, and so does a smaller image.
    by_reduction = [drawn[str(chosen)] for chosen in options[::2]]
    assert by_reduction == sorted(by_reduction)
    pairs = zip(options[::2], options[1::2], strict=True)
    assert all(drawn[str(full)] <= drawn[str(small)] for full, small in pairs)
    assert drawn[str(options[0])] < 0.5 * scene.object_count * len(path)


@pytest.mark.parametrize(
    ("options", "place"),
    [
        ({"mode": "conservative", "threshold": 1}, "threshold"),
        ({"threshold": -1}, "threshold"),
        ({"reduction": 0}, "reduction"),
        ({"extra": -1}, "extra"),
        ({"tile": -1}, "tile"),
        ({"mode": "conservative", "ask": "boxes"}, "ask"),
    ],
)
def test_options_that_cannot_be_are_refused(options, place):
    with pytest.raises(InputError) as refused:
        ThreePassCulling(**options)
    assert refused.value.place == place


# The published mode is measured.


def test_published_mode_declares_itself_approximate_and_the_conservative_one_does_not():
    assert ThreePassCulling.promise is ThreePassCulling().promise is Promise.APPROXIMATE
    assert conservative().promise is Promise.CONSERVATIVE


@pytest.mark.slow
def test_published_misses_are_listed_with_witnesses_and_fail_no_run(tmp_path: Path):
    out = tmp_path / "run"
    spec = "three-pass:extra=0,reduction=30"
    made = seismic(scale=0.02, frames=10)
    scene, path = replace(made, path=made.path.resized(160, 120)).write(tmp_path)
    run = ["run", str(scene), "--path", str(path), "--culler", spec, "--out", str(out)]
    assert main([*run, "--pictures", "0"]) == 0
    verdict = json.loads((out / "verdict.json").read_text())
    found = verdict["cullers"][spec]
    assert verdict["status"] == "measured"
    assert found["promise"] == "approximate"
    assert found["confirmed"] > 0
    assert found["violations"] == 0
    assert found["worst"]["pixels"] > 0
    assert list((out / "witnesses").iterdir())


@pytest.mark.slow
def test_published_misses_rise_with_reduction_threshold_and_scale(survey):
    scene, path = survey
    options = [{}, {"reduction": 10}, {"reduction": 36}, {"threshold": 30}, {"scale": 8}]
    cullers = [
        (str(chosen), ThreePassCulling(**{"extra": 0, "reduction": 1, **chosen}))
        for chosen in options
    ]
    outcome = Referee(scene, lambda: EmbreeEngine(scene)).run(path, range(len(path)), cullers)
    whole, tenth, few, threshold, small = (r.totals.missed_pixels for r in outcome.cullers)
    assert whole < tenth < few
    assert whole < min(threshold, small)


def test_worst_fill_is_three_times_the_pictures():
    """Where nothing is hidden and stand-ins are the objects, each pass draws all there is."""
    view = Camera(look_at((0, 0, 5), (0, 0, 0)), 32, 24, 0.1, 100.0, yfov=1.0)
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float) * 0.3
    faces = [[0, 1, 2], [0, 2, 3]]
    places = [(-1.2, 0, 0), (0, 0, -0.5), (1.2, 0, 0)]
    scene = Scene.from_objects([("square", square + at, faces) for at in places])
    culler = ThreePassCulling(fragments=True)
    culler.prepare(scene)
    stats = culler.cull(view).stats
    culler.close()
    assert stats.depth_tests == 3 * stats.query_fragments
    assert stats.query_fragments > 0


# Boxes asked in the second pass, and tiles.


def test_boxes_asked_in_the_same_passes_draw_all_that_stand_ins_draw_and_more(survey):
    scene, path = survey
    drawn = {}
    for ask in ("stand-ins", "boxes"):
        # Of stand-ins that are the objects, each lies in its box: what shows of it shows of that.
        culler = ThreePassCulling(reduction=1, extra=0, ask=ask, fragments=True)
        culler.prepare(scene)
        answers = [culler.cull(camera) for camera in path.cameras[::3]]
        drawn[ask] = [set(answer.unit_ids.tolist()) for answer in answers]
        assert all(answer.stats.batches == 1 for answer in answers)
        assert all(answer.stats.query_fragments > 0 for answer in answers)
        culler.close()
    assert all(a <= b for a, b in zip(drawn["stand-ins"], drawn["boxes"], strict=True))
    assert drawn["stand-ins"] != drawn["boxes"]


@pytest.mark.parametrize("most", [1, 7, 100, 10_000])
def test_tiles_hold_each_triangle_once_and_are_no_larger_than_asked(most):
    scene = merged(wavy(20), case("crowd")[0])
    tiles = tiles_of(scene, most)
    sizes = np.diff(scene.object_offsets)
    assert np.array_equal(np.sort(tiles.triangles), np.arange(scene.triangle_count))
    assert tiles.count == np.maximum(-(-sizes // most), 1).sum()
    assert tiles.sizes.max() <= max(most, 1)
    owner = scene.object_of_triangle[tiles.triangles]
    # No tile is of two objects, and the objects' tiles come in their order.
    assert (np.diff(owner) >= 0).all()
    assert tiles.are_objects(scene) == (sizes <= most).all()
    made = divided(scene, tiles)
    assert np.array_equal(made.triangles, scene.triangles[tiles.triangles])
    assert np.array_equal(made.object_offsets, tiles.offsets)


def merged(*scenes: Scene) -> Scene:
    """All objects of some scenes."""
    return Scene.from_objects(
        [
            (f"{number}/{name}", scene.vertices, scene.triangles[start:end])
            for number, scene in enumerate(scenes)
            for name, start, end in zip(
                scene.names, scene.object_offsets[:-1], scene.object_offsets[1:], strict=True
            )
        ]
    )


@pytest.mark.parametrize("mode", ["published", "conservative"])
def test_one_large_object_is_culled_in_tiles_as_if_it_had_come_in_them(mode):
    whole = merged(wavy(24))
    tiles = tiles_of(whole, 40)
    apart = divided(whole, tiles)
    camera = Camera(look_at((12, 3, -6), (12, 0, 8)), 96, 64, 0.1, 100.0, yfov=0.8)
    answers = []
    for scene, options in ((whole, {"tile": 40}), (apart, {}), (whole, {})):
        culler = ThreePassCulling(mode=mode, extra=0, reduction=4, **options)
        units = culler.prepare(scene)
        drawn = culler.cull(camera).unit_ids
        answers.append(units.sizes[drawn].sum())
        if options:
            assert units.kind == "tile"
            assert np.array_equal(units.triangles, tiles.triangles)
        culler.close()
    tiled, came_in_tiles, undivided = answers
    assert 0 < tiled == came_in_tiles < undivided == whole.triangle_count


# Parts.


def wavy(side: int) -> Scene:
    x, z = np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0), indexing="ij")
    points = np.stack([x, np.sin(x) + np.cos(0.7 * z), z], axis=-1).reshape(-1, 3)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1)
    a, b, c, d = corner, corner + 1, corner + side + 2, corner + side + 1
    return Scene.from_objects([("sheet", points, np.stack([a, b, c, a, c, d], 1).reshape(-1, 3))])


@pytest.mark.parametrize("reduction", [1, 7, 100])
def test_parts_hold_each_triangle_once_and_their_boxes_have_the_reduction(reduction):
    scene = wavy(20)
    parts, first = parts_of(scene, reduction)
    assert np.array_equal(np.sort(parts.triangles), np.arange(scene.triangle_count))
    assert first.tolist() == [0, parts.count]
    assert parts.count == math.ceil(scene.triangle_count / (TRIANGLES_A_BOX * reduction))
    assert np.ptp(parts.sizes) <= 1 + scene.triangle_count // 2 ** int(math.log2(parts.count) + 1)


@pytest.mark.parametrize("reduction", [2, 10, 100, 1000])
@pytest.mark.parametrize("size", [1.0, 1e-6, 1e9])
def test_stand_ins_reach_the_reduction_whatever_the_unit_of_length(reduction, size):
    scene = wavy(40)
    mesh = scene.vertices.astype(np.float64) * size, scene.triangles.astype(np.int64)
    count = -(-scene.triangle_count // reduction)
    assert len(simplified(mesh, count)[1]) <= max(count, 4)


def test_stand_ins_keep_materials_and_what_is_small_and_repeat_to_the_bit():
    scene, _ = case("torn_layers")
    low, again = (stand_ins(scene, 5, 10) for _ in range(2))
    assert low.digest == again.digest
    assert low.names == scene.names
    sizes = np.diff(scene.object_offsets)
    assert np.array_equal(np.diff(low.object_offsets)[sizes <= 10], sizes[sizes <= 10])
    assert (np.diff(low.object_offsets)[sizes > 10] <= 10).all()
    glass = {low.names[i] for i in np.unique(low.object_of_triangle[low.alpha == Alpha.BLEND])}
    assert glass == {name for name in scene.names if name.startswith("volume")}


def test_pieces_are_counted_by_place():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    apart = np.concatenate([square, square + 5.0])
    assert pieces(np.array([[0, 1, 2], [0, 2, 3]]), square) == 1
    assert pieces(np.array([[0, 1, 2], [4, 5, 6], [4, 6, 7]]), apart) == 2


@pytest.mark.parametrize("size", [(64, 48), (61, 47), (1, 7), (9, 5)])
@pytest.mark.parametrize("scale", [2, 4, 8])
def test_texel_of_the_small_image_sees_along_the_middle_of_its_pixels(size, scale):
    pose = look_at((1.0, 2.0, 3.0), (0.0, 0.5, -4.0))
    for lens in ({"yfov": 1.1}, {"ymag": 3.0, "far": 50.0}):
        camera = Camera(pose, *size, 0.5, shift_x_px=0.75, shift_y_px=-2.5, **lens)
        small = small_camera(camera, scale)
        # Of each texel the first and the last pixel, columns from the left, rows from the bottom.
        left = np.arange(small.width) * scale
        a = camera.column_a[0] + 2.0 * (left + (scale - 1) / 2.0)
        b = camera.row_b[-1] + 2.0 * (np.arange(small.height) * scale + (scale - 1) / 2.0)
        unit = np.linalg.norm(small.right_step) / np.linalg.norm(camera.right_step)
        assert unit == pytest.approx(scale, rel=1e-14)
        assert small.column_a * unit == pytest.approx(a, rel=1e-12, abs=1e-9)
        assert small.row_b[::-1] * unit == pytest.approx(b, rel=1e-12, abs=1e-9)


@pytest.mark.parametrize("bits", [24, 32])
@pytest.mark.parametrize("size", [(13, 9), (16, 8), (1, 1)])
def test_reduced_depth_is_the_farthest_of_the_texels_pixels_and_never_nearer(size, bits):
    scene, path = case("crowd")
    camera = path.resized(*size).cameras[0]
    culler = conservative(scale=4, extra=0, reduction=1, depth=bits)
    culler.prepare(scene)
    culler.cull(camera)  # leaves the picture's depth
    whole = device().target(*size, bits)
    small = device().target(-(-size[0] // 4), -(-size[1] // 4), bits, channels=2)
    culler.clear(small, QueryStats())
    FarthestDepth(device()).reduce(whole, small, 4, QueryStats())
    rows = whole.read_depth()[::-1]
    found = small.read_depth()[::-1]
    culler.close()
    for (y, x), depth in np.ndenumerate(found):
        farthest = float(rows[4 * y : 4 * y + 4, 4 * x : 4 * x + 4].max())
        assert farthest <= depth <= min(1.0, farthest + 5.0 * 2.0**-24)


def test_methods_under_test_are_what_they_say():
    scene, _ = case("crowd")
    for method, boxed in ((BOXES, True), (SMALL, True)):
        culler = method.make()
        culler.prepare(scene)
        assert (not culler.whole.any()) == boxed
        culler.close()
