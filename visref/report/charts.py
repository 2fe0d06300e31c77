"""Which lines the page plots over frames."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from visref.report.plots import Plot, Series, on_scale
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
    plots = []
    for kind, cullers in sorted(kinds.items(), key=lambda item: item[0] != "object"):
        area = ("visible", visible) if kind == "object" else None
        title = "Drawn against visible" if kind == "object" else f"Drawn {kind}s"
        drawn, note = on_scale(series("drawn", cullers))
        plots.append(Plot(title, f"{kind}s", drawn, area, note))
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
    times = [
        Series(row.culler, run.cull_ms[row.culler], numbers[row.culler])
        for row in rows
        if run.cull_ms.get(row.culler)
    ]
    if times:
        plots.append(Plot("Time", "milliseconds of the culler's call", times))
    return [plot for plot in plots if plot.series]
