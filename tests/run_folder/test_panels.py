"""Pictures of a witness: named without overlaps, to scale, outlined, the same bytes each time."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.run_folder.test_surroundings import boxes, frame_of, record_of, view
from tests.support.hand_made import square
from visref.culler import Promise
from visref.judging.judge import judge
from visref.judging.outcome import witness_json
from visref.run_folder.colours import MISSED_RGB
from visref.run_folder.labels import Named, place, shown_texts
from visref.run_folder.panels import PANEL_PX, _scale, composed, panels, world_per_sample
from visref.scene import Scene


def witness_of(scene, camera, drawn, margin=2.5):
    frame = frame_of(scene, camera, drawn)
    miss = replace(judge(frame, Promise.CONSERVATIVE).misses[0], width=camera.width)
    _, record = record_of(scene, frame, miss)
    witness = witness_json(scene, 0, miss) | {"margin_px": margin, "samples": camera.definition()}
    return witness | {"surroundings": record}


def apart(one, other):
    return one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]


@pytest.mark.parametrize("seed", range(6))
def test_labels_overlap_neither_each_other_nor_what_is_taken_and_point_at_their_object(seed):
    rng = np.random.default_rng(seed)
    ids = np.kron(rng.integers(0, 9, (12, 12)), np.ones((32, 32), int))
    named = [Named("name" * int(rng.integers(1, 9)), ids == one) for one in range(9)]
    taken = [(0, 350, 150, 384), (100, 100, 160, 130)]
    labels = place(named, ids.shape, taken)
    assert len(labels) >= 7
    for one, other in itertools.combinations([label.box for label in labels] + taken, 2):
        assert apart(one, other) or {one, other} == set(taken)
    for label in labels:
        left, top, right, bottom = label.box
        assert 0 <= left < right <= 384
        assert 0 <= top < bottom <= 384
        x, y = label.anchor
        assert any(n.where[y, x] for n in named)
        if label.inside:
            assert any(n.where[top:bottom, left:right].all() for n in named)


def test_a_name_that_does_not_fit_its_object_stands_beside_it():
    where = np.zeros((200, 200), bool)
    where[100:104, 100:104] = True
    (label,) = place([Named("a long enough name", where)], where.shape)
    assert not label.inside
    assert where[label.anchor[1], label.anchor[0]]
    assert not where[label.box[1] : label.box[3], label.box[0] : label.box[2]].any()
    (label,) = place([Named("x", ~where)], where.shape)
    assert label.inside


def test_names_lose_the_end_that_all_share_and_their_middle():
    texts = ["12_house_of_some_maker_Chair/visual/0", "3_Window/visual/0", "\u6905/visual/0"]
    assert shown_texts(texts) == ["12_hou...ome_maker_Chair", "3_Window", "?"]
    assert shown_texts(["a/b", "a/b"]) == ["a/b", "a/b"]
    assert shown_texts(["alone/b"]) == ["alone/b"]


@pytest.mark.parametrize(
    ("lens", "wide"), [({"ymag": 6.0}, 1.0), ({"yfov": 2 * np.arctan(0.5)}, 2.0)]
)
def test_the_scale_is_the_width_of_a_pixel_at_the_witness(lens, wide):
    # Twelve rows: orthographic 12 units high; in perspective 24 at a depth of 24.
    scene = Scene.from_objects([("wall", *square(-50.0, -50.0, -4.0, 100.0))])
    witness = witness_of(scene, view(12, 12, **lens), [])
    assert world_per_sample(witness) == pytest.approx(wide)
    # A cell is 32 pixels wide, and the bar two of them.
    _, words, length = _scale(witness, 32.0)
    assert (words, length) == (f"2 px = {2 * wide:g} units", 64)


def test_the_outline_goes_around_what_is_lost_in_both_pictures():
    scene = Scene.from_objects(
        [("wall", *square(-9.0, -9.0, -4.0, 18.0)), ("box", *square(-2.0, 1.0, 0.0, 3.0))]
    )
    ought, drawn, close = panels(witness_of(scene, view(12, 12), [0], margin=0.0))
    # Cells of 32 pixels: columns 4 to 6, rows 2 to 4.
    lost = np.zeros((PANEL_PX, PANEL_PX), bool)
    lost[64:160, 128:224] = True
    for panel in (ought, drawn):
        pixels = np.asarray(panel.image)
        edge = (pixels == MISSED_RGB).all(axis=2)
        assert not (edge & ~lost).any()
        ring = lost.copy()
        ring[66:158, 130:222] = False
        assert (edge & ring).sum() > 0.9 * ring.sum()
    # In the one it is filled, in the other the wall shows.
    inside = np.s_[120:150, 200:215]
    reds = [np.asarray(panel.image, float)[inside] for panel in (ought, drawn)]
    assert (reds[0][..., 0] - reds[0][..., 2]).min() > 80
    assert (reds[1][..., 0] - reds[1][..., 2]).max() < 40
    assert close.image.size == (PANEL_PX, PANEL_PX)


@pytest.mark.parametrize("size", [(1, 1), (8, 8), (3, 70), (640, 360)])
def test_every_size_of_image_has_its_pictures_and_the_same_bytes(size):
    witness = witness_of(boxes(np.random.default_rng(1)), view(*size, ymag=6.0), [])
    one, other = (composed(panels(witness)).tobytes() for _ in range(2))
    assert one == other
    for panel in panels(witness):
        assert panel.image.size == (PANEL_PX, PANEL_PX)


def test_the_picture_of_a_corner_has_the_witness_in_it():
    scene = Scene.from_objects(
        [("wall", *square(-90.0, -90.0, -4.0, 180.0)), ("box", *square(39.0, -40.0, 0.0, 1.0))]
    )
    witness = witness_of(scene, view(80, 80), [0])
    around = witness["surroundings"]
    assert (witness["x"], witness["y"]) == (79, 79)
    assert (around["x"] + around["width"], around["y"] + around["height"]) == (80, 80)
    ought = np.asarray(panels(witness)[0].image)
    assert (ought[-6:, -6:] == MISSED_RGB).all(axis=2).any()
