"""X. Décoret: N-Buffers for efficient depth map query. Computer Graphics Forum 24(3), 2005.

Tables 1 and 2 and Fig. 4; sections 4.3 and 4.4 are in `visref.papers.decoret2005_effects`.

Measured on `city`; the paper's city model and walk are not available. So depth tests compare in
order and ratio, and times, which belong to a GeForce 6800, not at all. Table 2 counts the depth
comparisons of the tests alone: with queries the samples that the boxes cover, with N-buffers the
lookups. Building the levels comes on top, as the paper says of it.

Occluders are the objects that were visible in the last frame. What becomes of those that have moved
the paper does not say; it is measured on `busy_street`, a street in motion.
"""

from __future__ import annotations

import statistics

from visref.papers import decoret2005_effects as effects
from visref.papers.contents import (
    Basis,
    Curve,
    Experiment,
    Figure,
    JudgedRun,
    Results,
    Row,
    Size,
    Table,
    Trend,
)
from visref.papers.culler_frames import culler_frames

TITLE = "X. Décoret: N-Buffers for efficient depth map query. Computer Graphics Forum 24(3), 2005"

# Table 1: levels and milliseconds by resolution.
LEVELS: dict[Size, tuple[int, float]] = {
    (256, 256): (8, 2),
    (512, 512): (9, 8),
    (640, 480): (10, 10),
    (1024, 1024): (10, 31),
}
# Fig. 4: pixels covered beyond the box over the box's own, over all sizes up to 512 by 512; and
# the share of sizes that four squares cover exactly.
EXTRA_ONE, EXTRA_FOUR, EXACT_FOUR = 2.19, 0.198, 0.341

# Table 2: depth comparisons a frame.
DEPTH_TESTS = {
    "occlusion queries, hierarchy": 1_100_000,
    "occlusion queries": 200_000,
    "N-buffer, hierarchy": 350,
    "N-buffer": 500,
}
CULLERS = {
    "occlusion queries, hierarchy": "n-buffer:test=query,hierarchy=true,fragments=true",
    "occlusion queries": "n-buffer:test=query,fragments=true",
    "N-buffer, hierarchy": "n-buffer:hierarchy=true",
    "N-buffer": "n-buffer",
    "N-buffer on the GPU": "n-buffer:where=gpu",
}
# Frames in a row, so that there is a last frame to remember.
STRETCH = 5

# The window of Table 2.
WINDOW: Size = (512, 512)

MOVING = {
    "occlusion queries": "n-buffer:test=query",
    "N-buffer": "n-buffer",
    "N-buffer, hierarchy": "n-buffer:hierarchy=true",
    "N-buffer on the GPU": "n-buffer:where=gpu",
}

RUNS = (
    JudgedRun("table-2", "city", tuple(CULLERS.values()), size=WINDOW, stretch=STRETCH),
    JudgedRun("motion", "busy_street", tuple(MOVING.values()), size=WINDOW, stretch=STRETCH),
)
EXPERIMENTS = (
    Experiment("levels", "n-buffer-levels"),
    Experiment("coverage", "n-buffer-coverage"),
    *effects.EXPERIMENTS,
)


def tables(results: Results) -> list[Table]:
    """Table 1, Fig. 4, Table 2, a scene in motion, and the two effects."""
    return [
        _levels(results),
        _coverage(results),
        _depth_tests(results),
        _motion(results),
        *effects.tables(results),
    ]


def _levels(results: Results) -> Table:
    result = results.experiment("levels")
    rows = []
    for place, ((width, height), (levels, ms)) in enumerate(LEVELS.items()):
        of = f"{width} × {height}"
        ours, gpu, cpu = (
            (result[name][place] for name in ("levels", "gpu_ms", "cpu_ms"))
            if result is not None
            else (None, None, None)
        )
        gpu_level, cpu_level = (None if ours is None else total / ours for total in (gpu, cpu))
        rows += [
            Row(f"{of}: levels", levels, ours),
            Row(f"{of}: all levels, GPU", ms, gpu, "ms", 1, Basis.HARDWARE),
            Row(f"{of}: a level, GPU", ms / levels, gpu_level, "ms", 2, Basis.HARDWARE),
            Row(f"{of}: all levels, CPU", None, cpu, "ms", 1, Basis.HARDWARE),
            Row(f"{of}: a level, CPU", None, cpu_level, "ms", 2, Basis.HARDWARE),
        ]
    return Table("N-buffer levels", "Table 1", tuple(rows))


