"""A run folder's content as values: the rows of its tables, its manifest and its verdict.

Names are those of the files' columns and keys. What a folder of version 1 does not say is read as
`layout.SINCE_VERSION_2` has it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from visref.culler import RasterTolerance
from visref.run_folder.layout import UNNAMED_VIEW


@dataclass(frozen=True, kw_only=True, slots=True)
class Sums:
    """Counts of a frame, or summed over frames.

    `visible`, `missed`, `partly_missed`, their kinds and `undecided` count objects; `drawn`,
    `superfluous`, `superfluous_confirmed` and `missed_units` count units; `missed_pixels`,
    `owned_samples` and `undecided_samples` count samples. None stands for what version 1 did not
    count.
    """

    visible: int
    missed: int
    partly_missed: int | None
    confirmed: int
    ties: int
    within_raster_tolerance: int
    small: int
    late: int
    waived: int
    violations: int
    undecided: int
    missed_pixels: int
    owned_samples: int | None
    undecided_samples: int | None
    drawn: int
    superfluous: int
    superfluous_confirmed: int | None
    missed_units: int | None

    @property
    def losing(self) -> int:
        """Objects that were missed in full or in part, as far as that was counted."""
        return self.missed + (self.partly_missed or 0)


@dataclass(frozen=True, kw_only=True, slots=True)
class FrameRow(Sums):
    """A row of frames.parquet. Counters are `visref.culler.QueryStats`'s, None where the culler
    did not count. `owned`: samples that something owns for certain, None where the truth on file
    does not say."""

    culler: str
    frame: int
    view: str = UNNAMED_VIEW
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
    corrections: int
    image_pixels_differ: int | None = None
    owned: int | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class TimingRow:
    """A row of timings.parquet; `culler` is empty where the phase is the truth's."""

    culler: str
    frame: int
    view: str = UNNAMED_VIEW
    phase: str
    ms: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Witness:
    """A miss and the sample that proves it: `pixels` of the `owned` samples of the object are
    lost in this frame and view; (x, y) is the pixel, `depth` its view depth. Margins are None
    where nothing limits them or they were not computed. `partly`: the object shows elsewhere.
    `age`: for how many frames it had been in view, None where it has no age."""

    frame: int
    view: str = UNNAMED_VIEW
    object: int
    name: str
    kind: str
    pixels: int
    owned: int
    x: int
    y: int
    triangle: int
    depth: float
    margin_px: float | None
    margin_depth: float | None
    partly: bool
    age: int | None = None


@dataclass(frozen=True, slots=True)
class LostObject:
    """One object that a culler missed, in full or in part, over all frames: samples lost, in how
    many frames, how many of its misses are of a part, and the witness of the frame that lost
    most. `misses` counts frames and views."""

    samples: int
    frames: int
    misses: int
    partly: int
    worst: Witness


@dataclass(frozen=True, slots=True)
class HiddenUnit:
    """A unit that was drawn against the promise: in how many `frames` exact arithmetic found it
    hidden, and what it found in the one in which most samples were examined. It is hidden at all
    `samples` that it covers, nearest by `occluder` (a triangle) of the object `occluder_name` at
    the pixel (x, y); these are None where it covers no sample. `name` is empty unless units are
    objects."""

    unit: int
    name: str
    frames: int
    frame: int
    view: str
    samples: int
    occluder: int | None
    occluder_name: str | None
    x: int | None
    y: int | None


@dataclass(frozen=True, slots=True)
class SceneFacts:
    """The judged scene: where it came from, its digest and its size."""

    source: str
    sha256: str
    objects: int
    triangles: int


@dataclass(frozen=True, slots=True)
class PathFacts:
    """The camera path: where it came from, the digest of its samples, how many frames it has, and
    their numbers, ascending."""

    source: str
    sha256: str
    frames: int
    numbers: Sequence[int]


