"""`docs/benchmarks.md`, made of the JSON files in `benchmarks/history`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from statistics import median
from typing import Any

HISTORY = Path(__file__).parent / "history"
PAGE = Path(__file__).parent.parent / "docs" / "benchmarks.md"

KINDS = {
    "cast": "From a camera to samples per object",
    "masks": "What masks cost",
    "run": "Judging cullers, by workers",
    "truth": "Truth files, by version",
    "check": "A clean check",
    "judging": "Judging many triangles",
    "misses": "Frames in which very much is missed",
    "start": "Start",
    "loading": "Loading",
    "table": "Tables",
}

DIFFERING = "samples per million that differ"
# What has to be known to read a part.
NOTES = {
    "cast": (
        "The others cast the same rays, and count whose triangle is nearest. They know no near, no"
        " far, no masks and no glass, and of surfaces in the same place name any: in `leaves` they"
        " take each card for solid, and so do less; in `seismic` there is glass; in `soda_hall` a"
        " floor and a ceiling coincide."
    ),
    "truth": (
        "`visref truth` at 1280 × 960, three views of each scene by turns: processor time a frame"
        " beyond start-up, on all cores. Of masked and blended scenes the version before listed"
        " other things, and is not compared."
    ),
    "check": "`ms per frame` is processor time, on all cores.",
    "misses": (
        "Each frame's tiles are all missed, settled in exact arithmetic, and listed with a witness."
        " Causes are looked for in up to five frames of this size."
    ),
}

HEAD = """# Benchmarks

Made by `make bench` of the JSON files in [benchmarks/history](../benchmarks/history); a test holds
the two together. **Speed** is relative to the first row of each table's part: 2 is twice as fast.
What is compared took turns, and speeds are medians of the rounds' ratios, so that other load on the
machine bears on all alike; by processor time, where nothing else is said. Seconds are medians.

`make bench BENCH="--only cast"` measures one kind, `--scene FILE` runs and checks a scene of yours,
and `--before CHECKOUT/.venv/bin/visref` lets another version take its turns beside this one.
"""


def page(files: list[Path]) -> str:
    """The page of some JSON files, the newest last."""
    runs = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    return "\n".join([HEAD, *_latest(runs[-1]), *_history(runs)]) if runs else HEAD


def table(rows: list[Mapping[str, str]]) -> list[str]:
    """Rows as a Markdown table, a column for each name that any of them has."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    lines += ["| " + " | ".join(row.get(name, "") for name in names) + " |" for row in rows]
    return lines


def tables(run: Mapping[str, Any]) -> list[str]:
    """A heading and a table for each kind that was measured."""
    lines = []
    for kind, title in KINDS.items():
        found = [
            one["extra_info"] for one in run["benchmarks"] if one["extra_info"]["kind"] == kind
        ]
        if not found:
            continue
        lines += [f"## {title}", "", *([NOTES[kind], ""] if kind in NOTES else [])]
        if kind == "table":
            for one in found:
                lines += [f"### {one['name']}", "", *table(one["rows"]), ""]
            continue
        if kind == "cast":
            lines += [*table(_over_all(found)), ""]
        lines += [*table([row for one in found for row in _rows(one)]), ""]
        told = [(one["name"], _more(one["said"])) for one in found]
        said = [f"- {name}: {_said(more)}." for name, more in told if more]
        lines += [*said, ""] if said else []
    return lines


def headlines(run: Mapping[str, Any]) -> dict[str, str]:
    """A few figures of a run, for the history."""
    result = {}
    by_kind: dict[str, list[Any]] = {}
    for one in run["benchmarks"]:
        by_kind.setdefault(one["extra_info"]["kind"], []).append(one["extra_info"])
    for row in _over_all(by_kind.get("cast", [])):
        if row["what"].split(",")[0] in ("visref exact", "Open3D", "Mitsuba") and "median" in row:
            result.setdefault(f"cast: {row['what'].split(',')[0]}", row["median"])
    for info in by_kind.get("run", []):
        result["run: 2 workers"] = _number(info["jobs"]["2 workers"]["speed"])
    for kind in ("check", "judging", "misses", "loading"):
        for info in by_kind.get(kind, []):
            for name, value in info["said"].items():
                if not name.startswith("before"):
                    result[f"{kind}: {name}"] = _figure(value)
    return result


