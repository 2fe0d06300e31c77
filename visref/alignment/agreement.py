"""How well drawn sets agree with what cameras see: one number that fits every sound recorder.

A recorder that lists what owns a sample and one that lists all that its frustum touches are both
right. So an object counts only where every sound culler answers alike:

- *seen*: it owns a decided sample. It has to be drawn.
- *outside*: its box lies beyond one of the view's planes. There is no need to draw it.
- What is within the view and not seen counts neither way.

Over both kinds the agreement is Matthews' correlation coefficient between "drawn" and "seen"
(B. W. Matthews, 1975): 1 where all that is seen was drawn and nothing outside, 0 for a drawn set
that has nothing to do with the view, so also for one of everything or of nothing, and less than 0
for one that is turned round. It is symmetric, and no large share of the scene that lies outside
hides what was lost within.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.scene import Float64

Bool = NDArray[np.bool_]


@dataclass(frozen=True)
class Agreement:
    """Counts of objects over cells (a frame and one drawn set): seen and drawn, seen and not drawn,
    outside and drawn, outside and not drawn."""

    shown: int = 0
    lost: int = 0
    beside: int = 0
    left_out: int = 0

    def __add__(self, other: Agreement) -> Agreement:
        return Agreement(
            self.shown + other.shown,
            self.lost + other.lost,
            self.beside + other.beside,
            self.left_out + other.left_out,
        )

    @property
    def wrong(self) -> int:
        """Objects, summed over cells, that a sound culler would have answered otherwise."""
        return self.lost + self.beside

    @property
    def outside(self) -> int:
        return self.beside + self.left_out

    @property
    def score(self) -> float:
        """Matthews' correlation, -1 … 1. Where nothing was ever outside there is nothing to
        correlate with: the share of what is seen that was drawn."""
        seen = self.shown + self.lost
        if not self.outside:
            return self.shown / seen if seen else 0.0
        drawn = self.shown + self.beside
        undrawn = self.lost + self.left_out
        product = seen * self.outside * drawn * undrawn
        if not product:
            return 0.0
        return (self.shown * self.left_out - self.lost * self.beside) / math.sqrt(product)


@dataclass(frozen=True, eq=False)
class Answers:
    """One cell by object, (n,) bool each: drawn, has to be drawn, need not be drawn."""

    drawn: Bool
    seen: Bool
    outside: Bool

    @classmethod
    def of(cls, drawn: Bool, seen: Bool, within: Bool) -> Answers:
        """Of what was drawn, owns a sample, and reaches into the view."""
        return cls(drawn, seen, ~(within | seen))

    @property
    def wrong(self) -> Bool:
        return (self.seen & ~self.drawn) | (self.outside & self.drawn)

    def counted(self) -> Agreement:
        seen, outside, drawn = self.seen, self.outside, self.drawn
        which = (seen & drawn, seen & ~drawn, outside & drawn, outside & ~drawn)
        return Agreement(*(int(np.count_nonzero(one)) for one in which))


def within_view(camera: Camera, boxes: Float64) -> Bool:
    """(n,) bool: which boxes, (n, 2, 3) in the camera's space, lie beyond none of the planes of the
    view. Those that do own no sample; of the others some do not either."""
    # Of a box, the corner that lies farthest along a direction d has the greater bound where d is
    # positive, so a plane takes one product per axis. Objects without triangles have boxes of
    # infinities, which are within no view.
    low, high = boxes[:, 0], boxes[:, 1]
    finite = np.asarray(np.isfinite(boxes).reshape(len(boxes), 6).all(axis=1), np.bool_)
    low, high = np.where(finite[:, None], low, 0.0), np.where(finite[:, None], high, 0.0)
    result: Bool = finite.copy()
    forward, eye = camera.forward, camera.eye
    # The pixels' outer edges, half a pixel beyond the outermost samples.
    first_a, last_a = camera.column_a[0] - 1.0, camera.column_a[-1] + 1.0
    last_b, first_b = camera.row_b[0] + 1.0, camera.row_b[-1] - 1.0
    planes: list[tuple[Float64, float]] = [(forward, -float(forward @ eye) - camera.near)]
    if math.isfinite(camera.far):
        planes.append((-forward, float(forward @ eye) + camera.far))
    for step, least, greatest in (
        (camera.right_step, first_a, last_a),
        (camera.up_step, first_b, last_b),
    ):
        # A point is at step's a where (p - e) · step = a · |step|² · (depth, or 1).
        square = float(step @ step)
        for sign, limit in ((1.0, least), (-1.0, greatest)):
            normal = sign * step
            offset = 0.0
            if camera.is_perspective:
                normal = normal - sign * limit * square * forward
            else:
                offset = -sign * limit * square
            planes.append((normal, offset - float(normal @ eye)))
    if camera.clip_plane is not None:
        planes.append((np.array(camera.clip_plane[:3]), camera.clip_plane[3]))
    for normal, offset in planes:
        farthest = (np.where(normal > 0.0, high, low) * normal).sum(axis=1)
        np.logical_and(result, farthest + offset >= 0.0, out=result)
    return result
