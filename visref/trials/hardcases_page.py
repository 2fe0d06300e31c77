"""The hard cases as a page: each with its right verdict in words, and the table as measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from visref.markdown import code, plain
from visref.trials.hardcases import Cell, ExpectedFrame, HardCase, HardCaseTable, State
from visref.wording import counted

_HEAD = """# Hard cases

Written by `visref hardcases --out docs/hard-cases.md`; do not edit.

Small scenes around the numerical traps of visibility, each with its right verdict, which
follows in closed form from how the scene is laid out.
`python -m visref_datasets_gen hard --out DIR` writes them (`NAME.glb`, `NAME.path.json`,
`NAME.expected.json`), for any engine to try.

- An **engine** is *right* on a case if it gives every sample of every frame to its owner. Where
  several objects are tied, any of them is right; ties that an engine does not list are counted
  as *unseen*. Only the exact engine lists ties, and it must list them all.
- A **culler** is *right* if no visible object is missing from what it draws (exact truth).
  What it left out is classed: a *tied* object whose co-owner was drawn loses no pixel; an
  object lost *within raster tolerance* is one that the rasteriser itself may lose, and did.
- *Samples* and *objects* are sums over frames."""

# Why an engine errs on a case: case, start of the engines' specs, reason.
# On which of the walls hangs on the instructions that Embree picks for the processor.
_EDGES = (
    "Without robust mode the edge tests of neighbouring triangles round differently, and a ray at "
    "their edge slips between them."
)
_RANGE = (
    "At the planes the clip coordinate z differs from w by less than float32 resolves, so that "
    "rounding decides what is clipped."
)
_REASONS: tuple[tuple[str, str, str], ...] = (
    (
        "coinciding-silhouettes-on-samples",
        "gl",
        "GL covers a sample exactly on an edge from one side only (the top-left rule), so that "
        "the closed card loses the samples on its right and lower sides.",
    ),
    (
        "sliver-edge-on-samples",
        "gl",
        "Snapped to the sub-pixel grid the sliver has no area, and GL draws nothing of it.",
    ),
    (
        "t-junction-gap",
        "embree open3d",
        "A pixel is 2e-8 units wide. Rounding the ray's origin to float32 moves it by about as "
        "much, past the gap.",
    ),
    (
        "t-junction-gap",
        "gl",
        "A pixel is 2e-8 units wide and the sheets are 3: their float32 vertices land several "
        "pixels off.",
    ),
    ("tessellated-wall-shifted", "embree:robust=false", _EDGES),
    ("tessellated-wall-far-away", "embree:robust=false", _EDGES),
    (
        "enormous-triangle-1e30",
        "embree open3d",
        "Beside 1e30, products of lengths of 1 fall below float32's exponents: known samples on "
        "the cards are missed, so these engines decline.",
    ),
    (
        "enormous-triangle-1e30",
        "gl",
        "Clipped in float32, the triangle's new corners miss the image's rim by far, and what "
        "is left does not cover it.",
    ),
    (
        "near-far-ratio-1e10",
        "gl",
        "Window depth at 1e6 is within 1e-8 of 1, less than one step of either depth buffer: "
        "both cards get the same depth, and the one drawn last owns the samples.",
    ),
    (
        "grazing-floor",
        "gl",
        "The sheets are 2^-25 apart, less than float32 transforms and depths resolve, so that "
        "rounding orders them.",
    ),
    ("at-near-and-far-perspective", "gl", _RANGE),
    ("at-near-and-far-orthographic", "gl", _RANGE),
)


def hard_cases_page(table: HardCaseTable, machine: Sequence[str] = ()) -> str:
    """The page in Markdown. `machine`: lines that say what the engines ran on."""
    lines = [_HEAD, "", "## As measured", "", *(f"- {plain(line)}" for line in machine), ""]
    columns = [*table.engines, "cullers"]
    lines.append("| case | " + " | ".join(map(plain, columns)) + " |")
    lines.append("|---" * (len(columns) + 1) + "|")
    for case in table.cases:
        cells = [_marked(table.cells[case.name][spec]) for spec in table.engines]
        cullers = culler_summary(table, case.name, _marked, plain)
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


def culler_summary(
    table: HardCaseTable,
    case: str,
    words: Callable[[Cell], str] = str,
    named: Callable[[str], str] = str,
) -> str:
    """All cullers on a case in a few words: how many are right, and which are not. `words` of a
    cell, and specs as `named` shows them."""
    by_text: dict[str, list[str]] = {}
    for spec in table.cullers:
        by_text.setdefault(words(table.cells[case][spec]), []).append(spec)
    right = by_text.pop(State.RIGHT.value, [])
    parts = [f"{len(right)} right"] if right else []
    parts += [
        f"{text} ({named(_variants(specs, table.cullers))})" for text, specs in by_text.items()
    ]
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
        of_name.setdefault(spec.partition(":")[0], []).append(code(spec))
    return "; ".join(", ".join(same) for same in of_name.values())


def _marked(cell: Cell) -> str:
    text = plain(str(cell))
    strong = cell.state in (State.WRONG, State.FAILED)
    return text.replace(cell.state, f"**{cell.state}**", 1) if strong else text


def _why(table: HardCaseTable, case: str) -> list[str]:
    """Reasons for what the table shows as wrong or refused, and only for that."""
    cells = table.cells[case]
    open_ = [s for s in table.engines if cells[s].state in (State.WRONG, State.REFUSED)]
    lines = []
    for name, prefixes, reason in _REASONS:
        specs = [spec for spec in open_ if spec.startswith(tuple(prefixes.split()))]
        if name == case and specs:
            lines += ["", f"Why not {', '.join(map(code, specs))}: {reason}"]
            open_ = [spec for spec in open_ if spec not in specs]
    if open_:
        lines += ["", f"Why not {', '.join(map(code, open_))}: this is not known."]
    return lines


def _names(names: Sequence[str]) -> str:
    shown = [f"`{name}`" for name in names[:4]]
    if len(names) > len(shown):
        shown = [*shown[:2], f"{len(names) - 2:,} more"]
    return " and ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)
