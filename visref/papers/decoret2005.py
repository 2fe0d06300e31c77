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

from visref.papers import decoret2005_effects as effects
from visref.papers.contents import (
    Basis,
    Claim,
    Curve,
    Estimate,
    Experiment,
    Figure,
    JudgedRun,
    Results,
    Row,
    Sense,
    Size,
    Table,
    most,
    ratio_of,
    series,
)
from visref.papers.culler_frames import culler_frames
from visref.papers.printed.decoret2005 import (
    DEPTH_TESTS,
    LEVELS,
)

TITLE = "X. Décoret: N-Buffers for efficient depth map query. Computer Graphics Forum 24(3), 2005"

CULLERS = {
    "occlusion queries, hierarchy": "n-buffer:test=query,hierarchy=true,fragments=true",
    "occlusion queries": "n-buffer:test=query,fragments=true",
    "N-buffer, hierarchy": "n-buffer:hierarchy=true",
    "N-buffer": "n-buffer",
    "N-buffer on the GPU": "n-buffer:where=gpu",
    "N-buffer, one square": "n-buffer:squares=1",
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
        _times(results),
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
            Row(f"{of}: a level, GPU", ratio_of(ms, levels), gpu_level, "ms", 2, Basis.HARDWARE),
            Row(f"{of}: all levels, CPU", None, cpu, "ms", 1, Basis.HARDWARE),
            Row(f"{of}: a level, CPU", None, cpu_level, "ms", 2, Basis.HARDWARE),
        ]
    return Table("N-buffer levels", "Table 1", tuple(rows))


def _coverage(results: Results) -> Table:
    result = results.experiment("coverage")
    one, four, exact = (
        (None if result is None else result[name]) for name in ("extra_1", "extra_4", "exact_4")
    )
    in_colours = "the paper shows false colours, and prints no number"
    rows = (
        Row("extra over box pixels, one square", None, one, digits=2, note=in_colours),
        Row("extra over box pixels, four squares", None, four, digits=3, note=in_colours),
        Row("sizes that four squares cover exactly", None, exact, "%", 1, note=in_colours),
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
        )
    return Table("Covering boxes by squares", "Fig. 4", rows, figure=figure)


def _depth_tests(results: Results) -> Table:
    run = results.run("table-2")
    ours: dict[str, Estimate] = {}
    if run is not None:
        for name, spec in CULLERS.items():
            found = culler_frames(run, spec)
            counts = found.counts("query_fragments" if "query" in spec else "lookups")
            by_frame = dict(zip(found.frames, counts, strict=True))
            # Without the first frame of a stretch, which remembers nothing.
            warm = {frame: count for frame, count in by_frame.items() if frame - 1 in by_frame}
            kept = warm or by_frame
            ours[name] = series(list(kept.values()), list(kept), found.walk).mean()
    made = [
        Row(
            f"depth tests a frame, {name}",
            DEPTH_TESTS.get(name),
            ours[name].value if name in ours else None,
        )
        for name in CULLERS
    ]
    claims = _claims(ours)
    made += [
        Row(f"{quantity}, {over} over {under}", claim.published, _value(claim.ours), digits=digits)
        for (quantity, over, under, digits), claim in zip(_QUOTIENTS, claims, strict=True)
    ]
    built = results.experiment("levels")
    pixels = None
    if built is not None:
        width, height = WINDOW
        pixels = width * height * built["levels"][built["sizes"].index([width, height])]
    made.append(
        Row("pixels of the levels built, a frame", None, pixels, note="in none of the counts above")
    )
    return Table("Depth comparisons", "Table 2", tuple(made), claims)


def _times(results: Results) -> Table:
    run = results.run("table-2")
    ours: dict[str, Estimate] = {}
    if run is not None and run.timings:
        ours = {name: culler_frames(run, spec).ms_series().mean() for name, spec in CULLERS.items()}
    rows = tuple(
        Row(f"a frame, {name}", None, _value(ours.get(name)), "ms", 1, Basis.HARDWARE)
        for name in CULLERS
    )
    faster = Claim(
        "occlusion queries are currently faster than N-buffers: the time of these over theirs",
        Sense.AT_LEAST,
        ours["N-buffer"] / ours["occlusion queries"] if ours else None,
        told="here a query is rasterised in software, and depth read back lies in main memory",
    )
    return Table("Time of occlusion culling", "section 4.2", rows, (faster,))


def _value(ours: Estimate | None) -> float | None:
    return None if ours is None else ours.value


# What is compared with what, and the digits that show it.
_QUOTIENTS = (
    ("depth tests", "occlusion queries", "N-buffer", 0),
    ("depth tests", "occlusion queries, hierarchy", "N-buffer, hierarchy", 0),
    ("depth tests", "occlusion queries, hierarchy", "occlusion queries", 2),
    ("depth tests", "N-buffer", "N-buffer, hierarchy", 2),
)
_STATEMENTS = (
    "N-buffers need 400 times fewer depth tests than occlusion queries",
    "with a hierarchy N-buffers need 3,143 times fewer depth tests than occlusion queries",
    "with occlusion queries a hierarchy makes 5.5 times the depth tests",
    "with N-buffers a hierarchy saves depth tests, 1.43 times fewer",
)


def _claims(ours: dict[str, Estimate]) -> tuple[Claim, ...]:
    return tuple(
        Claim(
            statement,
            Sense.AT_LEAST,
            ours[over] / ours[under] if ours else None,
            ratio_of(DEPTH_TESTS[over], DEPTH_TESTS[under]),
            digits=digits,
        )
        for statement, (_, over, under, digits) in zip(_STATEMENTS, _QUOTIENTS, strict=True)
    )


def _motion(results: Results) -> Table:
    run = results.run("motion")
    rows: list[Row] = []
    missed: list[Estimate] = []
    for name, spec in MOVING.items():
        if run is None:
            rows.append(Row(f"{name}: visible objects missed", None, None))
            continue
        found = culler_frames(run, spec)
        visible, lost = sum(found.counts("visible")), sum(found.counts("confirmed"))
        drawn, hidden = sum(found.counts("drawn")), sum(found.counts("superfluous"))
        missed.append(found.series("confirmed").most())
        rows += [
            Row(
                f"{name}: visible objects missed", None, lost / visible if visible else None, "%", 2
            ),
            Row(f"{name}: drawn for nothing", None, hidden / drawn if drawn else None, "%", 1),
        ]
    own = Claim(
        "last frame's visible objects, drawn where they are now, are safe occluders in motion: the "
        "most objects missed in a frame",
        Sense.AT_MOST,
        most(*missed) if missed else None,
        even=0.0,
        ties=True,
        digits=0,
    )
    return Table("A scene in motion", "not in the paper", tuple(rows), own=(own,))
