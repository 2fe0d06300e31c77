"""What was missed in one drawn set: a table of misses, a column a fact.

A culler that leaves out half of a scene misses tens of thousands of objects in every frame. As
columns they take some 70 bytes each, and whoever asks the same of all of them asks once; one by
one they are `Miss`es.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from visref.scene import Float64, Int32, Int64

Bool = NDArray[np.bool_]


class MissKind(StrEnum):
    """What a miss is put down to; each is counted once, as the first that holds."""

    TIE = "tie"
    WITHIN_RASTER = "within_raster_tolerance"
    SMALL = "small"
    LATE = "late"
    WAIVED = "waived"
    CONFIRMED = "confirmed"


KINDS = tuple(MissKind)
# By kind its place in `KINDS`, as columns have it.
CODES = {kind: place for place, kind in enumerate(KINDS)}


@dataclass(frozen=True)
class Miss:
    """A visible object that was not drawn, or (`partly`) not all of it that is seen, with the
    sample that witnesses it.

    `samples`: those lost (0 for a tie); `owned`: samples at which it is seen. `sample` is a flat
    index in the image of `view`, `width` samples wide, `depth` view depth there. Margins are None
    where they were not computed. `age`: for how many frames it had been in view
    (`visref.judging.ages`), None where it has no age.
    """

    object: int
    kind: MissKind
    samples: int
    owned: int
    sample: int
    triangle: int
    depth: float
    margin_px: float | None = None
    margin_depth: float | None = None
    partly: bool = False
    view: str = ""
    width: int = 0
    age: int | None = None


class MissColumns(NamedTuple):
    """`Miss`'s fields, (k,) each. `kind`: places in `KINDS`; `view`: places in `Misses.views`.
    Margins are NaN, and ages -1, where a miss has None."""

    object: Int32
    kind: NDArray[np.int8]
    samples: Int64
    owned: Int64
    sample: Int64
    triangle: Int32
    depth: Float64
    margin_px: Float64
    margin_depth: Float64
    partly: Bool
    view: NDArray[np.int16]
    width: Int32
    age: Int64


_TYPES = ("i4", "i1", "i8", "i8", "i8", "i4", "f8", "f8", "f8", "?", "i2", "i4", "i8")


class Misses(Sequence[Miss]):
    """The misses of one verdict, in its order. `views`: the names that `columns.view` counts.

    The columns are at hand, or fetched each time that they are asked for, where a run keeps them
    on disk.
    """

    def __init__(
        self,
        columns: MissColumns | Callable[[], MissColumns],
        views: tuple[str, ...] = ("",),
        *,
        count: int | None = None,
    ) -> None:
        self._columns = columns
        self.views = views
        self._count = len(self.columns.object) if count is None else count

    @classmethod
    def of(cls, misses: Iterable[Miss]) -> Misses:
        """From misses, one by one."""
        every = list(misses)
        views = tuple(dict.fromkeys(one.view for one in every)) or ("",)
        place = {view: number for number, view in enumerate(views)}
        rows = [
            (
                one.object,
                CODES[one.kind],
                one.samples,
                one.owned,
                one.sample,
                one.triangle,
                one.depth,
                np.nan if one.margin_px is None else one.margin_px,
                np.nan if one.margin_depth is None else one.margin_depth,
                one.partly,
                place[one.view],
                one.width,
                -1 if one.age is None else one.age,
            )
            for one in every
        ]
        columns = zip(*rows, strict=True) if rows else ([] for _ in _TYPES)
        arrays = (np.array(one, kind) for one, kind in zip(columns, _TYPES, strict=True))
        return cls(MissColumns(*arrays), views)

    @property
    def columns(self) -> MissColumns:
        columns = self._columns
        return columns if isinstance(columns, tuple) else columns()

    def with_columns(self, **changed: NDArray[Any]) -> Misses:
        """The same with some columns otherwise."""
        return Misses(self.columns._replace(**changed), self.views)

    def are(self, kind: MissKind) -> Bool:
        """(k,) bool, which are of a kind."""
        found: Bool = self.columns.kind == CODES[kind]
        return found

    def number_of(self, kind: MissKind) -> int:
        """How many are of a kind."""
        return int(np.count_nonzero(self.are(kind)))

    def view_names(self) -> list[str]:
        """Each one's view."""
        return [self.views[place] for place in self.columns.view.tolist()]

    def kind_names(self) -> list[str]:
        """Each one's kind, as files have it."""
        return [KINDS[place].value for place in self.columns.kind.tolist()]

    def picked(self, places: Int64) -> list[Miss]:
        """Those at some places, (m,)."""
        columns = self.columns
        lists = (column[places].tolist() for column in columns)
        return [_miss(self.views, *row) for row in zip(*lists, strict=True)]

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> Miss: ...
    @overload
    def __getitem__(self, index: slice) -> list[Miss]: ...
    def __getitem__(self, index: int | slice) -> Miss | list[Miss]:
        if isinstance(index, slice):
            return self.picked(np.arange(len(self))[index])
        (found,) = self.picked(np.array([range(len(self))[index]]))
        return found

    def __iter__(self) -> Iterator[Miss]:
        return iter(self.picked(np.arange(len(self))))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and tuple(self) == tuple(other)

    def __hash__(self) -> int:
        return hash(tuple(self))

    def __repr__(self) -> str:
        return f"Misses.of({list(self)!r})"


def _miss(
    views: tuple[str, ...], obj: int, kind: int, samples: int, owned: int, sample: int,
    triangle: int, depth: float, margin_px: float, margin_depth: float, partly: bool, view: int,
    width: int, age: int,
) -> Miss:  # fmt: skip
    return Miss(
        obj, KINDS[kind], samples, owned, sample, triangle, depth,
        None if margin_px != margin_px else margin_px,
        None if margin_depth != margin_depth else margin_depth,
        partly, views[view], width, None if age < 0 else age,
    )  # fmt: skip