def _latest(run: Mapping[str, Any]) -> list[str]:
    machine, commit = run["machine_info"], run["commit_info"]
    versions = ", ".join(f"{name} {found}" for name, found in machine["versions"].items())
    changed = " and changes that were not committed" if commit.get("dirty") else ""
    return [
        f"The last run: {run['datetime'][:10]}, commit {str(commit.get('id'))[:12]}{changed}, on"
        f" {machine['cores']} cores of {machine['cpu']} ({machine['system']} {machine['machine']},"
        f" Python {machine['python_version']}); {versions}.",
        "",
        *tables(run),
    ]


def _history(runs: list[dict[str, Any]]) -> list[str]:
    rows = []
    for run in reversed(runs):
        commit = str(run["commit_info"].get("id"))[:12]
        rows.append({"date": run["datetime"][:10], "commit": commit, **headlines(run)})
    names = list(
        dict.fromkeys(name for row in rows for name in row if name not in ("date", "commit"))
    )
    lines = [
        "## History",
        "",
        "A column for each run, the newest first. Seconds are of the machine",
    ]
    lines[-1] += " at that time; speeds are relative to visref's Embree, or to one worker."
    turned = []
    for name in names:
        cells = {f"{row['date']} {row['commit']}": row.get(name, "") for row in rows}
        turned.append({"figure": name, **cells})
    return [*lines, "", *table(turned), ""]


def _more(said: Mapping[str, Any]) -> dict[str, Any]:
    """What is said of a benchmark and is no column."""
    return {name: value for name, value in said.items() if not name.endswith(DIFFERING)}


def _rows(info: Mapping[str, Any]) -> list[dict[str, str]]:
    rows = []
    for number, (what, job) in enumerate(info["jobs"].items()):
        row = {"": "" if number else info["name"], "what": what}
        if "skipped" in job:
            row["speed"] = f"skipped: {job['skipped']}"
        else:
            speed = _number(job["speed"]) + (" (wall clock)" if info["clock"] == "wall" else "")
            row |= {
                "processor s": _number(job["cpu_s"]),
                "wall s": _number(job["wall_s"]),
                "speed": speed if number else "1",
            }
            if f"{what}: {DIFFERING}" in info["said"]:
                row[DIFFERING] = _number(info["said"][f"{what}: {DIFFERING}"])
        rows.append(row)
    return rows


def _over_all(found: list[Mapping[str, Any]]) -> list[dict[str, str]]:
    """Median, least and greatest speed over the scenes, of each peer that has all of them."""
    speeds: dict[str, list[float]] = {}
    reasons = {}
    for info in found:
        for what, job in info["jobs"].items():
            if "skipped" in job:
                reasons[what] = job["skipped"]
            else:
                speeds.setdefault(what, []).append(job["speed"])
    rows = []
    for what in dict.fromkeys([*speeds, *reasons]):
        if what in speeds and len(speeds[what]) < len(found):
            continue
        if what in speeds:
            some = speeds[what]
            figures = {"median": median(some), "least": min(some), "greatest": max(some)}
            rows.append({"what": what, **{k: _number(v) for k, v in figures.items()}})
        else:
            rows.append({"what": what, "median": f"skipped: {reasons[what]}"})
    return rows


def _said(said: Mapping[str, Any]) -> str:
    return "; ".join(f"{name} {_figure(value)}" for name, value in said.items())


def _figure(value: float | str) -> str:
    return value if isinstance(value, str) else _number(value)


def _number(value: float) -> str:
    """Three digits that count."""
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
