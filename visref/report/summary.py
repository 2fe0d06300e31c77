"""Each culler's numbers over a run, and its error rates, defined once: here."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from visref.culler import Promise, RasterTolerance
from visref.findings import Code
from visref.judging.status import MAX_UNDECIDED, Status
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import FrameRow, HiddenUnit, LostObject, Sums


@dataclass(frozen=True)
class Rate:
    """An error rate: its key in `Rates`, its name in tables, and what is divided by what, each
    summed over the judged frames."""

    key: str
    name: str
    meaning: str


RATES = (
    Rate(
        "fnr",
        "FNR",
        "false-negative rate by object, missed / visible; what shows in part is not among it",
    ),
    Rate("partly", "partly", "rate of objects that lose a part, partly missed / visible"),
    Rate(
        "fpr",
        "FPR",
        "false-positive rate by object, superfluous / not visible; where a culler decides about "
        "objects",
    ),
    Rate(
        "fnr_px",
        "FNR px",
        "false-negative rate by pixel, samples lost / samples that anything owns or may own",
    ),
    Rate("per", "PER", "pixel error rate, samples lost / all samples"),
)
# A false positive has no pixel: what is superfluous changes no sample of the finished image.
NO_FPR_PX = (
    "There is no FPR by pixel: what is superfluous changes no sample. Its price in pixels is "
    "fragments."
)


def definitions() -> str:
    """`RATES` in a line of prose."""
    said = "; ".join(f"{rate.name}: {rate.meaning}" for rate in RATES)
    return f"{said}. {NO_FPR_PX}"


@dataclass(frozen=True)
class Rates:
    """One culler's shares of 1 by `RATES`; None stands for what cannot be said."""

    fnr: float | None
    partly: float | None
    fpr: float | None
    fnr_px: float | None
    per: float | None

    def named(self) -> list[tuple[Rate, float | None]]:
        return [(rate, getattr(self, rate.key)) for rate in RATES]


def rates(run: RunFolder, culler: str) -> Rates:
    """The culler's error rates over the frames that it was judged on."""
    verdict = run.verdict.cullers[culler]
    rows = run.frames_of[culler]
    hidden = None
    if verdict.unit_kind == "object":
        hidden = run.manifest.cullers[culler].units * len(rows) - verdict.visible
    # A truth on file may not say what is owned; then the sum is none.
    owned = verdict.owned_samples if all(row.owned is not None for row in rows) else None
    return Rates(
        fnr=_ratio(verdict.missed, verdict.visible),
        partly=_ratio(verdict.partly_missed, verdict.visible),
        fpr=_ratio(verdict.superfluous, hidden),
        fnr_px=_ratio(verdict.missed_pixels, owned),
        per=_ratio(verdict.missed_pixels, sum(map(run.samples_of, rows))),
    )


@dataclass(frozen=True)
class CullerSummary:
    """One culler's row. `counts` are `verdict.json`'s sums over frames; means are over frames;
    None stands for what was not measured. `failed`: it broke down, or never started. `cells`: how
    many drawn sets were judged, one for each frame and view. `partly_confirmed`: how many of the
    confirmed misses are of a part. `hidden`: what was drawn against its promise. `rounded`:
    rounding to float32 left samples open. `unsteady`: asked again, it answered otherwise.
    `max_undecided`: the share of owned samples that might stay undecided. `ages`: of the misses
    that lose samples, how many had been in view for so many frames, as far as they have an age.
    `other_input`: what is said where its recording fits another input, empty where it does not;
    `misaligned`: nothing is concluded from it then."""

    culler: str
    status: Status
    promise: Promise
    raster: RasterTolerance | None
    excused_samples: int | None
    failed: bool
    unsteady: bool
    max_undecided: float
    other_input: str
    misaligned: bool
    rounded: bool
    unit_kind: str
    units: int
    frames: int
    cells: int
    counts: Sums
    lost: tuple[LostObject, ...]
    partly_confirmed: int
    hidden: tuple[HiddenUnit, ...]
    frames_with_miss: int
    rates: Rates
    ages: dict[int, int]
    superfluous_share: float | None
    causes: dict[str, int]
    queries: float | None
    batches: float | None
    query_fragments: float | None
    triangle_share: float | None
    ms_median: float | None

    @property
    def convicts(self) -> bool:
        """Whether its misses are violations."""
        return self.promise.convicts

    @property
    def safe(self) -> bool:
        """A promise that was kept, and nothing visible left out: such rows alone compete for the
        best."""
        return self.status is Status.NO_VIOLATION_FOUND and not self.counts.confirmed

    @property
    def ageless(self) -> int:
        """How many misses that lose samples have no age: what was missed had been in view by right,
        since the first frame, a cut, or a frame that was not judged."""
        return max(0, self.counts.losing - self.counts.ties - sum(self.ages.values()))

    @property
    def undecided_share(self) -> float | None:
        """How much of the owned samples the verdict hangs on and nobody can decide."""
        return _ratio(self.counts.undecided_samples, self.counts.owned_samples)


