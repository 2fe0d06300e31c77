"""What a paper's module takes from a run folder: one culler's counters and times."""

from __future__ import annotations

import statistics
from dataclasses import dataclass

from visref.papers.estimates import Series, series
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import FrameRow


@dataclass(frozen=True)
class CullerFrames:
    """One culler's frames: the rows of `frames.parquet`, milliseconds by phase and frame, and the
    walk that they are of (the scene: each has one path)."""

    rows: tuple[FrameRow, ...]
    ms_of: dict[str, dict[int, float]]
    walk: str = ""

    @property
    def frames(self) -> list[int]:
        """The frame of each row."""
        return [row.frame for row in self.rows]

    def counts(self, counter: str) -> list[int]:
        """A counter (a column of `frames.parquet`) in each row. Raises KeyError where the culler
        did not count it."""
        values: list[int | None] = [getattr(row, counter) for row in self.rows]
        known = [value for value in values if value is not None]
        if len(known) < len(values):
            raise KeyError(counter)
        return known

    def mean(self, counter: str) -> float:
        """A counter's mean over frames. Raises KeyError where the culler did not count it."""
        return statistics.fmean(self.counts(counter))

    def series(self, counter: str) -> Series:
        """A counter by frame, for an `Estimate`. Raises KeyError where the culler did not count
        it."""
        return series(self.counts(counter), self.frames, self.walk)

    def ms_series(self, phase: str = "frame") -> Series:
        """Milliseconds of a phase by frame; a frame without it spent none."""
        times = self.ms_of.get(phase, {})
        return series([times.get(frame, 0.0) for frame in self.frames], self.frames, self.walk)

    def ms(self, phase: str = "frame") -> float:
        """Mean milliseconds of a phase over frames, as the papers average; a frame without it
        spent none."""
        return self.ms_series(phase).mean().value


def culler_frames(run: RunFolder, culler: str) -> CullerFrames:
    """The frames of the culler with this spec. Raises KeyError where the run has none of it."""
    times: dict[str, dict[int, float]] = {}
    for row in run.timings:
        if row.culler == culler:
            times.setdefault(row.phase, {})[row.frame] = row.ms
    rows = tuple(run.frames_of[culler])
    if not rows:
        raise KeyError(culler)
    return CullerFrames(rows, times, run.manifest.scene.source)
