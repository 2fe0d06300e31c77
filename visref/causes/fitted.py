"""Hypotheses with a number in them: a near plane, a least count of samples. The number is chosen to
fit, so that they need more to be believed: such a split of the data must not come by chance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from visref.causes.layers import Layers
from visref.causes.rectangles import asked
from visref.causes.sights import At, Sight, Tell
from visref.scene import Float64

Bool = NDArray[np.bool_]

# A fit is believed only if a random order would give it in less than one of so many cases.
ODDS = 2000
# As a logarithm, the most odds that are told.
MOST_LOG = 690.0


@dataclass(frozen=True)
class Fit:
    """A cause that a threshold makes: dropped where the value, (k,) float64 of an answer's units,
    is below it (or above)."""

    cause: str
    variant: str
    value: Callable[[At], Float64]
    below: bool = True


def near(at: At) -> Float64:
    return np.asarray(at.boxes.depths.max(axis=1))


def far(at: At) -> Float64:
    return np.asarray(at.boxes.depths.min(axis=1))


def away(at: At) -> Float64:
    """The distance from the eye to the box."""
    boxes = np.where(at.boxes.there[:, None, None], at.boxes.boxes, 0.0)
    eye = at.boxes.camera.eye
    closest = np.clip(eye, boxes[:, 0], boxes[:, 1])
    return np.asarray(np.linalg.norm(closest - eye, axis=1))


def samples(at: At) -> Float64:
    return at.now.samples[at.ids].astype(np.float64)


def passing(at: At) -> Float64:
    found = asked(at, at.boxes.rectangles, at.boxes.nearest, whole=True).passing
    return np.where(at.boxes.crossing, np.inf, found.astype(np.float64))


def on_screen(at: At) -> Float64:
    """The greater side of the box's rectangle, in pixels."""
    spans = at.boxes.spans
    side = np.maximum(spans[:, 2] - spans[:, 0], spans[:, 3] - spans[:, 1])
    return np.where(at.boxes.crossing, np.inf, side)


def gap(at: At) -> Float64:
    """The side of the greatest square of pixels in which nothing else shows, told up to 8."""
    return widths(at.now, at.sights.units.count)[at.ids]


def widths(sight: Sight, units: int) -> Float64:
    """(units,) float64: the side, in pixels, of the greatest square in which a unit alone shows,
    told up to 8; 0 for what shows nowhere."""
    layers: Layers = sight.layers(masks=True, glass=True)
    owner = layers.owner
    result = np.zeros(units + 1)
    alike = owner
    for side in range(1, 9):
        if side > 1:
            a, b = alike[:-1, :-1], owner[side - 1 :, side - 1 :]
            # A square of this side is one of the side before and its three others beside it.
            same = (a == alike[1:, :-1]) & (a == alike[:-1, 1:]) & (a == alike[1:, 1:])
            alike = np.where(same & (a == b), a, -1)
        if not alike.size:
            break
        result[alike.reshape(-1)] = side
    return result[:-1]


FITS = (
    Fit("near-larger", "fitted", near),
    Fit("far-nearer", "fitted", far, below=False),
    Fit("far-nearer", "fitted by distance", away, below=False),
    Fit("too-few-samples", "owned", samples),
    Fit("too-few-samples", "passing", passing),
    Fit("too-few-samples", "size", on_screen),
    Fit("gap-too-narrow", "", gap),
)


def odds(right: int, wrong: int, lost: int, shown: int) -> float:
    """One in how many random choices of `right + wrong` units, of `shown` of which `lost` are lost,
    holds so many lost ones."""
    taken = right + wrong
    held = np.arange(max(right, taken - (shown - lost)), min(taken, lost) + 1)
    if not len(held):
        return float(np.exp(MOST_LOG))
    ways = _log_ways(lost, held) + _log_ways(shown - lost, taken - held)
    most = float(ways.max())
    some = most + float(np.log(np.exp(ways - most).sum()))
    return float(np.exp(min(float(_log_ways(shown, np.array([taken]))[0]) - some, MOST_LOG)))


def _log_ways(of: int, taken: NDArray[np.int64]) -> Float64:
    """The logarithm of the number of ways to take (k,) of so many."""
    factorial = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, of + 1)))])
    return np.asarray(factorial[of] - factorial[taken] - factorial[of - taken])


def threshold(values: Float64, lost: Bool, good: Bool, below: bool) -> float | None:
    """The threshold below which (or above which) lost ones lie and good ones do not, the best by
    lost less good; None where chance would do as well."""
    signed = values if below else -values
    known = (lost | good) & np.isfinite(signed)
    signed, hit = signed[known], lost[known]
    if not hit.any() or hit.all():
        return None
    order = np.argsort(signed, kind="stable")
    signed, hit = signed[order], hit[order]
    net = np.cumsum(np.where(hit, 1, -1))
    ends = np.append(signed[1:] != signed[:-1], True)
    net = np.where(ends, net, -len(net))
    best = int(np.argmax(net))
    taken, wrong = best + 1, int(np.count_nonzero(~hit[: best + 1]))
    right = taken - wrong
    if right == 0 or net[best] <= 0:
        return None
    if odds(right, wrong, int(np.count_nonzero(hit)), len(hit)) < ODDS:
        return None
    upper = signed[best + 1] if best + 1 < len(hit) else signed[best] + 1.0
    middle = float((signed[best] + upper) / 2.0)
    return middle if below else -middle


def fewer(value: Callable[[At], Float64], count: int) -> Tell:
    """What has fewer than so many is dropped."""
    return lambda at: value(at) >= count


FEW: dict[str, dict[str, Tell]] = {
    "too-few-samples": {
        **{f"{count} owned": fewer(samples, count) for count in (2, 4, 8)},
        **{f"{count} passing": fewer(passing, count) for count in (2, 4, 8)},
    },
}
