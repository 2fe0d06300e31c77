"""The table of docs/fuzz.md, from what `tests.search.benchmark` wrote for several seeds.

python -m tests.search.benchmark_table SEED_0.json SEED_1.json …
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


def rows(seeds: list[dict[str, Any]]) -> list[str]:
    """A line per group: how many faults; how many were found, by the seeds' median and by each;
    and in how many trials, of all that were found by any seed (median, most)."""
    group_of = groups()
    by_group = defaultdict(list)
    for name in names_of(seeds[0]):
        by_group[group_of[name]].append(name)
    unsafe = [name for name in names_of(seeds[0]) if group_of[name].startswith("mutants")]
    by_group |= {"all mutants": unsafe, "all": names_of(seeds[0])}
    lines = []
    for group, members in by_group.items():
        counts = [sum(name in seed["found"] for name in members) for seed in seeds]
        trials = [seed["found"][n][0] for seed in seeds for n in members if n in seed["found"]]
        cells = [
            group,
            str(len(members)),
            f"{statistics.median(counts):g}",
            " ".join(map(str, counts)),
            f"{statistics.median(trials):g}" if trials else "–",
            str(max(trials, default="–")),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def names_of(seed: dict[str, Any]) -> list[str]:
    return [*seed["found"], *seed["not_found"], *seed["crashed"]]


def missed(seeds: list[dict[str, Any]]) -> list[str]:
    """The faults that half of the seeds or more did not find: by how many, and the trials that
    they went through."""
    lines = []
    for name in sorted(names_of(seeds[0])):
        tried = [seed["not_found"][name] for seed in seeds if name in seed["not_found"]]
        crashes = sum(name in seed["crashed"] for seed in seeds)
        if 2 * (len(tried) + crashes) >= len(seeds):
            ended = f", {crashes} times it ended its process" if crashes else ""
            lines.append(f"{name}: not found by {len(tried)}, after {tried} trials{ended}")
    return lines


def main() -> None:
    seeds = [json.loads(Path(name).read_text(encoding="utf-8")) for name in sys.argv[1:]]
    print("\n".join(rows(seeds)))
    for seed in seeds:
        print(f"seed {seed['seed']}: {seed['trials']} trials, {seed['seconds']} s")
    print("\n".join(missed(seeds)))


if __name__ == "__main__":
    main()