def _coverage(results: Results) -> Table:
    result = results.experiment("coverage")
    one, four, exact = (
        (None if result is None else result[name]) for name in ("extra_1", "extra_4", "exact_4")
    )
    rows = (
        Row("extra over box pixels, one square", EXTRA_ONE, one, digits=2),
        Row("extra over box pixels, four squares", EXTRA_FOUR, four, digits=3),
        Row("sizes that four squares cover exactly", EXACT_FOUR, exact, "%", 1),
    )
    figure = None
    if result is not None:
        heights = tuple(result["heights"])
        figure = Figure(
            "height of a box 512 pixels wide",
            "extra over box pixels",
            tuple(
                Curve(label, heights, tuple(result[key]))
                for label, key in (("one square", "row_1"), ("four squares", "row_4"))
            ),
            log_y=False,
        )
    return Table("Covering boxes by squares", "Fig. 4", rows, figure=figure)


def _depth_tests(results: Results) -> Table:
    run = results.run("table-2")
    ours: dict[str, float] = {}
    if run is not None:
        for name, spec in CULLERS.items():
            found = culler_frames(run, spec)
            counts = found.counts("query_fragments" if "query" in spec else "lookups")
            # Without the first frame of a stretch, which remembers nothing.
            warm = [
                count
                for frame, count in zip(found.frames, counts, strict=True)
                if frame - 1 in found.frames
            ]
            ours[name] = statistics.fmean(warm or counts)
    made = [
        Row(f"depth tests a frame, {name}", DEPTH_TESTS.get(name), ours.get(name))
        for name in CULLERS
    ]
    published = DEPTH_TESTS["occlusion queries"] / DEPTH_TESTS["N-buffer"]
    over = ours["occlusion queries"] / ours["N-buffer"] if ours else None
    made.append(Row("occlusion queries over N-buffer", published, over))
    built = results.experiment("levels")
    pixels = None
    if built is not None:
        width, height = WINDOW
        pixels = width * height * built["levels"][built["sizes"].index([width, height])]
    made.append(
        Row("pixels of the levels built, a frame", None, pixels, note="in none of the counts above")
    )
    return Table("Depth comparisons", "Table 2", tuple(made), _trends(ours))


def _motion(results: Results) -> Table:
    run = results.run("motion")
    rows: list[Row] = []
    missed: list[float] = []
    for name, spec in MOVING.items():
        if run is None:
            rows.append(Row(f"{name}: visible objects missed", None, None))
            continue
        found = culler_frames(run, spec)
        visible, lost = sum(found.counts("visible")), sum(found.counts("confirmed"))
        drawn, hidden = sum(found.counts("drawn")), sum(found.counts("superfluous"))
        missed.append(lost)
        rows += [
            Row(
                f"{name}: visible objects missed", None, lost / visible if visible else None, "%", 2
            ),
            Row(f"{name}: drawn for nothing", None, hidden / drawn if drawn else None, "%", 1),
        ]
    trend = Trend(
        "last frame's visible objects, drawn where they are now, are safe occluders in motion",
        not any(missed) if missed else None,
    )
    return Table("A scene in motion", "not in the paper", tuple(rows), (trend,))


def _trends(ours: dict[str, float]) -> tuple[Trend, ...]:
    claims = (
        "N-buffers need two to three orders of magnitude fewer depth tests than queries",
        "a hierarchy raises the count for occlusion queries",
        "a hierarchy lowers the count for N-buffers",
    )
    if not ours:
        return tuple(Trend(claim, None) for claim in claims)
    queries, tree_queries = ours["occlusion queries"], ours["occlusion queries, hierarchy"]
    lookups, tree_lookups = ours["N-buffer"], ours["N-buffer, hierarchy"]
    ratio = queries / lookups
    return (
        Trend(claims[0], ratio >= 100.0, f"{ratio:.0f} times"),
        Trend(
            claims[1], tree_queries > queries, f"{queries:,.0f} without, {tree_queries:,.0f} with"
        ),
        Trend(
            claims[2], tree_lookups < lookups, f"{lookups:,.0f} without, {tree_lookups:,.0f} with"
        ),
    )
