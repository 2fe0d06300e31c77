"""Numbers of ours with an interval: what other frames of the same path would have given.

A run judges a regular sample of a path's frames, and neighbours resemble each other. So an interval
comes from a block bootstrap over frames: resamples of as many frames, put together from blocks of
consecutive ones.

- Blocks are circular (Politis and Romano, A circular block-resampling procedure for stationary
  data, 1992): every frame is drawn equally often, where moving blocks leave out the path's ends.
- Their length is the rule n^(1/3), rounded up, after Hall, Horowitz and Jing (Biometrika 82, 1995);
  no less than a stretch, where frames come in stretches of consecutive ones; no more than half the
  frames.
- The ends are percentiles of the resampled figure, expanded for few blocks as Hesterberg (What
  Teachers Should Know About the Bootstrap, The American Statistician 69, 2015) has it: with m
  blocks, those that make a normal distribution as wide as Student's t of m - 1 degrees of freedom.
- The worst of the frames is no mean: the path's worst is never better than the one seen. There the
  resampled deviations are reflected at the figure (the basic bootstrap), so that the interval
  starts at what was seen.

What the interval is for is the path: 20 frames spread over it tell its mean better than 20 of a
process without end would, since neighbours resemble each other. So it is wide enough there however
long the memory, while for the process behind a series of long memory (a correlation of 0.7 from one
sampled frame to the next, say) 20 frames are too few for any such rule: it would hold 80 % of the
time (`tests/papers/test_estimates.py`).

Figures of the same walk are resampled together, so that what two cullers share cancels in their
quotient. The seed is fixed: the same frames give the same interval.
"""

from __future__ import annotations

import itertools
import math
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, reduce
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

CONFIDENCE = 0.95
RESAMPLES = 2_000
SEED = 20


