"""The hard cases as a page: each with its right verdict in words, and the table as measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from visref.hardcases import EXACT, Cell, ExpectedFrame, HardCase, HardCaseTable, State, counted

_HEAD = """# Hard cases

Written by `visref hardcases --out docs/hard-cases.md`; do not edit.

Small scenes around the numerical traps of visibility, each with its right verdict, which
follows in closed form from how the scene is laid out. `python -m datasets_gen hard --out DIR`
writes them (`NAME.glb`, `NAME.path.json`, `NAME.expected.json`), for any engine to try.

- An **engine** is *right* on a case if it gives every sample of every frame to its owner. Where
  several objects are tied, any of them is right; ties that an engine does not list are counted
  as *unseen*. Only the exact engine lists ties, and it must list them all.
- A **culler** is *right* if no visible object is missing from what it draws (exact truth).
  What it left out is classed: a *tied* object whose co-owner was drawn loses no pixel; an
  object lost *within raster tolerance* is one that the rasteriser itself may lose, and did.
- *Samples* and *objects* are sums over frames."""

# Why an engine errs on a case: case, start of the engines' specs, reason.
_FILL_RULE = (
    "GL covers a sample exactly on an edge from one side only (the top-left rule), so that a "
    "closed triangle loses the samples on its other edges."
)
_DEPTH_STEP = (
    "Window depth is close to 1 nearly everywhere, where float32 steps by 2^-24 of the range "
    "and 24-bit depth does too: both surfaces get the same depth, and the one drawn last owns "
    "the samples."
)
_RANGE = (
    "At the far plane, and just outside either plane, clip coordinates differ from w by less "
    "than float32 resolves: what is clipped is decided by rounding."
)
_REASONS: tuple[tuple[str, str, str], ...] = (
    ("coinciding-silhouettes-on-samples", "gl", _FILL_RULE),
    (
        "sliver-edge-on-samples",
        "gl",
        f"{_FILL_RULE} Snapping to sub-pixels makes this sliver degenerate besides.",
    ),
    (
        "t-junction-gap",
        "embree open3d",
        "The gap that rounding has opened is narrower than the float32 error of a ray's "
        "direction, so the ray meets one of the sheet's triangles.",
    ),
    (
        "t-junction-gap",
        "gl",
        "The gap is narrower than the sub-pixel grid that vertices are snapped to.",
    ),
    (
        "tessellated-wall-far-away",
        "embree:robust=false",
        "Without robust mode the edge tests of neighbouring triangles round differently, and "
        "a ray at their edge slips between them.",
    ),
    (
        "enormous-triangle-1e30",
        "embree open3d",
        "Embree leaves out triangles with coordinates beyond 1.8e18, so these engines decline.",
    ),
    (
        "enormous-triangle-1e30",
        "gl",
        "Clipping against the view in float32 loses the rest of the triangle.",
    ),
    ("near-far-ratio-1e10", "gl", _DEPTH_STEP),
    ("grazing-floor", "gl", _DEPTH_STEP),
    ("at-near-and-far-perspective", "gl", _RANGE),
    ("at-near-and-far-orthographic", "gl", _RANGE),
)


def hard_cases_page(table: HardCaseTable, machine: Sequence[str] = ()) -> str:
    """The page in Markdown. `machine`: lines that say what the engines ran on."""
    lines = [_HEAD, "", "## As measured", "", *(f"- {line}" for line in machine), ""]
    columns = [*table.engines, "cullers"]
    lines.append("| case | " + " | ".join(columns) + " |")
    lines.append("|---" * (len(columns) + 1) + "|")
    for case in table.cases:
        cells = [_marked(table.cells[case.name][spec]) for spec in table.engines]
        cullers = culler_summary(table, case.name, _marked)
        lines.append(f"| [{case.name}](#{case.name}) | {' | '.join([*cells, cullers])} |")
    if table.cullers:
        lines += ["", f"The cullers: {_variants_each(table.cullers)}."]
    for case in table.cases:
        lines += ["", *section(case), *_why(table, case.name)]
    return "\n".join(lines) + "\n"


def section(case: HardCase) -> list[str]:
    """A case's part of the page, without anything measured."""
    lines = [f"## {case.name}", "", case.what, ""]
    if case.error:
        said = " and ".join(f'"{part}"' for part in case.error)
        return [*lines, f"Right: reading the scene fails in one line that says {said}."]
    if case.cull_backfaces:
        lines += ["With `--cull-backfaces`.", ""]
    for number, frame in enumerate(case.frames):
        place = f"Frame {number}: " if len(case.frames) > 1 else "Right: "
        lines.append(f"- {place}{verdict_in_words(frame)}")
    if case.between:
        lines += ["", f"Visible between the samples alone: {_names(case.between)}."]
    return lines


