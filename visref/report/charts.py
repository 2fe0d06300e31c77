"""Which lines the page plots over frames."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from visref.report.plots import Plot, Series, needs_log, on_scale
from visref.report.savings import BASELINES, baselines_of
from visref.report.summary import CullerSummary, of_frames
from visref.run_folder.read import RunFolder


def plots_of(run: RunFolder, rows: Sequence[CullerSummary]) -> list[Plot]:
    numbers = {row.culler: number for number, row in enumerate(rows)}

    def series(
        name: str, cullers: Sequence[CullerSummary] = rows, scale: float = 1.0
    ) -> list[Series]:
        found = []
        for row in cullers:
            sums = of_frames(run.frames_of[row.culler], name)
            values = {frame: value * scale for frame, value in sums.items()}
            if values:
                found.append(Series(row.culler, values, numbers[row.culler]))
        return found

    kinds: dict[str, list[CullerSummary]] = defaultdict(list)
    for row in rows:
        if row.frames:
            kinds[row.unit_kind].append(row)
    # A set for all views counts an object once, sets by view once in each: the first culler's.
    visible = of_frames(run.frames_of[rows[0].culler], "visible") if rows else {}
    # As its table counts object-frames, each view of a frame counts for itself.
    over = ", its views added up" if any(len(run.manifest.samples[f]) > 1 for f in visible) else ""
    plots = []
    for kind, cullers in sorted(kinds.items(), key=lambda item: item[0] != "object"):
        area = ("visible", visible) if kind == "object" else None
        title = "Drawn against visible" if kind == "object" else f"Drawn {kind}s"
        drawn, note = on_scale(series("drawn", cullers))
        plots.append(Plot(title, f"{kind}s in a frame{over}", drawn, area, note))
    missing = [row for row in rows if row.counts.losing]
    if missing:
        plots.append(Plot("Missed", "objects", series("missed", missing)))
        if any(row.counts.partly_missed for row in missing):
            plots.append(Plot("Partly missed", "objects", series("partly_missed", missing)))
        plots.append(Plot("Samples lost", "samples", series("missed_pixels", missing)))
    queries = [line for line in series("queries") if any(line.values.values())]
    if queries:
        plots.append(Plot("Queries", "asked of the depth buffer", queries))
    if triangles := run.manifest.scene.triangles:
        shares, note = on_scale(series("triangles_drawn", scale=100.0 / triangles))
        plots.append(Plot("Triangles drawn", "per cent of the scene", shares, note=note))
    for kind, baseline in sorted(
        baselines_of(run).items(), key=lambda item: BASELINES.index(item[0])
    )[:1]:
        whole = of_frames(run.frames_of[baseline], "triangles_drawn")
        saved = [
            Series(
                line.label,
                {
                    frame: 100.0 * (1.0 - value / whole[frame])
                    for frame, value in line.values.items()
                    if whole.get(frame)
                },
                line.style,
            )
            for line in series("triangles_drawn")
            if line.label != baseline
        ]
        # Who draws more than the baseline saves nothing.
        saved = [line for line in saved if line.values and min(line.values.values()) >= 0.0]
        plots.append(Plot("Triangles saved", f"per cent of what {kind} draws", saved))
    times = [
        Series(row.culler, run.warm_ms[row.culler], numbers[row.culler])
        for row in rows
        if run.warm_ms.get(row.culler)
    ]
    if times:
        log = needs_log(times)
        unit = "milliseconds of the culler's call" + (", logarithmic" if log else "")
        note = "Without each culler's first call in a process, which compiles and allocates."
        plots.append(Plot("Time", unit, times, note=note, log=log))
    ages = [Series(row.culler, row.ages, numbers[row.culler]) for row in rows if row.ages]
    if ages:
        plots.append(Plot("Ages of misses", "misses, by frames in view", ages, along="age"))
    return [plot for plot in plots if plot.series]
