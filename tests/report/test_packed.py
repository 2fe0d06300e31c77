"""What the page's script unpacks says what was packed."""

from __future__ import annotations

import base64
import json
import zlib

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from visref.report.crop_data import CropData
from visref.report.object_list import _short
from visref.report.owner_map import MAP_SIDE, owner_map
from visref.report.packed import packed
from visref.run_folder.owners import owner_picture


def unpacked(text):
    return json.loads(zlib.decompress(base64.b64decode(text), -zlib.MAX_WBITS))


@given(st.lists(st.text() | st.integers() | st.none()))
def test_what_is_packed_is_unpacked_as_it_was(value):
    # Nothing in it can end the element that it stands in.
    assert packed(value).isascii()
    assert "<" not in packed(value)
    assert unpacked(packed(value)) == value


def test_half_a_surrogate_pair_does_not_break_the_page():
    assert unpacked(packed(["\ud800"])) == ["?"]


def cells(runs):
    pairs = np.array(runs).reshape(-1, 2)
    return np.repeat(pairs[:, 1], pairs[:, 0])


def test_a_map_names_the_owner_of_every_pixel():
    owner = np.array([[-1, -1, 7], [7, 3, 3]], np.int32)
    found = owner_map(owner_picture(owner), {7: "wall", 4: "elsewhere"})
    assert (found["width"], found["height"]) == (3, 2)
    names = [found["names"][place] for place in cells(found["runs"])]
    assert names == ["background", "background", "wall", "wall", "object 3", "object 3"]


def test_a_map_of_a_large_picture_takes_its_samples_from_the_right_places():
    owner = np.arange(1000 * 2000, dtype=np.int32).reshape(1000, 2000)
    found = owner_map(owner_picture(owner), {})
    assert max(found["width"], found["height"]) <= MAP_SIDE
    names = np.array(found["names"])[cells(found["runs"])].reshape(found["height"], found["width"])
    step = 2000 / found["width"]
    for row, column in ((0, 0), (50, 100), (found["height"] - 1, found["width"] - 1)):
        y, x = divmod(int(names[row, column].split()[1]), 2000)
        assert abs(y - (row + 0.5) * step) <= step / 2
        assert abs(x - (column + 0.5) * step) <= step / 2


def witness(noise):
    """A witness whose surroundings pack badly."""
    return {
        "surroundings": {
            "x": 3,
            "y": 4,
            "step": 2,
            "width": 48,
            "height": 48,
            "objects": [{"object": 5, "name": "wall"}, {"object": 9, "name": "pane"}],
            "appearances": [
                {"object": 5, "glass": None, "shade": 15, "lost": True},
                {"object": 5, "glass": 9, "shade": 0, "lost": False},
                {"object": None, "glass": None, "shade": 0, "lost": False},
                {"object": -1, "glass": None, "shade": 3, "lost": False},
            ],
            "truth": [value for cell in noise for value in (1, cell)],
            "drawn": [48 * 48, 2],
        }
    }


def test_a_crop_says_whose_each_cell_is_and_what_is_lost():
    crops = CropData()
    assert crops.add(None) == crops.add({"no": "surroundings"}) == -1
    noise = [0] * (48 * 48)
    assert crops.add(witness(noise)) == 0
    (found,) = crops.take()
    assert found["at"] == [3, 4, 2]
    assert found["size"] == [48, 48]
    assert [found["names"][name] if name >= 0 else None for _, name, _ in found["looks"]] == [
        "wall",
        "pane",
        None,
        None,
    ]
    assert [lost for _, _, lost in found["looks"]] == [1, 0, 0, 0]
    # Others, and the background, have no colour of their own.
    assert [bool(colour) for colour, _, _ in found["looks"]] == [True, True, False, False]
    assert crops.take() == []


def test_crops_end_where_their_budget_does(monkeypatch):
    noise = np.random.default_rng(1).integers(0, 4, 48 * 48).tolist()
    monkeypatch.setattr("visref.report.crop_data.MAX_BYTES", 4000)
    crops = CropData()
    places = [crops.add(witness(noise)) for _ in range(12)]
    kept = sum(place >= 0 for place in places)
    assert 0 < kept < 12
    assert places == [*range(kept), *[-1] * (12 - kept)]
    assert len(packed(crops.take())) < 4000


def test_numbers_are_short():
    assert repr(_short(51.242512345)) == "51.2425"
    assert repr(_short(1 / 3, 3)) == "0.333"
