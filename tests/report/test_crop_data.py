"""What the page carries of what lies around a witness: whole, and where that is too much, small."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from visref.report import crop_data
from visref.report.crop_data import SMALL_CELLS, CropData
from visref.report.packed import run_lengths
from visref.run_folder.layout import OTHERS, SURROUNDED_CELLS


def witness(rows, columns, *, seed=0, size=SURROUNDED_CELLS):
    """What object 7 lost: these rows and columns of the cells; others lie around it at random."""
    looks = [
        {"object": None, "shade": 0, "glass": None, "lost": False},
        *({"object": obj, "shade": 5, "glass": None, "lost": False} for obj in (3, 4, 5)),
        {"object": 7, "shade": 9, "glass": None, "lost": True},
        {"object": OTHERS, "shade": 8, "glass": None, "lost": False},
    ]
    around = np.random.default_rng(seed).choice([0, 1, 2, 3, 5], (size, size))
    truth = around.copy()
    truth[rows, columns] = 4
    return {
        "surroundings": {
            "x": 100, "y": 50, "step": 3, "width": size, "height": size, "appearances": looks,
            "objects": [{"object": obj, "name": f"part {obj}"} for obj in (3, 4, 5, 7)],
            "truth": run_lengths(truth.ravel()), "drawn": run_lengths(around.ravel()),
        }
    }  # fmt: skip


def by_sample(crop):
    """By pixel: of what ought to be seen and of what was drawn, colour, name, and whether lost."""
    (x, y, step), (width, height) = crop["at"], crop["size"]
    layers = []
    for name in ("truth", "drawn"):
        flat = crop[name]
        cells = [look for n, look in zip(flat[::2], flat[1::2], strict=True) for _ in range(n)]
        assert len(cells) == width * height
        layers.append(cells)
    names = [*crop["names"], None]
    told = [(colour, names[name], lost) for colour, name, lost in crop["looks"]]
    return {
        (x + step * (i % width), y + step * (i // width)): tuple(told[one[i]] for one in layers)
        for i in range(width * height)
    }


def crops(monkeypatch, one, whole_bytes):
    monkeypatch.setattr(crop_data, "WHOLE_BYTES", whole_bytes)
    data = CropData()
    assert data.add(one) == 0
    (crop,) = data.take()
    return crop


SPAN = st.tuples(st.integers(0, SURROUNDED_CELLS - 1), st.integers(1, SURROUNDED_CELLS)).map(
    lambda one: slice(one[0], min(sum(one), SURROUNDED_CELLS))
)


@given(SPAN, SPAN, st.integers(0, 9))
def test_a_small_crop_says_of_its_samples_what_the_whole_one_does(rows, columns, seed):
    with pytest.MonkeyPatch.context() as patch:
        one = witness(rows, columns, seed=seed)
        whole = by_sample(crops(patch, one, 10**6))
        crop = crops(patch, one, 0)
        small = by_sample(crop)
    assert max(crop["size"]) <= SMALL_CELLS
    assert small.items() <= whole.items()
    # Some of what was lost is in it; all of it, where that is small.
    lost = {at for at, (truth, _) in whole.items() if truth[2]}
    assert lost & small.keys()
    if max(rows.stop - rows.start, columns.stop - columns.start) <= SMALL_CELLS // 2:
        assert lost <= small.keys()


def test_whole_crops_come_first_then_small_ones_then_none(monkeypatch):
    one = witness(slice(3, 40), slice(3, 40))
    size = 4 / 3 * crop_data._size(crop_data._crop(one["surroundings"]))
    monkeypatch.setattr(crop_data, "WHOLE_BYTES", 2.5 * size)
    monkeypatch.setattr(crop_data, "MAX_BYTES", 4.0 * size)
    data = CropData()
    places = [data.add(one) for _ in range(40)]
    sizes = [max(crop["size"]) for crop in data.take()]
    assert sizes[:2] == [SURROUNDED_CELLS] * 2
    assert set(sizes[2:]) == {SMALL_CELLS}
    assert len(sizes) > 5
    assert places == [*range(len(sizes)), *[-1] * (40 - len(sizes))]
    assert data.add({}) == data.add(None) == -1
