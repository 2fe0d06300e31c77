"""A mask at a sample, from what a rasteriser has at hand: the functions of a triangle's edges.

Let E0, E1, E2 be the edge functions of the sides v0 v1, v1 v2 and v2 v0 (`splat_kernels.edge`),
each linear in the sample's a and b. Their values at a sample are the barycentrics of v2, v0 and v1
there, but for a factor, and their sum W is n . d of `visref.masks.hits` (orthographic: n . F). So
an attribute with the values f0, f1, f2 is f0 + x there, x = X / W with X = (f1 - f0) E2 +
(f2 - f0) E0, and at the corner (a + 2 i, b + 2 j) of the doubled footprint, i and j one or minus
one, it differs from that by

    2 (i X_a + j X_b - x (i W_a + j W_b)) / (W + 2 (i W_a + j W_b))

where X_a is what X grows by with a. Of two opposite corners one has the lesser denominator,
|W| - 2 |i W_a + j W_b|: the same bound, by less arithmetic than `visref.masks.hits.footprint` does.

Rounding is bounded coarsely, once for a triangle. Where that leaves open which texels the box
touches, nothing is said, and `visref.masks.hits.state_at` has to be asked. Where something is said,
it is what exact arithmetic says; `state_at` says the same, but for boxes so close to a texel's
border that its own bounds, mostly far finer, leave that open: these it calls BETWEEN.
"""

from __future__ import annotations

import numpy as np

from visref.compiled import njit
from visref.masks.lookup import UNSURE, state_of_places, wrapped
from visref.masks.store import CLAMP

UNIT = 2.0**-53
# An edge function: two roundings of the vertices less the eye, a cross product of them (4 u) and
# its product with d (6 u), of at most |p|^2 |d|. Let e be that error, h half the box, and
# D = |f1 - f0| + |f2 - f0| + |f0| + |f1| + |f2|. |x| <= D, and twice what an edge function grows by
# with a or b is off by e at most (`reach_of`), its products with differences of attributes
# included. So x is off by 4 e D / |W|, the numerator by (3 + 6 + 4) e D, and the denominator, c, by
# 9 e: together less than (17 e D + 9 e h) / c. Nearly twice that is kept, for second-order terms.
EDGE = 16.0 * UNIT
PER_EDGE = 32.0
# A few more operations on top: differences, sums and products of texture coordinates.
FEW = 64.0 * UNIT
# Nearer to the horizon than this the corners of a footprint may lie anywhere.
NEAR_HORIZON = 2.0**-20
# Places of texels that float64 holds with room to spare.
MOST = 2.0**30


@njit(inline="always")
def _largest(p):  # type: ignore[no-untyped-def]
    return abs(p[0]) + abs(p[1]) + abs(p[2])


@njit(inline="always")
def reach_of(grid, window):  # type: ignore[no-untyped-def]
    """A bound of the components of d at the samples of a window, and two steps beyond."""
    m = grid.axes
    a = max(abs(grid.column_a[window[0]]), abs(grid.column_a[window[1] - 1])) + 2.0
    b = max(abs(grid.row_b[window[2]]), abs(grid.row_b[window[3] - 1])) + 2.0
    reach = 0.0
    for i in range(3):
        reach = max(reach, abs(m[1, i]) + a * abs(m[2, i]) + b * abs(m[3, i]))
    return reach


@njit(inline="always")
def _along(f0, f1, f2, edges):  # type: ignore[no-untyped-def]
    """An attribute: its value at v0, differences to v1 and v2, twice what X grows by towards the
    corners +R +U and +R -U, and the sizes that rounding is relative to."""
    d1, d2 = f1 - f0, f2 - f0
    xa = d1 * edges[2][1] + d2 * edges[0][1]
    xb = d1 * edges[2][2] + d2 * edges[0][2]
    greatest = _largest((f0, f1, f2))
    spread = abs(d1) + abs(d2) + greatest
    return f0, d1, d2, 2.0 * (xa + xb), 2.0 * (xa - xb), spread, greatest


