"""What a witness keeps of its surroundings is the truth there, and what was drawn."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.support.hand_made import scene_of_squares, settled, square, triangle_units
from visref.camera import Camera, look_at
from visref.culler import Promise
from visref.engines import make_engine
from visref.errors import InputError
from visref.exact import REACH_PX, ExactScene
from visref.judging.holders import DrawList
from visref.judging.judge import Miss, MissKind, judge
from visref.judging.misses import Misses
from visref.judging.settle import settle
from visref.run_folder.balls import balls_about
from visref.run_folder.claims import _check_surroundings, _read_surroundings
from visref.run_folder.cuts import Cut, CutKeeper, FrameCuts
from visref.run_folder.json_fields import Fields
from visref.run_folder.layout import (
    CLOSE_SIDE,
    MAX_APPEARANCES,
    MAX_MARGIN_PX,
    OTHERS,
    SURROUNDED_CELLS,
)
from visref.run_folder.panels import unrun
from visref.run_folder.surroundings import Surroundings
from visref.scene import Alpha, Scene
from visref.visibility import FrameTruth, VisibilityBuffer


def view(width: int, height: int, **lens: float) -> Camera:
    lens = lens or {"ymag": height / 2}
    return Camera(look_at((0, 0, 20.0), (0, 0, 0)), width, height, near=1.0, far=99.0, **lens)


def frame_of(scene, camera, drawn, units=None):
    frame_truth = make_engine("exact", scene).frame(camera)
    exact = ExactScene(scene)
    draws = DrawList.of_units(scene, units or scene.object_units(), np.array(drawn, np.int32))
    return settle(scene, frame_truth, draws, exact=lambda: exact)


def record_of(scene: Scene, frame, miss: Miss) -> tuple[Cut, dict]:
    cut = FrameCuts(frame).of(miss)
    around = Surroundings(scene, balls_about(scene.vertices[scene.triangles]))
    return cut, around.record(frame.truth.camera, cut, miss.object, miss.sample, frame.drawn)


def cells_of(record: dict, name: str, key: str = "object") -> np.ndarray:
    shape = (record["height"], record["width"]) if name != "close" else (CLOSE_SIDE, CLOSE_SIDE)
    values = [-9 if look[key] is None else look[key] for look in record["appearances"]]
    return np.array(values)[unrun(record[name], shape)]


def objects_by(scene: Scene, triangle: np.ndarray) -> np.ndarray:
    return np.where(triangle >= 0, scene.object_of_triangle[triangle], -9)


def boxes(rng: np.random.Generator, count: int = 9) -> Scene:
    places = rng.uniform((-9, -7, -6), (9, 7, 6), (count, 3))
    sizes = rng.uniform(1.0, 6.0, count)
    return Scene.from_objects([(f"o{i}", *square(*places[i], sizes[i])) for i in range(count)])


@pytest.mark.parametrize("lens", [{"yfov": 0.8}, {"ymag": 8.0}, {"yfov": 0.7, "shift_x_px": 5.25}])
@pytest.mark.parametrize("size", [(24, 16), (150, 90)])
def test_a_cut_holds_the_truths_owners_and_what_a_cast_of_the_drawn_finds(lens, size) -> None:
    rng = np.random.default_rng(7)
    told = 0
    for _ in range(5):
        scene, camera = boxes(rng), view(*size, **lens)
        drawn = np.flatnonzero(rng.random(scene.object_count) < 0.6)
        frame = frame_of(scene, camera, drawn)
        # An independent cast of a scene in which the others are not.
        left = Scene.from_objects(
            [(scene.names[o], scene.vertices[scene.triangles[2 * o : 2 * o + 2]].reshape(-1, 3),
              np.arange(6).reshape(2, 3)) for o in drawn]
        )  # fmt: skip
        cast = make_engine("exact", left).frame(camera).buffer.triangle
        expected = np.where(cast >= 0, drawn[left.object_of_triangle[cast]], -9)
        owners = objects_by(scene, frame.truth.buffer.triangle)
        for miss in judge(frame, Promise.CONSERVATIVE).misses:
            cut, record = record_of(scene, frame, miss)
            rows = cut.y + cut.step * np.arange(record["height"])
            columns = cut.x + cut.step * np.arange(record["width"])
            x, y = miss.sample % camera.width, miss.sample // camera.width
            assert x in columns
            assert y in rows
            at = np.ix_(rows, columns)
            assert np.array_equal(cut.triangle, frame.truth.buffer.triangle[at])
            assert np.array_equal(cells_of(record, "truth"), owners[at])
            assert np.array_equal(cells_of(record, "drawn"), expected[at])
            mine = cells_of(record, "truth", "lost").astype(bool)
            assert np.array_equal(mine, owners[at] == miss.object)
            told += 1
    assert told > 5


@pytest.mark.parametrize("size", [(1, 1), (8, 8), (200, 3), (5, 130)])
@pytest.mark.parametrize("corner", [False, True])
def test_a_cut_stays_in_the_image_and_holds_its_witness(size, corner) -> None:
    width, height = size
    scene = scene_of_squares(0.0, 1.0)
    triangle = np.zeros((height, width), np.int32)
    at = (height - 1, width - 1) if corner else (height // 2, width // 2)
    triangle[at] = 2
    camera = Camera(
        look_at((0, 0, 10.0), (0, 0, 0)), width, height, near=1.0, far=99.0, ymag=height / 2
    )
    frame_truth = FrameTruth(
        camera, "hand", VisibilityBuffer(triangle, np.full(triangle.shape, 9.0))
    )
    frame = settled(scene, frame_truth, scene.object_units(), [0])
    (miss,) = judge(frame, Promise.CONSERVATIVE).misses
    cut, record = record_of(scene, frame, miss)
    assert cut.triangle.shape == (min(height, SURROUNDED_CELLS), min(width, SURROUNDED_CELLS))
    assert cut.step == 1
    assert np.count_nonzero(cut.lost) == 1
    assert cut.lost[at[0] - cut.y, at[1] - cut.x]
    assert record["x"] + record["width"] <= width
    assert record["y"] + record["height"] <= height
    assert np.array_equal(Cut.unpacked(cut.packed()).lost, cut.lost)


def test_what_is_lost_over_a_large_image_is_told_whole_with_as_much_again() -> None:
    scene = Scene.from_objects([("big", *square(-300.0, -40.0, 0.0, 500.0))])
    camera = view(1200, 700)
    frame = frame_of(scene, camera, [])
    (miss,) = judge(frame, Promise.CONSERVATIVE).misses
    cut, _ = record_of(scene, frame, miss)
    lost = np.argwhere(objects_by(scene, frame.truth.buffer.triangle) == 0)
    first, last = lost.min(axis=0), lost.max(axis=0)
    assert cut.step > 1
    for low, high, start, cells in zip(
        first, last, (cut.y, cut.x), cut.triangle.shape, strict=True
    ):
        assert start <= low + cut.step
        assert start + cut.step * cells >= high - cut.step


def test_a_lost_part_shows_as_lost_though_the_same_object_lies_behind_it() -> None:
    front, back = square(-3.0, -3.0, 0.0, 6.0), square(-6.0, -6.0, -5.0, 12.0)
    points = np.concatenate([front[0], back[0]])
    scene = Scene.from_objects([("both", points, np.concatenate([front[1], back[1] + 4]))])
    frame = frame_of(scene, view(16, 16), [2, 3], triangle_units(scene))
    (miss,) = judge(frame, Promise.CONSERVATIVE).misses
    assert miss.partly
    _, record = record_of(scene, frame, miss)
    assert np.count_nonzero(cells_of(record, "truth", "lost") == 1) == 36
    # By its own other half.
    assert (cells_of(record, "drawn")[5:11, 5:11] == 0).all()


def test_lost_glass_is_told_beside_what_stands_behind_it() -> None:
    scene = Scene.from_objects(
        [("wall", *square(-9.0, -9.0, -4.0, 18.0)), ("pane", *square(-2.0, -2.0, 0.0, 4.0))]
    )
    alpha = scene.alpha.copy()
    alpha[2:] = Alpha.BLEND
    scene = replace(scene, alpha=alpha)
    frame = frame_of(scene, view(12, 12), [0])
    (miss,) = judge(frame, Promise.CONSERVATIVE).misses
    _, record = record_of(scene, frame, miss)
    pane = np.zeros((12, 12), bool)
    pane[4:8, 4:8] = True
    assert np.array_equal(cells_of(record, "truth", "glass") == 1, pane)
    assert np.array_equal(cells_of(record, "truth", "lost") == 1, pane)
    assert (cells_of(record, "truth") == 0).all()
    assert (cells_of(record, "drawn", "glass") == -9).all()
    # All drawn, nothing is lost, and the pane is in both.
    whole = frame_of(scene, view(12, 12), [0, 1])
    cut = FrameCuts(whole).of(replace(miss, samples=0))
    assert np.array_equal(cut.glass_drawn >= 0, pane)


def test_the_closer_sight_shows_what_lies_between_the_samples() -> None:
    # A fence a quarter of a pixel wide beside the sample, which owns none.
    scene = Scene.from_objects(
        [("wall", *square(-9.0, -9.0, -4.0, 18.0)), ("post", *strip(0.625, 0.875, 2.0))]
    )
    camera = view(12, 12)
    frame = frame_of(scene, camera, [1])
    (miss,) = judge(frame, Promise.CONSERVATIVE).misses
    miss = replace(miss, sample=6 * 12 + 6)
    _, record = record_of(scene, frame, miss)
    assert (cells_of(record, "truth") == 0).all()
    close = cells_of(record, "close")
    # Pixel 6 spans x = 0 to 1 and begins at column 24: the post takes two of its eight cells.
    post = np.zeros((CLOSE_SIDE, CLOSE_SIDE), bool)
    post[:, 24 + 5 : 24 + 7] = True
    assert np.array_equal(close == 1, post)


def strip(left: float, right: float, z: float) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[left, -9, z], [right, -9, z], [right, 9, z], [left, 9, z]])
    return corners, np.array([[0, 1, 2], [0, 2, 3]])


def test_nothing_makes_a_record_larger_than_is_said() -> None:
    rng = np.random.default_rng(3)
    # An object of its own at every sample, each lit otherwise, and one that is lost.
    corners, camera = [], view(64, 64)
    for index in range(64 * 64):
        x, y = index % 64 - 32, index // 64 - 32
        tilt = rng.uniform(-0.4, 0.4, (3, 1)) * (0, 0, 1.0)
        corners.append(np.array([[x, y, 0], [x + 2, y, 0], [x, y + 2, 0.0]]) + tilt)
    scene = Scene.from_objects([(f"o{i}" * 90, c, [[0, 1, 2]]) for i, c in enumerate(corners)])
    frame = frame_of(scene, camera, np.arange(scene.object_count)[1::2])
    miss = judge(frame, Promise.CONSERVATIVE).misses[0]
    _, record = record_of(scene, frame, miss)
    assert len(record["appearances"]) == MAX_APPEARANCES
    assert record["appearances"][-1]["object"] == OTHERS
    assert len(json.dumps(record)) < 200_000
    lost = cells_of(record, "truth", "lost") == 1
    assert lost.any()
    assert (cells_of(record, "truth")[lost] == miss.object).all()


@pytest.mark.parametrize("most", [4, 2])
def test_the_keeper_has_the_worst_misses_and_the_worst_of_each_object(most, monkeypatch) -> None:
    monkeypatch.setattr("visref.run_folder.cuts.VERDICT_CUTS", most)
    rng = np.random.default_rng(11)
    scene = scene_of_squares(*np.linspace(0.0, 1.0, 12))
    camera = Camera(look_at((0, 0, 10.0), (0, 0, 0)), 4, 2, near=1.0, far=99.0, ymag=1.0)
    buffer = VisibilityBuffer(np.zeros((2, 4), np.int32), np.full((2, 4), 9.0))
    frame = settled(scene, FrameTruth(camera, "hand", buffer), scene.object_units(), [])
    # What was forgotten is given back at once.
    monkeypatch.setattr("visref.run_folder.cuts._FORGOTTEN", 0)
    keeper, every = CutKeeper(2), []
    for number in range(30):
        among = (MissKind.CONFIRMED, MissKind.LATE, MissKind.TIE)
        kinds = [among[place] for place in rng.integers(0, 3, 4)]
        misses = tuple(
            Miss(int(o), kind, int(rng.integers(1, 9)), 9, 0, 2 * int(o), 9.0, width=4)
            for o, kind in zip(rng.choice(12, 4, replace=False), kinds, strict=True)
        )
        keeper.add(number, Misses.of(misses), (frame,))
        worst = sorted(misses, key=lambda miss: (-miss.samples, miss.object))
        every += [(number, miss) for miss in worst[:most]]
    every.sort(key=lambda one: (-one[1].samples, one[0], one[1].object))
    wanted = {(number, miss.object) for number, miss in every[:2]}
    convicted: set[int] = set()
    for number, miss in every:
        if miss.kind is MissKind.CONFIRMED and miss.object not in convicted:
            convicted.add(miss.object)
            wanted.add((number, miss.object))
    kept = {(number, miss.object) for number, miss in every if keeper.get(number, "", miss.object)}
    assert kept == wanted
    assert len(wanted) < len(every)
    for number, obj in kept:
        assert keeper.get(number, "", obj).triangle.tolist() == buffer.triangle.tolist()


def test_a_cut_that_is_neither_of_the_worst_nor_its_objects_worst_any_more_is_let_go_once() -> None:
    scene = scene_of_squares(0.0, 1.0)
    camera = Camera(look_at((0, 0, 10.0), (0, 0, 0)), 4, 2, near=1.0, far=99.0, ymag=1.0)
    buffer = VisibilityBuffer(np.zeros((2, 4), np.int32), np.full((2, 4), 9.0))
    frame = settled(scene, FrameTruth(camera, "hand", buffer), scene.object_units(), [])
    keeper = CutKeeper(1)
    for number, samples in enumerate((3, 5, 2, 8)):
        miss = Miss(0, MissKind.CONFIRMED, samples, 9, 0, 2, 9.0, width=4)
        keeper.add(number, Misses.of((miss,)), (frame,))
    assert [keeper.get(number, "", 0) is not None for number in range(4)] == [False] * 3 + [True]


def test_readers_know_how_far_a_margin_is_told() -> None:
    assert MAX_MARGIN_PX == REACH_PX


SPOILT = {
    "runs that end early": {"truth": [3, 0]},
    "runs without end": {"truth": [1 << 62, 0, 1 << 62, 0]},
    "half a run": {"drawn": [4]},
    "an appearance that is not there": {"close": [CLOSE_SIDE**2, 99]},
    "too many cells": {"width": 49},
    "no step": {"step": 0},
    "cells outside the image": {"x": 5000},
    "a negative cell": {"y": -1},
    "an object that is none": {
        "appearances": [{"object": -2, "shade": 0, "glass": None, "lost": 0}]
    },
    "too bright": {"appearances": [{"object": 1, "shade": 16, "glass": None, "lost": False}]},
}


@pytest.fixture(scope="module")
def witness() -> dict:
    scene = Scene.from_objects([("wall", *square(-9.0, -9.0, -4.0, 18.0))])
    frame = frame_of(scene, view(12, 12), [])
    (miss,) = judge(frame, Promise.CONSERVATIVE).misses
    _, record = record_of(scene, frame, miss)
    return {"samples": frame.truth.camera.definition(), "surroundings": record}


@pytest.mark.parametrize("spoilt", SPOILT)
def test_spoilt_surroundings_are_a_clear_error(witness, spoilt) -> None:
    def read(value: dict) -> None:
        fields = Fields(value, "here", "mend it")
        _read_surroundings(fields.inner("surroundings"))
        _check_surroundings(fields, value)

    read(witness)
    with pytest.raises(InputError, match="surroundings"):
        read({**witness, "surroundings": {**witness["surroundings"], **SPOILT[spoilt]}})
