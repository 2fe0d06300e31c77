"""What is kept of a frame around a miss, while its truth is at hand.

A *cut* is a lattice of at most `SURROUNDED_CELLS` samples in each direction that holds the miss's
witness and what the object lost, with as much again around it. It keeps the truth's own owners,
sample by sample; nothing is filtered. `visref.run_folder.surroundings` makes of it what a witness's
line says.

Which misses have a cut is said by their own verdict alone (`most_lost`), whatever was judged before
it. So a run and its parts keep the same: the worst miss of an object over the run is the worst of
its part too, and is among its verdict's `VERDICT_CUTS` in both or in neither.
"""

from __future__ import annotations

import zlib
from bisect import insort
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.judging.frame import SettledFrame
from visref.judging.misses import Miss, Misses, MissKind
from visref.recordings.spool import Spool
from visref.run_folder.layout import SURROUNDED_CELLS
from visref.scene import Int32, Int64

# So many misses of a verdict, those that lose most, may have their surroundings kept: about a
# kilobyte and a third of a millisecond each. Not fewer than `WITNESSES_PER_CULLER`: a miss that is
# among so many of a run is among so many of its verdict.
VERDICT_CUTS = 256
# What was forgotten is on disk still, up to so many bytes, or as many as what is not.
_FORGOTTEN = 16 << 20
_IN_MEMORY = 4 << 20


@dataclass(frozen=True, eq=False)
class Cut:
    """(h, w) arrays over a lattice of samples, of which the first is (x, y) and each further one
    `step` samples on. `triangle` int32: the owner, -1 for the background. `glass` and
    `glass_drawn` int32: the nearest glass seen before it, and the nearest that was drawn, -1 for
    none. `lost` bool: lost to the miss's object; `gone` bool: nothing at the nearest depth was
    drawn, whoever lost it."""

    x: int
    y: int
    step: int
    triangle: Int32
    glass: Int32
    glass_drawn: Int32
    lost: NDArray[np.bool_]
    gone: NDArray[np.bool_]

    def packed(self) -> bytes:
        flags = self.lost.astype(np.int32) + 2 * self.gone
        layers = np.stack([self.triangle, self.glass, self.glass_drawn, flags], dtype=np.int32)
        head = np.array([self.x, self.y, self.step, *self.triangle.shape], np.int64)
        return zlib.compress(head.tobytes() + layers.tobytes(), 1)

    @classmethod
    def unpacked(cls, data: bytes) -> Cut:
        raw = zlib.decompress(data)
        x, y, step, height, width = np.frombuffer(raw, np.int64, 5).tolist()
        layers = np.frombuffer(raw, np.int32, offset=40).reshape(4, height, width)
        triangle, glass, glass_drawn, flags = layers
        return cls(x, y, step, triangle, glass, glass_drawn, (flags & 1) > 0, (flags & 2) > 0)


