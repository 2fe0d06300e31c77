"""Hypotheses with a number in them: a near plane, a least count of samples. The number is chosen to
fit, so that they need more to be believed: such a split of the data must not come by chance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from visref.causes.boxes import Boxes
from visref.causes.layers import Layers
from visref.causes.rectangles import asked
from visref.causes.sights import At, Sight, Tell
from visref.scene import Float64

Bool = NDArray[np.bool_]

# A fit is believed only if a random order would give it in less than one of so many cases.
ODDS = 2000
# Over so many frames it is followed for how long something has been there.
LOOK_BACK = 64
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


def clipped_size(at: At) -> Float64:
    """The same, of what lies within the image."""
    sides = at.boxes.rectangles.astype(np.float64)
    side = np.maximum(sides[:, 2] - sides[:, 0], sides[:, 3] - sides[:, 1])
    return np.where(at.boxes.crossing, np.inf, side)


def area(at: At) -> Float64:
    spans = at.boxes.spans
    found = (spans[:, 2] - spans[:, 0]) * (spans[:, 3] - spans[:, 1])
    return np.where(at.boxes.crossing, np.inf, found)


def height(at: At) -> Float64:
    spans = at.boxes.spans
    return np.where(at.boxes.crossing, np.inf, spans[:, 3] - spans[:, 1])


def _half_diagonal(at: At) -> Float64:
    boxes = np.where(at.boxes.there[:, None, None], at.boxes.boxes, 0.0)
    return np.asarray(np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1) / 2.0)


def apparent(at: At) -> Float64:
    """The radius by the distance of the middle."""
    return _half_diagonal(at) / np.maximum(to_middle(at), 1e-9)


def apparent_by_depth(at: At) -> Float64:
    depth = at.boxes.centres[:, 2]
    found = _half_diagonal(at) / np.maximum(depth, 1e-9)
    return np.where(depth > 0.0, found, np.inf)


def to_middle(at: At) -> Float64:
    """The distance from the eye to the box's middle."""
    return np.asarray(np.linalg.norm(at.boxes.centres, axis=1))


def along_the_ground(at: At) -> Float64:
    """The same, heights left out."""
    boxes = np.where(at.boxes.there[:, None, None], at.boxes.boxes, 0.0)
    found = boxes.mean(axis=1) - at.camera.eye
    return np.asarray(np.hypot(found[:, 0], found[:, 2]))


def middle_depth(at: At) -> Float64:
    return np.asarray(at.boxes.centres[:, 2])


def aside(axes: tuple[int, ...]) -> Callable[[At], Float64]:
    """By how much of its width and height the view would have to be as large that the box is
    just in it."""

    def value(at: At) -> Float64:
        camera, local = at.camera, at.boxes.seen_from
        step = camera.half_pixel
        found = np.zeros(len(at.ids))
        shift = (2.0 * camera.shift_x_px * step, -2.0 * camera.shift_y_px * step)
        sides = (step * camera.width, step * camera.height)
        depth = local[..., 2] if camera.is_perspective else np.ones(local.shape[:-1])
        for axis in axes:
            place = local[..., axis] - shift[axis] * depth
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = np.where(depth > 0.0, np.abs(place) / (depth * sides[axis]), 0.0)
            # Where the box lies across the axis, or crosses the eye's plane, it is in any view.
            across = (place.min(axis=1) <= 0.0) & (place.max(axis=1) >= 0.0)
            least = np.where(across | (depth <= 0.0).any(axis=1), 0.0, ratio.min(axis=1))
            found = np.maximum(found, least)
        return found

    return value


def since_it_came(at: At) -> Float64:
    """For how many frames it has been there, infinite where it was never absent."""
    moments = at.sights.moments
    objects = np.maximum(at.objects(), 0)
    there, count = np.ones(len(objects), np.bool_), np.zeros(len(objects))
    frame: int | None = at.frame
    for _ in range(LOOK_BACK):
        frame = None if frame is None else moments.before(frame, 1)
        if frame is None or not there.any():
            break
        there &= ~moments.timeline.absent(frame)[objects]
        count += there
    return np.where(there, np.inf, count)


def near_by_farthest(at: At) -> Float64:
    """The farthest depth of the box, by that of all that there is."""
    every = at.now.place.bounds
    every = every[np.isfinite(every).all(axis=(1, 2))]
    boxes = Boxes(at.camera, every)
    farthest = float(boxes.depths.max(initial=1e-9))
    return near(at) / max(farthest, 1e-9)


def margin(at: At) -> Float64:
    """How far behind the box's nearest depth something else lies in its rectangle, by that."""
    found = asked(at, at.boxes.rectangles, at.boxes.nearest, whole=True).farthest
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = found / at.boxes.nearest
    return np.where(at.boxes.crossing | ~np.isfinite(ratio), np.inf, ratio)


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
    Fit("too-few-samples", "size in the image", clipped_size),
    Fit("too-few-samples", "area", area),
    Fit("too-few-samples", "height", height),
    Fit("too-few-samples", "radius by distance", apparent),
    Fit("too-few-samples", "radius by depth", apparent_by_depth),
    Fit("too-few-samples", "radius", _half_diagonal),
    Fit("near-larger", "by the farthest of all", near_by_farthest),
    Fit("near-larger", "by the middle's depth", middle_depth),
    Fit("near-larger", "by the middle's distance", to_middle),
    Fit("far-nearer", "by the middle's depth", middle_depth, below=False),
    Fit("far-nearer", "by the middle's distance", to_middle, below=False),
    Fit("far-nearer", "along the ground", along_the_ground, below=False),
    Fit("other-lens", "across and up", aside((0, 1)), below=False),
    Fit("other-lens", "across", aside((0,)), below=False),
    Fit("other-lens", "up", aside((1,)), below=False),
    Fit("appeared-unknown", "at first", since_it_came),
    Fit("own-depth", "by a margin", margin),
    Fit("gap-too-narrow", "", gap),
)


def odds(right: int, wrong: int, lost: int, shown: int) -> float:
    """One in how many random choices of `right + wrong` units, of `shown` of which `lost` are lost,
    holds so many lost ones."""
    return float(np.exp(log_odds(right, wrong, lost, shown)))


def log_odds(right: int, wrong: int, lost: int, shown: int) -> float:
    """The logarithm of `odds`."""
    taken = right + wrong
    held = np.arange(max(right, taken - (shown - lost)), min(taken, lost) + 1)
    if not len(held):
        return MOST_LOG
    ways = _log_ways(lost, held) + _log_ways(shown - lost, taken - held)
    most = float(ways.max())
    some = most + float(np.log(np.exp(ways - most).sum()))
    return min(float(_log_ways(shown, np.array([taken]))[0]) - some, MOST_LOG)


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
