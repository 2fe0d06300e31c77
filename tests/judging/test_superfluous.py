"""What was drawn for nothing is confirmed by the rules, whatever engine cast the truth."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from tests.support.exact_brute import Sample, hits, truth
from tests.support.exact_scenes import random_case
from tests.support.hand_made import camera, scene_of_squares, square
from visref.camera import Camera
from visref.engines import make_engine
from visref.exact import ExactScene
from visref.judging import superfluous
from visref.judging.holders import DrawList, UnitsSeen
from visref.judging.superfluous import confirm, superfluous_units
from visref.scene import Alpha, Int32, Scene, Units
from visref.visibility import FrameTruth, objects_seen

pytestmark = pytest.mark.slow


def random_units(rng: np.random.Generator, scene: Scene) -> Units:
    """Every triangle in some unit; units overlap, one may be empty."""
    count = scene.triangle_count
    first = np.array_split(rng.permutation(count), int(rng.integers(1, 6)))
    parts = [np.sort(part) for part in first]
    parts += [np.flatnonzero(rng.random(count) < 0.4) for _ in range(3)]
    sizes = [len(part) for part in parts]
    return Units(np.cumsum([0, *sizes]), np.concatenate(parts).astype(np.int32), "part")


def hidden(
    scene: Scene, view: Camera, units: Units, expectation: list[Sample]
) -> dict[int, list[tuple[int, float]]]:
    """By unit with triangles that is hidden everywhere: its (sample, gap in depth) by hit."""
    found: dict[int, list[tuple[int, float]]] = {}
    every = hits(scene, view)
    for unit in range(units.count):
        own = set(units.triangles[units.offsets[unit] : units.offsets[unit + 1]].tolist())
        if not own:
            continue
        met, clear = [], False
        for at, (sample, here) in enumerate(zip(expectation, every, strict=True)):
            seen = set(sample.tied).union(*sample.blend.values())
            mine = [(t, i) for t, i in here if i in own]
            clear = clear or (bool(mine) and len(sample.doubt) > 0)
            clear = clear or any(i in seen for _, i in mine)
            met += [
                (at, float(t - sample.nearest) if sample.nearest is not None else np.inf)
                for t, _ in mine
            ]
        if not clear:
            found[unit] = met
    return found


def shown_nowhere(scene: Scene, frame: FrameTruth, units: Units, drawn: Int32) -> Int32:
    draws = DrawList.of_units(scene, units, drawn)
    return superfluous_units(scene, UnitsSeen.of(frame, objects_seen(frame, scene), draws), draws)


def check(scene: Scene, view: Camera, units: Units, engine: str) -> Counter[str]:
    """Raise where units are confirmed otherwise than the brute force says."""
    expectation = truth(scene, view)
    expected = hidden(scene, view, units, expectation)
    drawn = np.flatnonzero(units.sizes > 0).astype(np.int32)
    frame = make_engine(engine, scene, threads=1).frame(view)
    asked = shown_nowhere(scene, frame, units, drawn)
    if engine == "exact":
        # The cheap look leaves no hidden unit out.
        assert set(expected) <= set(asked.tolist())
        for_all = confirm(ExactScene(scene, threads=1), frame, units, drawn)
        assert [one.unit for one in for_all] == sorted(expected)
    confirmed = confirm(ExactScene(scene, threads=1), frame, units, asked)
    assert [one.unit for one in confirmed] == sorted(set(expected) & set(asked.tolist()))
    for one in confirmed:
        met = expected[one.unit]
        assert one.samples == len({sample for sample, _ in met})
        if not met:
            assert (one.occluder, one.sample) == (-1, -1)
            continue
        assert one.occluder in (expectation[one.sample].tied or [-1])
        # Depths are float64 there: the closest, but for their rounding.
        least, scale = min(gap for _, gap in met), float(expectation[one.sample].nearest or 1)
        there = min(gap for sample, gap in met if sample == one.sample)
        assert there == least or there - least <= 1e-6 * abs(scale)
    return Counter(
        hidden=len(expected),
        shown=len(drawn) - len(expected),
        uncovering=sum(not met for met in expected.values()),
        cleared=len(asked) - len(confirmed),
        tied=sum(len(sample.tied) > 1 for sample in expectation),
        doubt=sum(len(sample.doubt) > 0 for sample in expectation),
        glass=sum(len(sample.blend) > 0 for sample in expectation),
    )


@pytest.mark.parametrize("engine", ["exact", "embree"])
@pytest.mark.parametrize("chunk", range(3))
def test_confirmed_units_are_those_that_a_brute_force_finds_hidden(engine, chunk):
    seen: Counter[str] = Counter()
    for index in range(70):
        scene, view = random_case(40 + chunk, index)
        rng = np.random.default_rng([chunk, index])
        try:
            seen += check(scene, view, random_units(rng, scene), engine)
        except AssertionError as error:
            raise AssertionError(f"random_case({40 + chunk}, {index}): {error}") from error
    assert min(seen[kind] for kind in ("hidden", "shown", "tied", "doubt", "glass")) > 5
    assert seen["uncovering"] > 0
    if engine == "embree":
        assert seen["cleared"] > 0


def test_units_are_confirmed_alike_whatever_is_looked_at_together(monkeypatch):
    scene, view = random_case(41, 3)
    units = random_units(np.random.default_rng(1), scene)
    exact = ExactScene(scene, threads=1)
    frame, every = exact.certify(view), np.flatnonzero(units.sizes > 0).astype(np.int32)
    whole = confirm(exact, frame, units, every)
    monkeypatch.setattr(superfluous, "_TRIANGLES", 2)
    assert confirm(exact, frame, units, every) == whole


def test_every_hit_is_listed_whatever_lies_before_it():
    found = 0
    for index in range(60):
        scene, view = random_case(44, index)
        usable = np.random.default_rng(index).random(scene.triangle_count) < 0.6
        got = ExactScene(scene, threads=1).hits(view, usable)
        expected = [
            (sample, i)
            for sample, here in enumerate(hits(scene, view))
            for _, i in here
            if usable[i]
        ]
        pairs = list(zip(got.sample.tolist(), got.triangle.tolist(), strict=True))
        assert sorted(pairs) == sorted(expected)
        found += len(expected)
    assert found > 500


def with_alpha(scene: Scene, *kinds: Alpha) -> Scene:
    return replace(scene, alpha=np.repeat(np.array(kinds, np.uint8), 2))


@pytest.mark.parametrize("engine", ["exact", "embree"])
@pytest.mark.parametrize(
    ("kinds", "confirmed"),
    [
        # Front to back: what is asked about is the last one.
        ((Alpha.OPAQUE, Alpha.OPAQUE), True),
        ((Alpha.OPAQUE, Alpha.BLEND), True),
        ((Alpha.BLEND, Alpha.OPAQUE), False),
        ((Alpha.MASK, Alpha.OPAQUE), False),
        ((Alpha.BLEND, Alpha.BLEND), False),
        ((Alpha.MASK, Alpha.BLEND), False),
    ],
)
def test_doubt_and_glass_clear_a_unit(engine, kinds, confirmed):
    scene = with_alpha(scene_of_squares(0.0, -3.0), *kinds)
    frame = make_engine(engine, scene).frame(camera())
    units = scene.object_units()
    found = confirm(ExactScene(scene), frame, units, np.array([1], np.int32))
    assert bool(found) == confirmed
    if confirmed:
        assert found[0].samples == camera().samples
        assert scene.object_of_triangle[found[0].occluder] == 0


@pytest.mark.parametrize("engine", ["exact", "embree"])
@pytest.mark.parametrize(
    ("middle", "hidden"), [(Alpha.OPAQUE, [1]), (Alpha.MASK, []), (Alpha.BLEND, [])]
)
def test_glass_that_is_seen_clears_none_of_its_object_that_is_hidden(engine, middle, hidden):
    """An object of two panes, a unit each, with a square between them: the front pane is seen,
    the back one behind an opaque square is not, and behind a masked one it may be."""
    squares = scene_of_squares(0.0, -6.0, -3.0)
    panes = Scene(
        squares.vertices,
        squares.triangles,
        np.array([0, 4, 6]),
        ("panes", "between"),
        alpha=np.repeat(np.array([Alpha.BLEND, Alpha.BLEND, middle], np.uint8), 2),
    )
    units = Units(np.array([0, 2, 4, 6]), np.arange(6, dtype=np.int32), "pane")
    frame = make_engine(engine, panes).frame(camera())
    drawn = np.array([0, 1, 2], np.int32)
    found = shown_nowhere(panes, frame, units, drawn)
    assert found.tolist() == hidden
    assert [one.unit for one in confirm(ExactScene(panes), frame, units, found)] == hidden


def test_the_nearest_occluder_is_the_one_that_comes_closest():
    scene = Scene.from_objects(
        [
            ("hidden", *square(-2.0, -1.0, -3.0, 4.0)),
            ("far before it", *square(-2.0, -1.0, 3.0, 2.0)),
            ("just before it", *square(0.0, -1.0, -2.0, 2.0)),
        ]
    )
    exact = ExactScene(scene)
    (found,) = confirm(
        exact, exact.certify(camera()), scene.object_units(), np.array([0], np.int32)
    )
    assert found.samples == 8
    assert scene.object_of_triangle[found.occluder] == 2
    # The row-wise first of its samples, in the right half.
    assert found.sample == 2
