"""What a paper's module reads off a run folder: one culler's counters and times."""

from __future__ import annotations

import statistics
from dataclasses import dataclass

from visref.run_folder.read import Row, RunRecord


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
