"""The image protocol: an effect's image against its reference image and against truth.

All images are (height, width) int32 counts of how much of the effect shows at a sample: layers
of sprites, or 1 for shadow. Three are compared:

    image      by the method under test
    reference  by the same rasteriser without the method: every sprite, every volume in full
    truth      ray-cast

Image and reference come from a rasteriser, which may err by what it declares. So where one of
the three differs (and only there) the truth is asked again, for the `Bounds` between which the
effect lies however the rasteriser errs. Both of them outside: lost or extra. Inside: within
tolerance, and counted. A culled image has to equal its reference at all other samples.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.scene import Int32, Int64


@dataclass(frozen=True, eq=False)
class Bounds:
    """At some samples, between what the effect must lie: (k,) arrays.

    `samples` int64 flat indices, ascending; `least` and `most` int32, inclusive. Outward: what
    float64 cannot decide widens them.
    """

    samples: Int64
    least: Int32
    most: Int32


NO_BOUNDS = Bounds(np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros(0, np.int32))


@dataclass(frozen=True)
class ImageVerdict:
    """Samples, by what became of them.

    `judged`: in the domain; `shown`: where the truth shows the effect; `held`: where the image
    does too. `lost`, `extra`: image below or above its bounds; `within_tolerance`: inside them and
    not the truth. `differing`: image is not the reference, and one of the two is out of bounds;
    `differing_within_tolerance`: both are inside. `worst`: (x, y) of a sample lost, extra or
    differing.
    """

    judged: int = 0
    shown: int = 0
    held: int = 0
    lost: int = 0
    extra: int = 0
    within_tolerance: int = 0
    differing: int = 0
    differing_within_tolerance: int = 0
    worst: tuple[int, int] | None = None

    @property
    def status(self) -> str:
        """As in verdict.json: "violation", "inconclusive", or "no_violation_found". An image that
        never shows what the truth does passes nothing, whatever the tolerance excuses."""
        if self.lost or self.extra or self.differing:
            return "violation"
        return "no_violation_found" if self.held else "inconclusive"

    def plus(self, other: ImageVerdict) -> ImageVerdict:
        """Both verdicts' frames together; the worst sample is the first one's, if it has any."""
        sums = {
            name: value + getattr(other, name)
            for name, value in vars(self).items()
            if name != "worst"
        }
        return replace(self, **sums, worst=self.worst or other.worst)

    def to_json(self) -> dict[str, Any]:
        """The counts and the status."""
        return {**asdict(self), "status": self.status}


def disputed(
    image: Int32, reference: Int32, truth: Int32, domain: NDArray[np.bool_] | None = None
) -> Int64:
    """Flat indices, ascending, of the samples at which the three images are not one.

    `domain`: (height, width) bool, the samples that are judged; None for all.
    """
    differs = (image != truth) | (reference != truth)
    if domain is not None:
        differs &= domain
    return np.flatnonzero(differs)


def judge(
    image: Int32,
    reference: Int32,
    truth: Int32,
    bounds: Bounds,
    domain: NDArray[np.bool_] | None = None,
) -> ImageVerdict:
    """Compare an effect's image; `bounds` are those of the `disputed` samples, in order.

    `image`, `reference`, `truth`: (height, width) int32. `domain`: (height, width) bool, the
    samples that count; None for all.
    """
    if not image.shape == reference.shape == truth.shape:
        raise ValueError(f"images of {image.shape}, {reference.shape} and {truth.shape}")
    if not np.array_equal(bounds.samples, disputed(image, reference, truth, domain)):
        raise ValueError("the bounds are not those of the disputed samples")
    inside = np.ones(image.shape, np.bool_) if domain is None else domain
    got, plain, true = (part.reshape(-1)[bounds.samples] for part in (image, reference, truth))
    lost, extra = got < bounds.least, got > bounds.most
    out = lost | extra
    unlike = got != plain
    differing = unlike & (out | (plain < bounds.least) | (plain > bounds.most))
    bad = bounds.samples[out | differing]
    shown = (truth > 0) & inside
    return ImageVerdict(
        judged=int(inside.sum()),
        shown=int(shown.sum()),
        held=int((shown & (image > 0)).sum()),
        lost=int(lost.sum()),
        extra=int(extra.sum()),
        within_tolerance=int((~out & (got != true)).sum()),
        differing=int(differing.sum()),
        differing_within_tolerance=int((unlike & ~differing).sum()),
        worst=(int(bad[0]) % image.shape[1], int(bad[0]) // image.shape[1]) if len(bad) else None,
    )