class FrameCuts:
    """One settled frame, to be cut at its misses."""

    def __init__(self, settled: SettledFrame) -> None:
        self._settled = settled

    def of(self, miss: Miss) -> Cut:
        """What lies around a miss of this frame's view."""
        settled, camera = self._settled, self._settled.truth.camera
        mine = np.append(self._lost_to(miss.object), miss.sample)
        mine_y, mine_x = np.divmod(mine, camera.width)
        x, step_x = _lattice(mine_x, miss.sample % camera.width, camera.width)
        y, step_y = _lattice(mine_y, miss.sample // camera.width, camera.height)
        step = max(step_x, step_y)
        if step > 1:
            x, _ = _lattice(mine_x, miss.sample % camera.width, camera.width, step)
            y, _ = _lattice(mine_y, miss.sample // camera.width, camera.height, step)
        rows = slice(y, y + step * SURROUNDED_CELLS, step)
        columns = slice(x, x + step * SURROUNDED_CELLS, step)
        triangle = settled.truth.buffer.triangle[rows, columns]
        height, width = triangle.shape
        lost = np.zeros((height, width), np.bool_)
        if miss.kind is not MissKind.TIE:
            row, column = (mine_y - y) // step, (mine_x - x) // step
            there = (row * step == mine_y - y) & (column * step == mine_x - x)
            there &= (row >= 0) & (row < height) & (column >= 0) & (column < width)
            lost[row[there], column[there]] = True
        glass = glass_drawn = np.full((height, width), -1, np.int32)
        if len(settled.truth.blend.object):
            down, right = y + step * np.arange(height), x + step * np.arange(width)
            at = down[:, None] * camera.width + right
            glass, glass_drawn = _picked(self._glass, at), _picked(self._glass_drawn, at)
            own = _picked(self._own_glass(miss.object), at)
            glass = np.where(lost & (own >= 0), own, glass)
        gone = self._gone[rows, columns]
        return Cut(x, y, step, triangle, glass, glass_drawn, lost, gone)

    @cached_property
    def _gone(self) -> NDArray[np.bool_]:
        """(height, width) bool, the samples that are lost, whoever lost them."""
        camera = self._settled.truth.camera
        gone = np.zeros(camera.samples, np.bool_)
        gone[self._settled.walk.lost_samples] = True
        return gone.reshape(camera.height, camera.width)

    @cached_property
    def _losers(self) -> tuple[Int64, Int64]:
        """Every lost sample's owner, and the sample, by owner."""
        settled = self._settled
        sample, owner = settled.lost_pairs
        if len(settled.truth.blend.object):
            blend = settled.truth.blend
            at = np.isin(blend.sample, settled.walk.lost_blended_samples)
            pairs = blend.sample * settled.scene.object_count + blend.object
            # Glass is lost where none of the object's glass that is seen there was drawn.
            shown = np.unique(pairs[settled.drawn[blend.triangle]])
            at &= ~np.isin(pairs, shown)
            sample = np.concatenate([sample, blend.sample[at]])
            owner = np.concatenate([owner, blend.object[at]])
        order = np.argsort(owner, kind="stable")
        return owner[order], sample[order]

    def _lost_to(self, obj: int) -> Int64:
        owner, sample = self._losers
        low, high = np.searchsorted(owner, [obj, obj + 1])
        return sample[low:high]

    @cached_property
    def _glass(self) -> tuple[Int64, Int32]:
        return self._nearest_glass(np.ones(len(self._settled.truth.blend.object), np.bool_))

    @cached_property
    def _glass_drawn(self) -> tuple[Int64, Int32]:
        return self._nearest_glass(self._settled.drawn[self._settled.truth.blend.triangle])

    def _own_glass(self, obj: int) -> tuple[Int64, Int32]:
        return self._nearest_glass(self._settled.truth.blend.object == obj)

    def _nearest_glass(self, which: NDArray[np.bool_]) -> tuple[Int64, Int32]:
        """The samples at which some of these hits are seen, ascending, and the nearest of each."""
        blend = self._settled.truth.blend.where(which)
        order = np.lexsort((blend.triangle, blend.depth, blend.sample))
        sample, first = np.unique(blend.sample[order], return_index=True)
        return sample, blend.triangle[order][first]


def _picked(hits: tuple[Int64, Int32], at: Int64) -> Int32:
    """The triangle of the hit at each sample of `at`, -1 for none."""
    sample, triangle = hits
    result = np.full(at.shape, -1, np.int32)
    if len(sample):
        place = np.minimum(np.searchsorted(sample, at), len(sample) - 1)
        found = sample[place] == at
        result[found] = triangle[place[found]]
    return result


def _lattice(lost: Int64, witness: int, side: int, step: int = 0) -> tuple[int, int]:
    """Where along one side of an image the cells begin, and every how many-th sample has one: so
    that they hold the witness and, with as much again around, all that is lost."""
    low, high = int(lost.min()), int(lost.max())
    if not step:
        wanted = min(2 * (high - low + 1), side)
        step = max(1, -(-wanted // SURROUNDED_CELLS))
    # The samples that a cell can stand at, and the first cell: in the middle of what is lost, as
    # far as the image goes.
    phase = witness % step
    cells = (side - 1 - phase) // step + 1
    middle = ((low + high) // 2 - phase) // step
    first = min(max(middle - SURROUNDED_CELLS // 2, 0), max(cells - SURROUNDED_CELLS, 0))
    # The witness may lie off the middle of a lattice that is coarser than its own side needs.
    place = (witness - phase) // step
    first = min(max(first, place - SURROUNDED_CELLS + 1), place)
    return phase + first * step, step


def most_lost(misses: Misses, most: int | None = None) -> Int64:
    """The places, ascending, of the misses of a verdict that lose most samples, of whatever kind;
    of equals those of the lower objects: `VERDICT_CUTS`, or so many."""
    columns = misses.columns
    order = np.lexsort((columns.object, -columns.samples))
    return np.sort(order[: VERDICT_CUTS if most is None else most])


Key = tuple[int, int, int, int]
Place = tuple[int, str, int]


class CutKeeper:
    """Keeps the cuts that a culler's witnesses may need: of the misses that are among `most_lost`
    of their verdict those of the `worst`, by samples lost, and the worst confirmed one of each
    object."""

    def __init__(self, worst: int) -> None:
        self._worst = worst
        self._top: list[tuple[Key, Place]] = []
        self._best: dict[int, tuple[Key, Place]] = {}
        self._cuts: dict[Place, tuple[int, int]] = {}
        self._open: set[Place] = set()
        self._added = 0
        self._spool = Spool(_IN_MEMORY)
        self._written = self._live = 0

    def add(
        self,
        frame: int,
        misses: Misses,
        settled: tuple[SettledFrame, ...],
        *,
        open_: bool = False,
    ) -> None:
        """Add a verdict's misses, each in one of the settled views. `open_`: of which a policy may
        yet accept some that are confirmed, so that they are kept, and no others for them forgotten.
        """
        views = {one.truth.camera.view: FrameCuts(one) for one in settled}
        before = self._added
        self._added += len(misses)
        some = most_lost(misses)
        for place, miss in zip(some.tolist(), misses.picked(some), strict=True):
            if miss.view not in views:
                continue
            entry = (
                (-miss.samples, frame, miss.object, before + place),
                (frame, miss.view, miss.object),
            )
            is_top = len(self._top) < self._worst or entry < self._top[-1]
            confirmed = miss.kind is MissKind.CONFIRMED
            known = self._best.get(miss.object)
            is_best = confirmed and not open_ and (known is None or entry < known)
            is_open = confirmed and open_
            if not (is_top or is_best or is_open):
                continue
            if is_open:
                self._open.add(entry[1])
            self._keep(entry[1], views[miss.view].of(miss).packed())
            left = []
            if is_top:
                insort(self._top, entry)
                left += self._top[self._worst :]
                del self._top[self._worst :]
            if is_best:
                left += [known] if known is not None else []
                self._best[miss.object] = entry
            for other in left:
                self._forget(other)

    def _keep(self, place: Place, cut: bytes) -> None:
        if self._written - self._live > max(_FORGOTTEN, self._live):
            spool = Spool(_IN_MEMORY)
            self._cuts = {
                other: spool.put_bytes(self._spool.get_bytes(at))
                for other, at in self._cuts.items()
            }
            self._spool, self._written = spool, self._live
        self._live -= self._cuts.get(place, (0, 0))[1]
        self._cuts[place] = self._spool.put_bytes(cut)
        self._written += len(cut)
        self._live += len(cut)

    def _forget(self, entry: tuple[Key, Place]) -> None:
        best = self._best.get(entry[1][2]) == entry
        if entry not in self._top and not best and entry[1] not in self._open:
            # One entry may leave both: the worst ones, and its object's place for the worst.
            self._live -= self._cuts.pop(entry[1], (0, 0))[1]

    def get(self, frame: int, view: str, obj: int) -> Cut | None:
        """The cut of a miss, None where it was not kept."""
        at = self._cuts.get((frame, view, obj))
        return None if at is None else Cut.unpacked(self._spool.get_bytes(at))
