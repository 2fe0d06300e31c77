"""Arrays come back from a spool as they were put there."""

from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from visref.recordings.spool import Spool

KINDS = st.one_of(
    arrays_of.boolean_dtypes(),
    arrays_of.integer_dtypes(endianness="="),
    arrays_of.floating_dtypes(endianness="=", sizes=(32, 64)),
)
SHAPES = arrays_of.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.lists(arrays_of.arrays(KINDS, SHAPES), max_size=3), max_size=4))
def test_arrays_come_back_with_kind_and_shape(lots):
    for in_memory in (0, 1 << 20):
        spool = Spool(in_memory)
        places = [spool.put_arrays(lot) for lot in lots]
        for lot, place in zip(reversed(lots), reversed(places), strict=True):
            found = spool.get_arrays(place)
            assert len(found) == len(lot)
            for one, other in zip(lot, found, strict=True):
                assert other.dtype == one.dtype
                assert other.shape == one.shape
                assert other.tobytes() == one.tobytes()
                assert other.flags.writeable