def summarise(run: RunFolder, culler: str) -> CullerSummary:
    """The culler's numbers, from the run folder."""
    verdict = run.verdict.cullers[culler]
    rows = run.frames_of[culler]
    triangles = run.manifest.scene.triangles
    drawn_triangles = _mean(row.triangles_drawn for row in rows)
    times = list(run.warm_ms.get(culler, {}).values())
    lost = tuple(run.lost_objects(culler))
    broke_down = (Code.CULLER_FAILED, Code.NO_GL)
    facts = run.manifest.cullers[culler]
    policy = run.manifest.policy
    other_input = next(
        (
            f"{f.code}: {f.message}."
            for f in run.verdict.findings
            if f.culler == culler and f.code == Code.MISALIGNED
        ),
        "",
    )
    return CullerSummary(
        culler=culler,
        status=Status(verdict.status),
        promise=Promise(verdict.promise),
        raster=facts.raster,
        excused_samples=verdict.excused_samples,
        failed=any(f.culler == culler and f.code in broke_down for f in run.verdict.findings),
        unsteady=any(
            f.culler == culler and f.code == Code.NOT_DETERMINISTIC for f in run.verdict.findings
        ),
        max_undecided=MAX_UNDECIDED if policy is None else policy.max_undecided,
        other_input=other_input,
        misaligned=run.manifest.settings.get("if_misaligned") == "inconclusive"
        and bool(other_input),
        unit_kind=verdict.unit_kind,
        rounded=any(f.code == Code.VERTICES_ROUNDED for f in run.verdict.findings),
        units=facts.units,
        frames=verdict.frames,
        cells=len(rows),
        counts=verdict,
        lost=lost,
        partly_confirmed=sum(one.partly for one in lost),
        hidden=tuple(run.hidden_units(culler)),
        frames_with_miss=len({row.frame for row in rows if row.confirmed}),
        rates=rates(run, culler),
        ages=dict(sorted(verdict.ages.items())),
        superfluous_share=_ratio(verdict.superfluous, verdict.drawn),
        causes=run.superfluous_causes(culler),
        queries=_mean_of_frames(rows, "queries"),
        batches=_mean_of_frames(rows, "batches"),
        query_fragments=_mean_of_frames(rows, "query_fragments"),
        triangle_share=(
            drawn_triangles / triangles if drawn_triangles is not None and triangles else None
        ),
        ms_median=statistics.median(times) if times else None,
    )


def _ratio(part: int | None, whole: int | None) -> float | None:
    return part / whole if whole and part is not None else None


def _mean(values: Iterable[int | None]) -> float | None:
    """The mean of those that are known."""
    known = [value for value in values if value is not None]
    return statistics.fmean(known) if known else None


def _mean_of_frames(rows: Sequence[FrameRow], counter: str) -> float | None:
    """The mean over frames of what a counter says of all views of a frame together."""
    return _mean(of_frames(rows, counter).values())


def of_frames(rows: Sequence[FrameRow], name: str) -> dict[int, int]:
    """A column of a culler's rows by frame, summed over the frame's views; frames of which it is
    not known are left out."""
    sums: dict[int, int] = {}
    for row in rows:
        value = getattr(row, name)
        if value is not None:
            sums[row.frame] = sums.get(row.frame, 0) + value
    return sums


def best(
    rows: Sequence[CullerSummary],
    value: Callable[[CullerSummary], float | None],
    *,
    by_unit: bool = False,
) -> set[str]:
    """The safe cullers with the least value, if at least two safe ones were measured and they
    differ. `by_unit`: compare only within cullers whose units are of one kind."""
    groups: dict[str, list[tuple[float, str]]] = {}
    for row in rows:
        measured = value(row)
        if row.safe and measured is not None:
            key = row.unit_kind if by_unit else ""
            groups.setdefault(key, []).append((measured, row.culler))
    winners: set[str] = set()
    for group in groups.values():
        low, high = min(group)[0], max(group)[0]
        if low < high:
            winners |= {culler for measured, culler in group if measured == low}
    return winners
