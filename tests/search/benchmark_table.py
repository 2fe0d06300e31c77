"""The table of docs/fuzz.md, from what `tests.search.benchmark` wrote.

python -m tests.search.benchmark_table GENERATED.json RANDOM.json
"""

from __future__ import annotations

import json
import statistics
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

from tests.mutants.harness import suites
from tests.search.subjects import EFFECTS
from tests.wrong_cullers import WRONG


def groups() -> dict[str, str]:
    """By subject's name, the method that a mutant is made of, or the kind of a wrong culler."""
    found = {}
    for module, suite in suites().items():
        folder = module.split(".")[2]
        if folder not in EFFECTS:
            for mutant in suite.mutants:
                found[str(mutant)] = f"mutants of {folder.replace('_', ' ')}"
    for name, wrong in WRONG.items():
        found[f"wrong {name}"] = f"wrong cullers: {wrong.kind}"
    return found


def rows(results: list[dict[str, Any]]) -> list[str]:
    """A line per group: how many faults, and of each result how many were found, in how many trials
    (median, most)."""
    group_of = groups()
    names = [*results[0]["found"], *results[0]["not_found"]]
    by_group = defaultdict(list)
    for name in names:
        by_group[group_of[name]].append(name)
    by_group["all"] = names
    lines = []
    for group, members in by_group.items():
        cells = [group, str(len(members))]
        for result in results:
            trials = [result["found"][name][0] for name in members if name in result["found"]]
            middle = f"{statistics.median(trials):g}" if trials else "–"
            cells += [str(len(trials)), middle, str(max(trials, default="–"))]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def main() -> None:
    results = [json.loads(Path(name).read_text(encoding="utf-8")) for name in sys.argv[1:]]
    print("\n".join(rows(results)))
    for result in results:
        print(
            f"\n{result['trials']} trials, {result['seconds']} s; not found after so many trials:"
        )
        print(", ".join(f"{name} ({n})" for name, n in result["not_found"].items()))


if __name__ == "__main__":
    main()
