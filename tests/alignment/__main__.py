"""The tables of docs/alignment.md, as Markdown: `python -m tests.alignment [mistakes|engines]`."""

from __future__ import annotations

import sys
from collections import Counter

from tests.alignment.faulty import conformance_cases, recordings
from tests.alignment.mistakes import MISTAKES
from tests.alignment.scenes import RECORDERS, SCENES
from tests.alignment.trying import found_for
from visref.alignment import best_alignment
from visref.alignment.sentence import sentence


def _line(*parts: object) -> None:
    sys.stdout.write(" ".join(map(str, parts)) + "\n")
    sys.stdout.flush()


def mistakes() -> None:
    columns = [(scene, recorder) for scene in SCENES for recorder in RECORDERS]
    _line("| mistake | named |", " | ".join(f"{a}, {b}" for a, b in columns), "|")
    _line("|---|---|" + "---|" * len(columns))
    total: Counter[str] = Counter()
    for name, mistake in MISTAKES.items():
        cells = []
        for scene, recorder in columns:
            if mistake.only not in ("", recorder):
                cells.append("")
                continue
            found = found_for(scene, recorder, mistake)
            right = found is not None and found.hypothesis.name == mistake.named
            word = "yes" if right else "no word" if found is None else found.hypothesis.name
            total["right" if right else "none" if found is None else "wrong"] += 1
            cells.append(word)
        _line(f"| {name} | {mistake.named} |", " | ".join(cells), "|")
    _line(f"\n{dict(total)}")


def engines(every: int) -> None:
    total: Counter[str] = Counter()
    own = {name: make() for name, make in SCENES.items()}
    for cases, step in ((conformance_cases(), every), (own, 1)):
        for name, at, path, timeline, sets in recordings(cases, step):
            found = best_alignment(timeline, path, sets, threads=1)
            kind = "silent"
            if found is not None:
                kind = "input or engine" if found.hypothesis.engine else "input alone"
                _line(f"{kind}: {name}, {at}: {sentence(found)}")
            total[kind] += 1
            if sum(total.values()) % 50 == 0:
                _line(dict(total))
        _line(dict(total))


if __name__ == "__main__":
    if sys.argv[1:2] != ["engines"]:
        mistakes()
    if sys.argv[1:2] != ["mistakes"]:
        engines(int((sys.argv[2:] or ["1"])[0]))