def verdict_in_words(frame: ExpectedFrame) -> str:
    """Who owns how many samples."""
    counts = np.bincount(frame.which.reshape(-1), minlength=len(frame.sets))
    alone: dict[int, list[str]] = {}
    tied, background = [], ""
    for owners, count in zip(frame.sets, counts.tolist(), strict=True):
        if count and not owners:
            background = f"{counted(count, 'sample')} of background"
        elif count and len(owners) == 1:
            alone.setdefault(count, []).extend(owners)
        elif count:
            tied.append(f"{_names(sorted(owners))} tied at {counted(count, 'sample')}")
    parts = [
        f"{_names(names)} {'owns' if len(names) == 1 else 'own'} {counted(count, 'sample')}"
        + (" each" if len(names) > 1 else "")
        for count, names in alone.items()
    ]
    text = "; ".join([*parts, *tied, *([background] if background else [])])
    hidden = f" Not visible: {_names(frame.hidden)}." if frame.hidden else ""
    return f"{text}.{hidden}"


def culler_summary(table: HardCaseTable, case: str, words: Callable[[Cell], str] = str) -> str:
    """All cullers on a case in a few words: how many are right, and which are not."""
    by_text: dict[str, list[str]] = {}
    for spec in table.cullers:
        by_text.setdefault(words(table.cells[case][spec]), []).append(spec)
    right = by_text.pop(State.RIGHT.value, [])
    parts = [f"{len(right)} right"] if right else []
    parts += [f"{text} ({_variants(specs, table.cullers)})" for text, specs in by_text.items()]
    return "; ".join(parts)


def _variants(specs: Sequence[str], everything: Sequence[str]) -> str:
    """Specs, those of one name together; all of a name's specs are not listed."""
    of_name: dict[str, list[str]] = {}
    for spec in specs:
        name, _, option = spec.partition(":")
        of_name.setdefault(name, []).append(option or "default")
    texts = []
    for name, options in of_name.items():
        all_of_name = sum(spec.partition(":")[0] == name for spec in everything)
        if len(options) < all_of_name:
            texts.append(f"{name}: {', '.join(options)}")
        else:
            texts.append(name if all_of_name == 1 else f"{name}, all {all_of_name}")
    return "; ".join(texts)


def _variants_each(specs: Sequence[str]) -> str:
    of_name: dict[str, list[str]] = {}
    for spec in specs:
        of_name.setdefault(spec.partition(":")[0], []).append(f"`{spec}`")
    return "; ".join(", ".join(same) for same in of_name.values())


def _marked(cell: Cell) -> str:
    strong = cell.state in (State.WRONG, State.FAILED)
    return str(cell).replace(cell.state, f"**{cell.state}**", 1) if strong else str(cell)


def _why(table: HardCaseTable, case: str) -> list[str]:
    """Reasons for what the table shows as wrong or refused, and only for that."""
    lines = []
    for name, prefixes, reason in _REASONS:
        specs = [
            spec
            for spec in table.engines
            if name == case
            and spec.startswith(tuple(prefixes.split()))
            and table.cells[case][spec].state in (State.WRONG, State.REFUSED)
        ]
        if specs:
            lines += ["", f"Why not {', '.join(f'`{spec}`' for spec in specs)}: {reason}"]
    return lines


def _names(names: Sequence[str]) -> str:
    shown = [f"`{name}`" for name in names[:4]]
    if len(names) > len(shown):
        shown = [*shown[:2], f"{len(names) - 2:,} more"]
    return " and ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)


def unexplained(table: HardCaseTable) -> list[tuple[str, str]]:
    """(case, engine) pairs that are wrong, and of which nothing is known why."""
    pairs = [(case.name, spec) for case in table.cases for spec in table.engines]
    return [
        (case, spec)
        for case, spec in pairs
        if spec != EXACT
        and table.cells[case][spec].state is State.WRONG
        and not any(f"`{spec}`" in line for line in _why(table, case))
    ]
