"""The bench: the bound's coverage, nested subsets of the same samples, errors known beforehand."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.truth_scenes import build, quad, random_soup
from visref import bench
from visref.bench import BenchRun, timing
from visref.bench.bounds import good_turing, unseen_share_bound
from visref.bench.plot import Point, panels, pictures
from visref.bench.subsets import ALL, SUBSETS, nested_subsets
from visref.bench.timing import GeometricRow, ImageRow, jittered, wrong_owners
from visref.bench.verdict import headline, pareto, sentences
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.cli import main as cli
from visref.engines import make_engine
from visref.engines.embree import EmbreeEngine
from visref.errors import InputError
from visref.exact import ExactScene
from visref.scene import Scene
from visref.visibility import FrameTruth, Ties, VisibilityBuffer

pytestmark = pytest.mark.slow

DRAWS = 2000
# A bound that holds in 95 % of draws holds in at least this many of 2,000 but once in 10,000
# experiments: 0.95 less 3.7 standard deviations of sqrt(0.95 0.05 / 2000).
LEAST_COVERAGE = 0.95 - 3.7 * math.sqrt(0.95 * 0.05 / DRAWS)


bound_of = cache(unseen_share_bound)


def one_over_m(new: int, rays: int, alpha: float = 0.05) -> float:
    """A bound that somebody might guess."""
    return (new + 1) / rays


def coverage(bound, shares: np.ndarray, find: int, holdout: int, seed: int) -> float:  # type: ignore[no-untyped-def]
    """How often the bound holds over draws: find objects of these shares of an image, freeze,
    and bound what is left by a hold-out."""
    rng = np.random.default_rng(seed)
    held = 0
    for _ in range(DRAWS):
        found = rng.multinomial(find, shares)[:-1] > 0
        truth = shares[:-1][~found].sum()
        new = rng.binomial(holdout, min(truth, 1.0))
        held += truth <= bound(int(new), holdout)
    return held / DRAWS


# Many objects of ever smaller share, and a background; about a dozen are left to find.
SHARES = np.append(0.5 * (w := 1.0 / np.arange(1, 400) ** 2.2) / w.sum(), 0.5)


@pytest.mark.parametrize(("find", "holdout"), [(2000, 500), (500, 2000), (5000, 5000)])
def test_the_bound_covers_the_truth_in_95_of_100_draws_and_a_wrong_one_does_not(
    find: int, holdout: int
) -> None:
    assert coverage(bound_of, SHARES, find, holdout, 1) >= LEAST_COVERAGE
    assert coverage(one_over_m, SHARES, find, holdout, 1) < LEAST_COVERAGE


def test_the_bound_covers_at_the_share_that_is_hardest_for_it() -> None:
    # Exactly at its own limit for k = 0 the bound fails in just under 5 % of draws.
    rays = 1000
    share = unseen_share_bound(0, rays) * (1 + 1e-9)
    new = np.random.default_rng(3).binomial(rays, share, DRAWS)
    fails = np.mean([bound_of(int(k), rays) < share for k in new])
    assert 0.03 < fails <= 1.0 - LEAST_COVERAGE


def test_one_random_ray_in_each_pixel_covers_no_less() -> None:
    # What is unseen fills some pixels nearly and others hardly: the worst for independence.
    rng = np.random.default_rng(5)
    for filled, slight in ((3, 0.0), (0, 3e-3), (2, 1e-3)):
        p = np.full(1000, slight)
        p[:filled] = 0.9
        new = (rng.random((DRAWS, len(p)), np.float32) < p).sum(axis=1)
        held = np.mean([p.mean() <= bound_of(int(k), len(p)) for k in new])
        assert held >= LEAST_COVERAGE


def test_looks_that_split_the_five_per_cent_hold_all_at_once_and_unsplit_ones_do_not() -> None:
    rng = np.random.default_rng(7)
    # Five looks with hold-outs of their own, each at the share that is hardest for its alpha.
    rates = {}
    for alpha in (0.05 / 5, 0.05):
        share = unseen_share_bound(0, 400, alpha) * (1 + 1e-9)
        new = rng.binomial(400, share, (DRAWS, 5))
        bounds = np.array([unseen_share_bound(k, 400, alpha) for k in range(new.max() + 1)])
        rates[alpha] = (bounds[new] >= share).all(axis=1).mean()
    assert rates[0.05 / 5] >= LEAST_COVERAGE
    assert rates[0.05] < LEAST_COVERAGE


def test_no_hit_gives_three_over_the_rays() -> None:
    assert unseen_share_bound(0, 1_228_800) == pytest.approx(3.0 / 1_228_800, rel=0.002)
    assert unseen_share_bound(0, 7) == pytest.approx(1 - 0.05 ** (1 / 7), rel=1e-12)
    assert unseen_share_bound(5, 5) == 1.0


@pytest.mark.parametrize(("new", "rays", "alpha"), [(1, 10, 0.05), (7, 60, 0.0125), (40, 90, 0.01)])
def test_hits_give_clopper_and_pearsons_limit_by_its_definition(
    new: int, rays: int, alpha: float
) -> None:
    p = Fraction(unseen_share_bound(new, rays, alpha))
    tail = sum(math.comb(rays, i) * p**i * (1 - p) ** (rays - i) for i in range(new + 1))
    assert float(tail) == pytest.approx(alpha, rel=1e-8)
    # So that Hoeffding's inequality applies to stratified rays.
    assert rays * p >= new + 1


def test_the_bound_refuses_what_it_cannot_mean() -> None:
    for new, rays in ((-1, 5), (6, 5), (0, 0)):
        with pytest.raises(ValueError, match="rays"):
            unseen_share_bound(new, rays)


def test_good_turing_is_the_share_of_what_was_met_once() -> None:
    assert good_turing(np.array([1, 5, 1, 0, 93])) == 2 / 100


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    width=st.sampled_from([4, 20, 1280]),
    height=st.sampled_from([4, 12, 960]),
    shift=st.sampled_from([(0.0, 0.0), (0.25, -3.125)]),
    orthographic=st.booleans(),
)
def test_the_nested_grids_rays_are_the_whole_cameras_bit_for_bit(
    seed: int, width: int, height: int, shift: tuple[float, float], orthographic: bool
) -> None:
    rng = np.random.default_rng(seed)
    camera = Camera(
        look_at(rng.normal(size=3) * 100, rng.normal(size=3)),
        width,
        height,
        near=0.1,
        yfov=None if orthographic else rng.uniform(0.1, 3.0),
        ymag=rng.uniform(0.1, 9.0) if orthographic else None,
        shift_x_px=shift[0],
        shift_y_px=shift[1],
    )
    subsets = nested_subsets(camera)
    assert subsets is not None
    for grid in [grid for grids in subsets.values() for grid in grids]:
        for x, y in rng.integers(0, (grid.camera.width, grid.camera.height), (4, 2)):
            ours = grid.camera.ray(x, y)
            whole = camera.ray(grid.step * x + grid.x, grid.step * y + grid.y)
            assert ours[0].tobytes() == whole[0].tobytes()
            assert ours[1].tobytes() == whole[1].tobytes()


def test_each_subset_holds_the_smaller_ones_and_its_share_of_the_samples() -> None:
    before = np.zeros((16, 16), np.bool_)
    for sixteenths, (step, starts) in SUBSETS.items():
        now = np.zeros_like(before)
        for x, y in starts:
            now[y::step, x::step] = True
        assert now.sum() == sixteenths * 16
        assert (now | ~before).all()
        # Evenly spread: every block of 4 x 4 holds the same samples.
        np.testing.assert_array_equal(now, np.roll(now, (4, 8), (0, 1)))
        before = now
    assert before.all()


def test_a_smaller_picture_has_other_samples() -> None:
    camera = Camera(np.eye(4), 16, 12, near=0.1, yfov=1.0)
    small = replace(camera, width=4, height=3)
    assert not set(small.column_a * 4) & set(camera.column_a)


@pytest.mark.parametrize(
    "change", [{"width": 15}, {"height": 13}, {"shift_x_px": 0.1}, {"shift_y_px": 1 / 3}]
)
def test_no_grids_where_they_would_not_be_the_same_samples(change: dict[str, float]) -> None:
    camera = Camera(np.eye(4), 16, 12, near=0.1, yfov=1.0)
    assert nested_subsets(camera) is not None
    changed = replace(camera, **change)
    subsets = nested_subsets(changed)
    if subsets is not None:
        # A part of a shift need not round.
        assert "shift_x_px" in change or "shift_y_px" in change
        for grid in subsets[1]:
            np.testing.assert_array_equal(grid.camera.row_b * 4, changed.row_b[:: grid.step])
            np.testing.assert_array_equal(grid.camera.column_a * 4, changed.column_a[:: grid.step])


def test_the_exact_subset_is_the_exact_frame_there() -> None:
    scene = random_soup(11)
    camera = Camera(np.eye(4), 24, 16, near=0.5, far=64.0, yfov=1.5)
    exact = ExactScene(scene)
    whole = exact.certify(camera).buffer
    subsets = nested_subsets(camera)
    assert subsets is not None
    for grid in [grid for grids in subsets.values() for grid in grids]:
        part = exact.certify(grid.camera).buffer
        at = np.s_[grid.y :: grid.step, grid.x :: grid.step]
        np.testing.assert_array_equal(part.triangle, whole.triangle[at])
        np.testing.assert_array_equal(part.depth, whole.depth[at])


def test_a_wrong_pixel_is_one_whose_owner_is_no_co_owner() -> None:
    scene = Scene.from_objects([(n, np.eye(3), np.array([[0, 1, 2], [0, 1, 2]])) for n in "abc"])
    camera = Camera(np.eye(4), 6, 1, near=0.1, yfov=1.0)
    exact = np.array([[0, 0, 0, 0, -1, 2]], np.int32)
    depth = np.where(exact >= 0, 1.0, np.inf)
    # Triangle 4, of object c, is level with sample 1's owner.
    ties = Ties(np.array([1]), np.array([4], np.int32))
    truth = FrameTruth(camera, "exact", VisibilityBuffer(exact, depth), ties)
    judged = np.ones(6, np.bool_)

    def wrong(*owners: int) -> tuple[int, int]:
        return wrong_owners(np.array(owners, np.int32), judged, truth, scene)

    assert wrong(0, 0, 0, 0, -1, 2) == (0, 0)
    # The tied one may own it; another triangle of its object is a wrong triangle alone.
    assert wrong(0, 4, 0, 0, -1, 2) == (0, 0)
    assert wrong(0, 5, 0, 0, -1, 2) == (0, 1)
    assert wrong(1, 0, 0, 0, -1, 2) == (0, 1)
    # Another object; nothing; something before nothing.
    assert wrong(4, 2, 0, 0, -1, 2) == (2, 2)
    assert wrong(-1, 0, 0, 0, 0, 2) == (2, 2)
    judged[:] = False
    assert wrong(4, 4, 4, 4, 4, 4) == (0, 0)


def test_jittered_points_fill_their_pixels_evenly() -> None:
    camera = Camera(np.eye(4), 40, 30, near=0.1, yfov=1.0, shift_x_px=0.25)
    a, b = jittered(camera, 3, 0)
    offset_x = (a.reshape(30, 40) - camera.column_a) / 2
    offset_y = (b.reshape(30, 40) - camera.row_b[:, None]) / 2
    for offset in (offset_x, offset_y):
        assert -0.5 <= offset.min() < -0.49
        assert 0.49 < offset.max() <= 0.5
        assert abs(offset.mean()) < 4 * math.sqrt(1 / 12 / 1200)
    assert not np.array_equal(a, jittered(camera, 3, 1)[0])
    np.testing.assert_array_equal(a, jittered(camera, 3, 0)[0])


CAMERA = Camera(np.eye(4), 32, 24, near=0.5, far=64.0, yfov=math.pi / 2)


def known_scene() -> Scene:
    """A wall; a block of 2 x 2 samples, so that a sixteenth of the samples need not meet it; a
    third of a pixel between samples; something behind the wall."""
    return build(
        quad(CAMERA, (0, 0, 32, 24), 8.0),
        quad(CAMERA, (5, 5, 7, 7), 4.0),
        quad(CAMERA, (20.6, 3.6, 20.9, 3.9), 4.0),
        quad(CAMERA, (8, 8, 20, 20), 9.0),
    )


@pytest.fixture(scope="module")
def measured() -> bench.Bench:
    return BenchRun(known_scene(), CameraPath((CAMERA, CAMERA)), [0, 1], 1).run()


def row_of(measured: bench.Bench, engine: str, sixteenths: int = ALL) -> ImageRow:
    return next(r for r in measured.image if (r.engine, r.sixteenths) == (engine, sixteenths))


def test_each_error_stands_in_its_own_column(measured: bench.Bench) -> None:
    for engine in ("exact", "embree", "embree:robust=false"):
        whole = row_of(measured, engine)
        assert (whole.visible, whole.rays) == (2 * 2, 2 * 32 * 24)
        assert whole.numeric_wrong_samples == whole.numeric_missed == whole.numeric_extra == 0
        assert whole.sampling_missed == 0
        # The square between the samples, in two frames.
        assert whole.definitional_missed == 2
        sixteenth = row_of(measured, engine, 1)
        assert sixteenth.rays == whole.rays // ALL
        # Samples (4 i, 4 j) alone: none of the block's (5, 5) to (6, 6).
        assert sixteenth.sampling_missed == 2
        assert sixteenth.numeric_wrong_samples == sixteenth.numeric_missed == 0
        assert row_of(measured, engine, 8).sampling_missed == 0


def test_geometric_rows_count_against_all_that_is_known(measured: bench.Bench) -> None:
    assert measured.objects_known == 2 * 3
    centres, *jitter, aimed = measured.geometric
    assert (centres.found, centres.missed_of_known) == (4, 2)
    assert (aimed.found, aimed.missed_of_known) == (6, 0)
    assert [row.rays_per_pixel for row in jitter] == [1, 2, 4, 8, 16]
    for row in jitter:
        assert row.found + row.missed_of_known == 6
        assert row.refuted == 0
    bounded = jitter[1:]
    assert jitter[0].bound is None
    # Half of the rays are the hold-out; two frames, four looks share the five per cent.
    assert measured.alpha_each == 0.05 / 8
    for row in bounded:
        assert row.holdout_rays == row.rays // 2
        least = unseen_share_bound(0, row.holdout_rays // 2, measured.alpha_each)
        assert row.bound == pytest.approx(least) if not row.holdout_new else row.bound > least
    # The bound is about a share: the square fills 0.09 of 768 pixels.
    assert all(row.bound > 0.09 / 768 for row in bounded if row.holdout_new)


def test_a_wrong_engine_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """An engine that moves everything by a sample, and one that sees nothing of an object."""

    class Shifted(EmbreeEngine):
        def frame(self, camera: Camera) -> FrameTruth:
            truth = super().frame(camera)
            moved = np.roll(truth.buffer.triangle, 1, axis=1)
            return replace(truth, buffer=VisibilityBuffer(moved, truth.buffer.depth))

    def make(spec: str, scene: Scene, *, threads: int | None = None) -> object:
        if spec == "embree:robust=false":
            return Shifted(scene, threads=threads)
        return make_engine(spec, scene, threads=threads)

    monkeypatch.setattr(timing, "make_engine", make)
    monkeypatch.setattr(timing, "ENGINES", ("exact", "embree", "embree:robust=false"))
    result = BenchRun(known_scene(), CameraPath((CAMERA,)), [0], 1).run()
    # The block of 2 x 2 moves by one: two samples gained, two lost.
    assert row_of(result, "embree:robust=false").numeric_wrong_samples == 4
    assert row_of(result, "embree").numeric_wrong_samples == 0


def test_an_engine_that_is_not_there_is_left_out_and_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def make(spec: str, scene: Scene, *, threads: int | None = None) -> object:
        if spec == "open3d":
            raise InputError("no Open3D here")
        return make_engine(spec, scene, threads=threads)

    monkeypatch.setattr(timing, "make_engine", make)
    monkeypatch.setattr(timing, "ENGINES", ("exact", "embree", "open3d"))
    odd = replace(CAMERA, width=30)
    result = BenchRun(known_scene(), CameraPath((odd,)), [0], 1).run()
    assert [what for what, _ in result.left_out] == ["open3d", "densities below 1"]
    assert {(row.engine, row.sixteenths) for row in result.image} == {
        ("exact", ALL),
        ("embree", ALL),
    }
    assert len(panels(result)) == 3
    assert "Fewer samples were not tried" in sentences(result)[1]


def with_numbers(exact_seconds: float, wrong: int) -> bench.Bench:
    rows = [
        ImageRow("exact", 16, exact_seconds, 100, 10),
        ImageRow("exact", 8, exact_seconds / 2, 50, 10, sampling_missed=2),
        ImageRow("embree", 16, 1.0, 100, 10, numeric_wrong_samples=wrong),
    ]
    geometric = [
        GeometricRow("pixel centres", None, 1.0, 100, 10, 3),
        GeometricRow("jittered rays", 16, 16.0, 1600, 12, 1, bound=2e-6),
        GeometricRow("centres, then aimed rays", None, 1.5, 150, 13, 0),
    ]
    return bench.Bench(rows, geometric, [0], 100, 13, 0.01)


def test_the_advice_follows_from_the_numbers() -> None:
    assert headline(with_numbers(1.1, 5)) == "Pay for exact, no more"
    assert headline(with_numbers(2.1, 5)) == "Stop at embree"
    numeric, sampling, definitional = sentences(with_numbers(1.1, 5))
    assert numeric.startswith("Exact costs 1.1× what Embree costs here and leaves no numeric error")
    assert "5 samples of 100 to a wrong object, and of 10 visible objects misses none" in numeric
    assert "half of the samples takes 50.0 % of the time and loses 2 of 10" in sampling
    assert "aimed rays find 3 of the 3 for 0.5 s" in definitional
    assert "16 rays in every pixel find 2 for 16 s" in definitional
    assert "2.0e-06 of the image" in definitional
    assert "makes no numeric error" in sentences(with_numbers(2.1, 0))[0]
    assert "cannot know it" in sentences(with_numbers(1.0, 0))[0]


def test_the_front_has_no_point_that_another_beats() -> None:
    points = [(1.0, 5.0), (2.0, 5.0), (2.0, 3.0), (3.0, 4.0), (4.0, 0.0), (1.0, 6.0)]
    front = pareto(points, lambda p: p[0], lambda p: p[1])
    assert front == [(1.0, 5.0), (2.0, 3.0), (4.0, 0.0)]


@pytest.mark.slow
def test_the_plot_is_the_same_bytes_for_the_same_numbers() -> None:
    numbers = with_numbers(1.1, 5)
    assert pictures(numbers, "a title") == pictures(numbers, "a title")
    svg, _ = pictures(numbers, "a title")
    assert svg.startswith("<svg")
    assert "wrong object" in svg
    errors = {p.title: p.points for p in panels(numbers)}
    assert (
        Point("embree", "embree", 1.0, 0.05) in errors["Numeric error: all samples, against exact"]
    )


@pytest.mark.slow
def test_the_command_writes_the_folder_and_the_page_stands_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(timing, "ENGINES", ("exact", "embree"))
    monkeypatch.setattr(timing, "REPEATS", 1)
    path = tmp_path / "path.json"
    camera = replace(CAMERA, world_from_camera=look_at((0, 30, 60), (0, 0, 0)), far=1000.0)
    frames = [{"world_from_camera": camera.world_from_camera.tolist()}]
    path.write_text(
        json.dumps({"format": "visref-path", "version": 1, "width": 32, "height": 24,
                    "near": 0.5, "far": 1000.0, "yfov": 1.0, "frames": frames})
    )  # fmt: skip
    out = tmp_path / "out"
    arguments = ["bench", "city:scale=0.02", "--path", str(path), "--out", str(out)]
    assert cli.main(arguments) == 0
    names = {file.name for file in out.iterdir()}
    assert names == {f"bench.{kind}" for kind in ("json", "csv", "md", "svg", "png", "html")}
    record = json.loads((out / "bench.json").read_text())
    assert record["format"] == "visref-bench"
    page, table = (out / "bench.html").read_text(), (out / "bench.md").read_text()
    for sentence in record["says"]:
        assert sentence in capsys.readouterr().out or sentence in table
        assert sentence in table
        assert sentence in page
    # No address but the names of XML's own vocabularies.
    assert "src=" not in page
    assert "@import" not in page
    rows = list(csv.DictReader((out / "bench.csv").read_text().splitlines()))
    assert len(rows) == len(record["image"]) + len(record["geometric"])
    assert {row["promise"] for row in rows} == {"image", "geometric"}
    # A bench folder is replaced, another one is not.
    assert cli.main(arguments) == 0
    (out / "bench.json").unlink()
    assert cli.main(arguments) == 2


def test_engine_options_are_read_and_refused_by_name() -> None:
    scene = known_scene()
    assert make_engine("embree:robust=false", scene).frame(CAMERA).engine == "embree"
    for spec in ("embree:robust=maybe", "embree:depth=24", "exact:robust=true", "gl:depth=16"):
        with pytest.raises(InputError, match=spec.partition(":")[2].partition("=")[0]):
            make_engine(spec, scene)
    assert cli.main(["truth", "city:scale=0.02", "--engine", "embree:x=1", "--out", "t"]) == 2


@pytest.mark.parametrize("bundled", [True, False])
def test_robust_mode_is_stated_to_the_library(
    bundled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    from visref.engines import embree

    given: list[bool] = []

    class Spy(embree.SingleRays):
        """Casts as ever, since an engine asks for known samples when it is made."""

        def __init__(self, *arguments: Any, robust: bool) -> None:
            given.append(robust)
            # `PacketScene` gets the library before them.
            super().__init__(*arguments[-2:], robust=robust)

    monkeypatch.setattr(embree, "load_library", lambda: object() if bundled else None)
    monkeypatch.setattr(embree, "PacketScene" if bundled else "SingleRays", Spy)
    for spec in ("embree", "embree:robust=true", "embree:robust=false"):
        make_engine(spec, known_scene(), threads=1)
    assert given == [True, True, False]