@dataclass(frozen=True, slots=True)
class CullerFacts:
    """What a culler declared, and its part of file names. `raster`: its rasteriser's tolerance,
    None if it declared none."""

    promise: str
    unit_kind: str
    units: int
    slug: str
    raster: RasterTolerance | None = None


@dataclass(frozen=True, slots=True)
class PictureSet:
    """The files of one frame, relative to the run folder, by what they show.

    `picture`: the shaded scene; `drawn`: who was drawn, and for what; `ids`: one colour per
    object; `owners`: each object's id (`visref.run_folder.owners.owner_picture`); `errors`: the
    missed samples, where there are any. `picture`, `ids` and `owners` are the same for every
    culler of a frame, and one file.
    """

    culler: str
    frame: int
    files: dict[str, str]
    view: str = UNNAMED_VIEW


@dataclass(frozen=True, slots=True)
class MovedFrame:
    """How many objects moved, appeared and vanished since the path's frame before."""

    frame: int
    moved: int
    appeared: int
    vanished: int


@dataclass(frozen=True, slots=True)
class MovedObject:
    """In how many judged frames an object stood otherwise than in the frame before, or appeared or
    vanished."""

    object: int
    name: str
    frames: int


@dataclass(frozen=True, slots=True)
class Motion:
    """What moved in the judged frames: how many different `objects`; the frames in which anything
    did; and those objects that did `most` often, the most often first."""

    objects: int
    frames: tuple[MovedFrame, ...]
    most: tuple[MovedObject, ...]


@dataclass(frozen=True, slots=True)
class WaiverFacts:
    """An accepted miss: patterns of objects and cullers, frames as slices (none: all), and why."""

    object: str
    reason: str
    frames: tuple[str, ...]
    culler: str
    expires: str | None


@dataclass(frozen=True, slots=True)
class PolicyFacts:
    """What the run's user had decided to accept (`visref.judging.policy.Policy`): the policy's file
    and its digest, and on which day it was asked."""

    source: str
    sha256: str
    today: str | None
    latency_frames: int
    min_samples: int
    max_undecided: float
    severities: dict[str, str]
    waivers: tuple[WaiverFacts, ...]


@dataclass(frozen=True, slots=True)
class Manifest:
    """manifest.json. `samples`: by number of the path's frames and by view, the samples' definition
    (`Camera.definition`). `exact`: whether the engine's truth is exact, None where it is not
    said. `motion`: None where nothing moves, or nothing is said of it. `policy`: None without
    one."""

    version: int
    scene: SceneFacts
    path: PathFacts
    engine: str
    exact: bool | None
    settings: dict[str, Any]
    cullers: dict[str, CullerFacts]
    pictures: tuple[PictureSet, ...]
    samples: Mapping[int, Mapping[str, Mapping[str, Any]]]
    versions: dict[str, str]
    machine: dict[str, Any]
    motion: Motion | None = None
    policy: PolicyFacts | None = None


@dataclass(frozen=True, slots=True)
class FindingRow:
    """A finding of verdict.json (`visref.findings`)."""

    code: str
    severity: str
    message: str
    culler: str
    frame: int | None
    object: str


@dataclass(frozen=True, kw_only=True, slots=True)
class CullerVerdict(Sums):
    """What verdict.json says of one culler; counts are sums over its judged `frames`. `ages`:
    misses by age in frames; `causes`: why things were missed. `excused_samples`: samples lost
    within the rasteriser's tolerance, None without one or where it is not recorded."""

    status: str
    promise: str
    frames: int
    unit_kind: str
    ages: dict[int, int]
    causes: tuple[dict[str, Any], ...]
    worst: Witness | None
    excused_samples: int | None = None


@dataclass(frozen=True, slots=True)
class RunVerdict:
    """verdict.json."""

    version: int
    status: str
    exit_status: int
    cullers: dict[str, CullerVerdict]
    findings: tuple[FindingRow, ...]
