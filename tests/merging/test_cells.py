"""What `part.parquet` says of a verdict: the same again, or refused."""

from __future__ import annotations

import zlib

import numpy as np
import pytest

from visref.run_folder.part import drawn_units, unpacked

# Of ten units the first owns a sample; object 3 is missed by units 1 and 9.
GOOD = {
    "seen": np.packbits([True, *[False] * 9]).tobytes(),
    "objects": np.array([3], "<i8").tobytes(),
    "counts": np.array([2], "<i8").tobytes(),
    "units": np.array([1, 9], "<i8").tobytes(),
}


def test_a_good_row_tells_who_is_seen_and_by_which_units_objects_are_missed():
    followed = unpacked(GOOD, 10)
    assert followed.seen.tolist() == [True, *[False] * 9]
    assert {index: units.tolist() for index, units in followed.lost.items()} == {3: [1, 9]}
    assert unpacked({**GOOD, "seen": None}, 10) is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"seen": b""},
        {"seen": b"xxx"},
        *({name: value} for name in ("objects", "counts", "units") for value in (None, b"", b"x")),
        {"counts": np.array([3], "<i8").tobytes()},
        {"counts": np.array([-2], "<i8").tobytes()},
        {"units": np.array([1, 10], "<i8").tobytes()},
    ],
)
def test_what_does_not_go_together_is_refused(wrong):
    with pytest.raises(ValueError, match=r"."):
        unpacked({**GOOD, **wrong}, 10)


def test_what_was_drawn_is_read_or_refused():
    packed = zlib.compress(np.packbits([False, True, *[False] * 7, True]).tobytes())
    assert drawn_units(packed, 10).tolist() == [1, 9]
    for wrong in (b"", b"x" * 8, zlib.compress(b""), zlib.compress(b"x" * 1000), packed[:-6]):
        with pytest.raises(ValueError, match="what was drawn"):
            drawn_units(wrong, 10)