@njit(inline="always")
def facing(m, row, edges, corners, reach):  # type: ignore[no-untyped-def]
    """What the triangle of masked row `row`, negative for none, has in common for all samples: its
    material, whether the short way serves, u and v (`_along`), twice what W grows by towards two
    corners, and a bound of the rounding of an edge function. `edges`: of v0 v1, v1 v2 and v2 v0;
    `corners`: less the eye."""
    if row < 0:
        nothing = _along(0.0, 0.0, 0.0, edges)
        return 0, False, nothing, nothing, 0.0, 0.0, 0.0
    of = m.triangles[row]
    uv, alpha = of.uv, of.vertex_alpha
    material = m.materials[of.material]
    short = (
        material.texture >= 0
        and not material.unknown
        and not material.nearest
        and material.cutoff > 0.0
        and alpha[0] == alpha[1] == alpha[2] == 1.0
    )
    wa = edges[0][1] + edges[1][1] + edges[2][1]
    wb = edges[0][2] + edges[1][2] + edges[2][2]
    most = max(_largest(corners[0]), _largest(corners[1]), _largest(corners[2]))
    return (
        np.int64(of.material),
        short,
        _along(uv[0, 0], uv[1, 0], uv[2, 0], edges),
        _along(uv[0, 1], uv[1, 1], uv[2, 1], edges),
        2.0 * (wa + wb),
        2.0 * (wa - wb),
        EDGE * most * most * reach,
    )


@njit(inline="always")
def _places(along, size, s0, s2, over_w, towards, over_corners, off):  # type: ignore[no-untyped-def]
    """First and last place, as whole numbers, of the texels that a filtering lookup touches along
    an axis; and whether these are certain."""
    f0, d1, d2, xp, xm, spread, greatest = along
    x = (d1 * s2 + d2 * s0) * over_w
    half = max(
        abs(xp - x * towards[0]) * over_corners[0], abs(xm - x * towards[1]) * over_corners[1]
    )
    centre = f0 + x
    error = off * (spread + half) + FEW * (greatest + half)
    low, high = (centre - half) * size - 0.5, (centre + half) * size + 0.5
    slack = error * size + FEW
    first, last = np.floor(low), np.floor(high)
    certain = (
        (low - slack >= first)
        & (low + slack < first + 1.0)
        & (high - slack >= last)
        & (high + slack < last + 1.0)
        & (first > -MOST)
        & (last < MOST)
    )
    return first, last, certain


@njit(inline="always")
def _ends(size, wrap):  # type: ignore[no-untyped-def]
    return (0.0, size - 1.0) if wrap == CLAMP else (-MOST, MOST)


@njit(inline="always")
def extent_of(m, material):  # type: ignore[no-untyped-def]
    """Of a material's texture, across and down: how many texels it has; and the first and last
    place at which any but an end's own texel stands, as far as places go."""
    of = m.materials[material]
    texture = m.textures[of.texture]
    width, height = np.float64(texture.width), np.float64(texture.height)
    return (width, height), (_ends(width, of.wrap_s), _ends(height, of.wrap_t))


@njit(inline="always")
def touched_by_edges(face, extent, sides):  # type: ignore[no-untyped-def]
    """Of a triangle (`facing`) for which the short way serves, at a sample that it covers, by the
    values of its edge functions: first and last place of the texels that a lookup touches, across
    and down, and whether these are certain. Without a branch, so that many samples make a vector.
    `extent`: `extent_of` its material."""
    size, (ends_x, ends_y) = extent
    _, _, u, v, wp, wm, rounding = face
    s0, s1, s2 = sides
    w = s0 + s1 + s2
    most = abs(w)
    to_p, to_m = most - abs(wp), most - abs(wm)
    over_w, over_p, over_m = 1.0 / w, 1.0 / to_p, 1.0 / to_m
    off = PER_EDGE * rounding * max(over_p, over_m)
    x0, x1, sure_x = _places(u, size[0], s0, s2, over_w, (wp, wm), (over_p, over_m), off)
    y0, y1, sure_y = _places(v, size[1], s0, s2, over_w, (wp, wm), (over_p, over_m), off)
    certain = sure_x & sure_y & (min(to_p, to_m) > NEAR_HORIZON * most)
    x0, x1 = min(max(x0, ends_x[0]), ends_x[1]), min(max(x1, ends_x[0]), ends_x[1])
    y0, y1 = min(max(y0, ends_y[0]), ends_y[1]), min(max(y1, ends_y[0]), ends_y[1])
    return x0, x1, y0, y1, certain


@njit(inline="always")
def state_by_places(m, material, places):  # type: ignore[no-untyped-def]
    """SOLID, HOLE or BETWEEN of what `touched_by_edges` is certain of, else `UNSURE`."""
    x0, x1, y0, y1, certain = places
    if not certain:
        return UNSURE
    of = m.materials[material]
    texture = m.textures[of.texture]
    columns = wrapped(x0, x1, texture.width, of.wrap_s)
    rows = wrapped(y0, y1, texture.height, of.wrap_t)
    return state_of_places(m, material, columns, rows)