def block_length(frames: Sequence[int]) -> int:
    """How many consecutive frames of a sample make a block, by the rule above; `frames` ascend."""
    count = len(frames)
    length = math.ceil(round(math.pow(count, 1 / 3), 9))
    longest = run = 1
    for before, after in itertools.pairwise(frames):
        run = run + 1 if after == before + 1 else 1
        longest = max(longest, run)
    if longest < count:
        length = max(length, longest)
    return max(1, min(length, count // 2))


_seed = ContextVar("seed", default=0)


@contextmanager
def resampling(seed: int) -> Iterator[None]:
    """Inside, intervals are resampled with another seed; 0 is the usual one."""
    before = _seed.set(seed)
    try:
        yield
    finally:
        _seed.reset(before)


@lru_cache(maxsize=32)
def _draws(seed: int, walk: str, count: int, length: int) -> NDArray[np.int32]:
    """(RESAMPLES, count) places in the sample, in blocks of `length`."""
    rng = np.random.default_rng([SEED, seed, zlib.crc32(walk.encode()), count, length])
    starts = rng.integers(count, size=(RESAMPLES, -(-count // length), 1))
    places = (starts + np.arange(length)) % count
    return places.reshape(RESAMPLES, -1)[:, :count].astype(np.int32)


def students_quantile(share: float, freedom: int) -> float:
    """Below which `share` of Student's t with `freedom` degrees lies; `share` is at least one half.
    By bisection of the closed form for whole degrees (Abramowitz and Stegun 26.7.3 and 26.7.4)."""

    def within(t: float) -> float:
        angle = math.atan(t / math.sqrt(freedom))
        term, total = 1.0, 0.0
        if freedom % 2:
            term = math.cos(angle)
            for k in range(1, freedom - 1, 2):
                total += term
                term *= math.cos(angle) ** 2 * (k + 1) / (k + 2)
            return 2.0 / math.pi * (angle + math.sin(angle) * total)
        for k in range(0, freedom, 2):
            total += term
            term *= math.cos(angle) ** 2 * (k + 1) / (k + 2)
        return math.sin(angle) * total

    low, high = 0.0, 1e6
    while high - low > 1e-9 * high:
        middle = (low + high) / 2.0
        low, high = (middle, high) if within(middle) < 2.0 * share - 1.0 else (low, middle)
    return high


@dataclass(frozen=True, eq=False)
class Estimate:
    """A figure of ours.

    `value`: of the frames that were judged. `resampled`: gives the figure of resampled frames,
    (RESAMPLES,) float64, and is asked once, where an interval is; None for what is no figure of
    frames, a single count or measurement, which has no interval. `blocks`: how many independent
    blocks the frames make, the fewest where figures are joined. `at_least`, `at_most`: what the
    figure of the whole path cannot pass, whatever the frames between: its worst is no better than
    one that was seen.

    Arithmetic with numbers and other estimates gives estimates. Raises ZeroDivisionError where a
    quotient's denominator is zero.
    """

    value: float
    resampled: Callable[[], Floats] | None = None
    blocks: int = 0
    at_least: float = -math.inf
    at_most: float = math.inf

    @cached_property
    def resamples(self) -> Floats | None:
        """(RESAMPLES,) float64: the figure of resampled frames."""
        return None if self.resampled is None else self.resampled()

    @cached_property
    def interval(self) -> tuple[float, float] | None:
        """The interval's ends, None where there is none; endless where one block cannot tell, or a
        resample has no figure."""
        if self.resamples is None:
            return None
        if self.blocks < 2 or not np.isfinite(self.resamples).all():
            return self.at_least, self.at_most
        tail = (1.0 - CONFIDENCE) / 2.0
        wider = students_quantile(1.0 - tail, self.blocks - 1)
        wider *= math.sqrt(self.blocks / (self.blocks - 1))
        share = NormalDist().cdf(-wider)
        low, high = np.quantile(self.resamples, (share, 1.0 - share))
        low, high = min(float(low), self.value), max(float(high), self.value)
        return max(low, self.at_least), min(high, self.at_most)

    def __truediv__(self, other: Estimate | float) -> Estimate:
        return _joined(lambda a, b: a / b, self, other)

    def __rtruediv__(self, other: float) -> Estimate:
        return _joined(lambda a, b: b / a, self, other)

    def __mul__(self, other: Estimate | float) -> Estimate:
        return _joined(lambda a, b: a * b, self, other)

    def __add__(self, other: Estimate | float) -> Estimate:
        return _joined(lambda a, b: a + b, self, other)

    def __sub__(self, other: Estimate | float) -> Estimate:
        return _joined(lambda a, b: a - b, self, other)

    def __rsub__(self, other: float) -> Estimate:
        return _joined(lambda a, b: b - a, self, other)


def single(value: float) -> Estimate:
    """A figure that no frames stand behind: it has no interval, and is judged as it is."""
    return Estimate(float(value))


def _joined(of: Callable[..., Any], first: Estimate, *others: Estimate | float) -> Estimate:
    """A function of two figures at a time, resample by resample."""
    parts = [first, *(one if isinstance(one, Estimate) else single(one) for one in others)]
    value = float(reduce(of, (one.value for one in parts)))
    if all(one.resampled is None for one in parts):
        return single(value)

    def resampled() -> Floats:
        drawn = (
            np.full(RESAMPLES, one.value) if one.resamples is None else one.resamples
            for one in parts
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(reduce(of, drawn))

    return Estimate(value, resampled, min(one.blocks for one in parts if one.blocks))


def least(*figures: Estimate) -> Estimate:
    """The least of several figures, as of several scenes."""
    return _bounded(min, _joined(np.minimum, *figures), figures)


def most(*figures: Estimate) -> Estimate:
    """The greatest of several figures."""
    return _bounded(max, _joined(np.maximum, *figures), figures)


def _bounded(
    of: Callable[[Iterable[float]], float], joined: Estimate, figures: Sequence[Estimate]
) -> Estimate:
    """The least or greatest of figures is bounded by that of their bounds."""
    if joined.resampled is None:
        return joined
    low, high = (
        of(one.value if one.resampled is None else getattr(one, end) for one in figures)
        for end in ("at_least", "at_most")
    )
    return replace(joined, at_least=low, at_most=high)


@dataclass(frozen=True, eq=False)
class Series:
    """A number per frame. `values`: (n,) float64; `frames`: their numbers, ascending; `walk`: the
    scene and path, by any name: series of one walk and the same frames are resampled together."""

    values: Floats
    frames: tuple[int, ...]
    walk: str = ""

    def mean(self) -> Estimate:
        """The mean. Raises ValueError without frames."""
        return self._estimate(lambda values: values.mean(axis=-1))

    def median(self) -> Estimate:
        """The median. Raises ValueError without frames."""
        return self._estimate(lambda values: np.median(values, axis=-1))

    def most(self) -> Estimate:
        """The greatest: the path's is that or more. Raises ValueError without frames."""
        worst = self._reflected(self._estimate(lambda values: values.max(axis=-1)))
        return replace(worst, at_least=worst.value)

    def least(self) -> Estimate:
        """The least: the path's is that or less. Raises ValueError without frames."""
        worst = self._reflected(self._estimate(lambda values: values.min(axis=-1)))
        return replace(worst, at_most=worst.value)

    def __truediv__(self, other: Series) -> Series:
        """Frame by frame. Raises ZeroDivisionError where a frame's denominator is zero, ValueError
        for other frames."""
        if self.frames != other.frames:
            raise ValueError("a quotient of other frames")
        if not other.values.all():
            raise ZeroDivisionError("a frame's denominator is zero")
        return Series(self.values / other.values, self.frames, self.walk)

    def _estimate(self, figure: Callable[[Floats], Floats]) -> Estimate:
        count = len(self.frames)
        if not count or self.values.shape != (count,):
            raise ValueError(f"{self.values.shape} values of {count} frames")
        length = block_length(self.frames)

        def resampled() -> Floats:
            return figure(self.values[_draws(_seed.get(), self.walk, count, length)])

        return Estimate(float(figure(self.values)), resampled, count // length)

    @staticmethod
    def _reflected(figure: Estimate) -> Estimate:
        def resampled() -> Floats:
            assert figure.resamples is not None
            return 2.0 * figure.value - figure.resamples

        return Estimate(figure.value, resampled, figure.blocks)


def series(values: Sequence[float], frames: Sequence[int], walk: str = "") -> Series:
    """A `Series` of anything that is a number per frame."""
    return Series(np.asarray(values, dtype=np.float64), tuple(frames), walk)
