"""The contract with a culler: units once, a drawn set for each camera.

The whole contract is `Culler`; what a method has no use for, it leaves as it is. The smallest
plug-in is a subclass with one method:

    class Mine(Culler):
        name = "mine"

        def cull(self, camera):
            return DrawnSet(np.flatnonzero(self.my_test(camera)))

The referee recomputes everything else and trusts no plug-in.
"""

from __future__ import annotations

import reprlib
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.errors import InputError, NothingToJudge
from visref.options import Option as Option
from visref.promise import Promise as Promise
from visref.scene import Int32, Scene, Units


@dataclass
class QueryStats:
    """What a frame cost, counted where the cost arises (never by a method about itself).

    `queries`: asked of the depth buffer; `queries_passed`: answered "visible";
    `batches`: times the method waited for answers (stalls); `query_fragments`: samples that
    the query geometry covers in the viewport, `query_fragments_passed`: those of queries
    answered "visible"; `lookups`: depths compared by a method that looks up a map where others
    rasterise; `depth_tests`: depth comparisons, drawing and queries together;
    `triangles_drawn`, `units_drawn`, `draw_calls`: of the final image;
    `state_changes`: of masks, programs and targets; `bytes_read_back`: from the GPU;
    `iterations`: rounds of a method that has rounds; `triangles_estimated`: those of the
    `triangles_drawn` that it drew before its first round; `tests_skipped`: queries that the
    method itself saved. `ms`: milliseconds of wall time by phase. None means not measured.
    """

    queries: int | None = None
    queries_passed: int | None = None
    batches: int | None = None
    tests_skipped: int | None = None
    query_fragments: int | None = None
    query_fragments_passed: int | None = None
    lookups: int | None = None
    depth_tests: int | None = None
    triangles_drawn: int | None = None
    units_drawn: int | None = None
    draw_calls: int | None = None
    state_changes: int | None = None
    bytes_read_back: int | None = None
    iterations: int | None = None
    triangles_estimated: int | None = None
    ms: dict[str, float] = field(default_factory=dict)

    def counts(self) -> dict[str, int]:
        """The counters that were measured, without the times."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "ms"}
        return {name: int(value) for name, value in values.items() if value is not None}


def is_count(value: object) -> bool:
    """Whether a counter may be this: a whole number that records hold (int64)."""
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    return whole and 0 <= value < 1 << 63  # type: ignore[operator]


def is_duration(value: object) -> bool:
    """Whether a time may be this: a number, finite and not negative."""
    number = isinstance(value, (int, float, np.integer, np.floating))
    if not number or isinstance(value, bool):
        return False
    # Compared as it is: a whole number without end is no float64.
    return 0 <= value <= sys.float_info.max  # type: ignore[operator]


@dataclass(frozen=True, eq=False)
class DrawnSet:
    """The units whose own triangles are in the draw list of the final image.

    `unit_ids`: int32, each at most once, in the order drawn (unless not `ordered`).
    `asked_at`: optional, beside `unit_ids`: how many units had been drawn when the depth buffer
    was asked about this one, -1 where it was drawn without asking. No verdict rests on it; it
    lets a report say why a unit was drawn for nothing.
    """

    unit_ids: Int32
    stats: QueryStats = field(default_factory=QueryStats)
    asked_at: Int32 | None = None
    ordered: bool = True


@dataclass(frozen=True)
class RasterTolerance:
    """How far a rasteriser may depart from the samples' definition, as it declares it.

    `snap_px`: the greatest distance, in pixels, that a vertex moves when it is snapped to the
    sub-pixel grid, plus the float32 transform's error. `depth_bits`: of a fixed-point depth
    buffer, None for float32 depth.

    A verdict takes at most `MOST_SNAP_PX` of snap and at least `LEAST_DEPTH_BITS` of depth
    (`check_tolerance`): who declares more excuses himself.
    """

    snap_px: float
    depth_bits: int | None = 24


# Half a pixel is the most that a rounding to whole pixels moves a vertex along an axis; every GL
# has at least four sub-pixel bits. No GL has a depth buffer of fewer than 16 bits, or more than 32.
MOST_SNAP_PX = 0.5
LEAST_DEPTH_BITS, MOST_DEPTH_BITS = 16, 32


def check_tolerance(declared: object) -> RasterTolerance:
    """A copy, in plain numbers, of what a rasteriser declares, whoever declares it: a plug-in or a
    command line. Raises ValueError, which says what is wrong, for anything out of bounds."""
    if not isinstance(declared, RasterTolerance):
        raise ValueError(f"a {type(declared).__name__} is no RasterTolerance")
    snap: object = declared.snap_px
    bits: object = declared.depth_bits
    # numpy's numbers stand for Python's.
    snap = snap.item() if isinstance(snap, np.generic) else snap
    bits = bits.item() if isinstance(bits, np.generic) else bits
    if not isinstance(snap, (int, float)) or isinstance(snap, bool):
        raise ValueError(f"snap_px is a {type(snap).__name__}, not a number")
    if bits is not None and (not isinstance(bits, int) or isinstance(bits, bool)):
        raise ValueError(f"depth_bits is a {type(bits).__name__}, not a whole number or None")
    # A subclass may compare as it likes. NaN compares false; an int may be too large for a float.
    snap = int(snap) if isinstance(snap, int) else float(snap)
    bits = None if bits is None else int(bits)
    least, most = LEAST_DEPTH_BITS, MOST_DEPTH_BITS
    if not 0.0 <= snap <= MOST_SNAP_PX:
        raise ValueError(f"a snap of {reprlib.repr(snap)} px is not from 0 to {MOST_SNAP_PX}")
    if bits is not None and not least <= bits <= most:
        raise ValueError(f"{reprlib.repr(bits)} bits of depth are not from {least} to {most}")
    return RasterTolerance(float(snap), bits)


class Raster(ABC):
    """The rasteriser behind a GL culler: its tolerance, and its own unculled picture."""

    tolerance: RasterTolerance

    @abstractmethod
    def item_buffer(self, camera: Camera) -> Int32 | None:
        """(height, width) int32 triangle ids of the unculled scene, `BACKGROUND` for none.

        None where the rasteriser is known by its declaration alone (a replayed engine's).
        """


class Culler(ABC):
    """An occlusion culler under judgement.

    A class states its `name`, a one-line `summary`, its `promise` and its `options`; the
    options' values are the constructor's keyword arguments. Arguments and results can be
    serialised: a culler may live in another process.

    `joint`: one drawn set serves all views of a frame, and `cull_joint` is called. `memory`:
    how many frames back it looks, None for no limit. `raster`: the rasteriser behind its depth
    buffer, None where it asks none. `timed`: the time of a call is the culler's own; not so where
    it plays back what was recorded.
    """

    name: ClassVar[str]
    summary: ClassVar[str] = ""
    options: ClassVar[Mapping[str, Option]] = {}
    promise: Promise = Promise.CONSERVATIVE
    joint: bool = False
    memory: int | None = None
    raster: Raster | None = None
    timed: bool = True

    def prepare(self, scene: Scene) -> Units:
        """Meet the scene, once, before any camera; say what is decided about."""
        return scene.object_units()

    @property
    def moves(self) -> bool:
        """Whether it can judge a scene in which something moves: whether it has an `update`."""
        return type(self).update is not Culler.update

    def update(self, scene: Scene) -> None:
        """Meet the scene as it stands now: called before a frame in which something has moved,
        appeared or vanished. A culler that leaves this as it is is for scenes that stand still."""

    @abstractmethod
    def cull(self, camera: Camera) -> DrawnSet:
        """Decide one view of a frame. Frames come in path order, each once, and a frame's views
        in the path's order; `camera.view` names the view, `camera.cut` says that the frame does
        not follow the one before."""

    def cull_joint(self, cameras: Sequence[Camera]) -> DrawnSet:
        """Decide one drawn set for all views of a frame; called in place of `cull` where `joint`.
        By default that of the only view."""
        (camera,) = cameras
        return self.cull(camera)

    def bounds(self) -> NDArray[np.float64] | None:
        """The boxes that the last frame's answer rests on, (u, 2, 3) float64 in world space, one
        per unit, least and greatest corner; None where it does not tell."""
        return None

    def close(self) -> None:
        """Free what the culler holds; it is not used afterwards."""


class Recorded(Culler):
    """A culler that plays back what was recorded: no answer of its hangs on what it was asked
    before."""

    memory = 0

    @abstractmethod
    def seek(self, frame: int) -> None:
        """The next frame that is asked for, once it is prepared."""


def check_drawn(drawn: DrawnSet, units: Units) -> NDArray[np.int32]:
    """The drawn unit ids, (k,) int32, one per unit drawn. Raises CullerError where a culler broke
    the contract."""
    ids = _numbers(drawn.unit_ids, "unit_ids is not a list of integers")
    if ids.ndim != 1 or (ids.size and not np.issubdtype(ids.dtype, np.integer)):
        raise CullerError("unit_ids is not a list of integers")
    if ids.size and not 0 <= ids.min() <= ids.max() < units.count:
        raise CullerError(f"a unit id is outside 0…{units.count - 1}")
    if len(np.unique(ids)) != len(ids):
        raise CullerError("a unit is drawn twice")
    return ids.astype(np.int32)


def check_asked(asked_at: object, drawn: int) -> NDArray[np.int32] | None:
    """`DrawnSet.asked_at`, (drawn,) int32, one per unit drawn. Raises CullerError where it names
    no moment before the unit's own draw."""
    if asked_at is None:
        return None
    asked = _numbers(asked_at, "asked_at is not an integer per unit drawn")
    if asked.shape != (drawn,) or (drawn and not np.issubdtype(asked.dtype, np.integer)):
        raise CullerError("asked_at is not an integer per unit drawn")
    if (asked < -1).any() or (asked > np.arange(drawn)).any():
        raise CullerError("asked_at names no moment before the draw")
    return asked.astype(np.int32)


def check_stats(stats: QueryStats, elapsed_ms: float | None) -> QueryStats:
    """A copy of a frame's stats, with the call's own time, if there is one, where they give none.
    Raises CullerError for a value that no record can hold."""
    if not isinstance(stats, QueryStats) or not isinstance(stats.ms, dict):
        raise CullerError("stats is no QueryStats")
    for f in fields(QueryStats):
        value = getattr(stats, f.name)
        if f.name != "ms" and value is not None and not is_count(value):
            raise CullerError(f"stats.{f.name} is {value!r}")
    for phase, ms in stats.ms.items():
        if not isinstance(phase, str) or not phase.isprintable() or not is_duration(ms):
            raise CullerError(f"stats.ms[{phase!r}] is {ms!r}")
    own = {} if elapsed_ms is None else {"cull": elapsed_ms}
    return replace(stats, ms={**own, **stats.ms})


def _numbers(value: object, otherwise: str) -> NDArray[Any]:
    """(any) array of what a culler handed over, or a CullerError that says what it is not."""
    try:
        return np.asarray(value)
    except Exception as error:  # its elements may be anything
        raise CullerError(otherwise) from error


class CullerError(RuntimeError):
    """A culler broke its contract or broke down; its frames cannot be judged."""


# More than this of an error's own text says no more.
_MAX_FAULT = 500


def fault_text(error: BaseException) -> str:
    """Whatever a culler raised, as one line; never raises, whatever the error's own methods do."""
    try:
        text = " ".join(str(error).split())[:_MAX_FAULT]
    except BaseException:  # its __str__ is the culler's as well
        text = ""
    if isinstance(error, SystemExit):
        return f"it left by sys.exit({text})"
    if isinstance(error, CullerError | InputError | NothingToJudge) and text:
        return text
    kind = type(error).__name__
    return f"{kind}: {text}" if text else kind
