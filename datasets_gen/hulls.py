"""Bodywork: surfaces through superelliptic sections along z, and shells of some thickness."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from visref_datasets_gen.shapes import Float64, Soup
from visref_datasets_gen.solids import chords, curve, looped, sections, thick

# A section: its z, half width, lowest and highest y, and exponent: 2 is an ellipse, more is
# boxier.
Station = tuple[float, float, float, float, float]

SKIN_M = 0.006


def smooth(stations: Sequence[Station], count: int) -> Float64:
    """(count, 5) sections on splines through the stations."""
    table = np.array(stations)
    return np.concatenate([curve(table[:, :3], count), curve(table[:, 2:], count)[:, 1:]], axis=1)


def outline(section: Float64, angle: Float64, skin: float = 0.0) -> Float64:
    """(k, 3) points of a section at angles about its middle, `skin` inside it."""
    z, half, low, high, power = section.tolist()
    c, s = np.cos(angle), np.sin(angle)
    x = (half - skin) * np.sign(c) * np.abs(c) ** (2.0 / power)
    rise = ((high - low) / 2.0 - skin) * np.sign(s) * np.abs(s) ** (2.0 / power)
    return np.stack([x, (high + low) / 2.0 + rise, np.full_like(x, z)], axis=1)


def sheet(rows: Float64, start: Float64, end: Float64, count: int, skin: float) -> Float64:
    """(s, count, 3) points of each section from an angle to another."""
    turn = np.linspace(0.0, 1.0, count)
    return np.array(
        [outline(row, a + (b - a) * turn, skin) for row, a, b in zip(rows, start, end, strict=True)]
    )


def hull(stations: Sequence[Station], fine: float) -> Soup:
    """A solid."""
    angle = _around(110, fine)
    return sections([outline(row, angle) for row in smooth(stations, chords(60, fine, 4))])


def open_shell(
    stations: Sequence[Station], lips: Sequence[float], fine: float, *, down: bool = False
) -> Soup:
    """A shell open along its top, or its bottom, `lips` radians to either side of the middle."""
    rows = smooth(stations, chords(76, fine, 4))
    lip = _spread(lips, len(rows))
    middle = -math.pi / 2 if down else math.pi / 2
    start, end = middle + lip, middle + 2.0 * math.pi - lip
    outer, inner = (sheet(rows, start, end, chords(110, fine, 8), skin) for skin in (0.0, SKIN_M))
    return thick(outer, inner)


def tunnel(stations: Sequence[Station], middles: Sequence[float], fine: float) -> Soup:
    """A shell open at both ends, its sections' middles at some x."""
    rows = smooth(stations, chords(64, fine, 4))
    angle, shift = _around(96, fine), _spread(middles, len(rows))[:, None, None] * [1.0, 0.0, 0.0]
    outer, inner = (np.array([outline(row, angle, skin) for row in rows]) + shift
                    for skin in (0.0, SKIN_M))  # fmt: skip
    return looped(np.concatenate([outer, inner[::-1]]))


def patch_on(
    stations: Sequence[Station],
    middles: Sequence[float],
    part: tuple[float, float],
    span: tuple[float, float],
    skins: tuple[float, float],
    fine: float,
) -> Soup:
    """A thin piece over shares of a hull's length and a span of angles, from a skin to another;
    a negative one lies outside."""
    count = 4 * chords(60, fine, 4)
    picked = slice(int(count * part[0]), int(count * part[1]), 4)
    rows = smooth(stations, count)[picked]
    shift = _spread(middles, count)[picked][:, None, None] * [1.0, 0.0, 0.0]
    ends = (np.full(len(rows), angle) for angle in span)
    start, end = ends
    outer, inner = (sheet(rows, start, end, chords(40, fine, 4), skin) + shift for skin in skins)
    return thick(outer, inner)


def _around(count: int, fine: float) -> Float64:
    return np.linspace(0.0, 2.0 * math.pi, chords(count, fine, 8), endpoint=False)


def _spread(values: Sequence[float], count: int) -> Float64:
    """The values at stations, for `count` sections."""
    places = np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, len(values))
    return np.asarray(np.interp(*places, values))
