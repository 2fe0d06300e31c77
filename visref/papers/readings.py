"""What a paper's module reads off a run folder: one culler's counters and times."""

from __future__ import annotations

import statistics
from dataclasses import dataclass

from visref.measures import rates
from visref.papers.table import Row as TableRow
from visref.run_record import Row, RunRecord


@dataclass(frozen=True)
class Reading:
    """One culler's frames: the rows of `frames.parquet`, and milliseconds by phase and frame."""

    rows: tuple[Row, ...]
    ms_of: dict[str, dict[int, float]]

    def mean(self, counter: str) -> float:
        """A counter's mean over frames. Raises KeyError where the culler did not count it."""
        values = [row[counter] for row in self.rows]
        if None in values:
            raise KeyError(counter)
        return statistics.fmean(values)

    def ms(self, phase: str = "frame") -> float:
        """Median milliseconds of a phase over frames; a frame without it spent none."""
        times = self.ms_of.get(phase, {})
        return statistics.median(times.get(row["frame"], 0.0) for row in self.rows)


def reading(record: RunRecord, culler: str) -> Reading:
    """The frames of the culler with this spec. Raises KeyError where the run has none of it."""
    times: dict[str, dict[int, float]] = {}
    for row in record.timings:
        if row["culler"] == culler:
            times.setdefault(row["phase"], {})[row["frame"]] = row["ms"]
    rows = tuple(record.frames_of[culler])
    if not rows:
        raise KeyError(culler)
    return Reading(rows, times)


def rate_rows(record: RunRecord, culler: str, name: str = "") -> tuple[TableRow, ...]:
    """The culler's error rates (`visref.measures.RATES`), a row each; `name` in its spec's place.
    They stand beside no published number."""
    return tuple(
        TableRow(f"{name or culler}: {rate.name}", None, share, unit="%", digits=2)
        for rate, share in rates(record, culler).named()
    )
