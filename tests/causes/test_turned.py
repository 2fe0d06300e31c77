"""Which way triangles turn: held against determinants in whole numbers."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from visref.causes.layers import turned

SMALL = st.integers(-9, 9)
POINT = st.tuples(SMALL, SMALL, SMALL)


def determinant(a, b, c):
    """Of three rows of whole numbers."""
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


@settings(deadline=None)
@given(st.lists(POINT, min_size=3, max_size=6), st.data(), POINT, st.booleans())
def test_fronts_are_turned_to_what_lies_before_them(points, data, towards, is_point):
    corner = st.integers(0, len(points) - 1)
    corners = data.draw(st.lists(st.tuples(corner, corner, corner), max_size=5))
    expected = []
    for i, j, k in corners:
        a, b, c = points[i], points[j], points[k]
        first, second = np.subtract(b, a).tolist(), np.subtract(c, a).tolist()
        way = np.subtract(towards, a).tolist() if is_point else list(towards)
        expected.append(determinant(first, second, way) > 0)
    found = turned(
        np.array(points, np.float32),
        np.array(corners, np.int32).reshape(-1, 3),
        np.array(towards, np.float64),
        is_point,
    )
    assert found.tolist() == expected
