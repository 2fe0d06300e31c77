"""Run the benchmarks named on the command line, or all, and print their tables."""

from __future__ import annotations

import importlib
import pkgutil
import sys

import benchmarks

ROWS = list[dict[str, str]]


def table(rows: ROWS) -> str:
    """The rows as a Markdown table; columns in the first row's order."""
    lines = [list(rows[0]), *(list(row.values()) for row in rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    text = [
        "| " + " | ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)) + " |"
        for line in lines
    ]
    return "\n".join([text[0], "|" + "|".join("-" * (w + 2) for w in widths) + "|", *text[1:]])


def main(names: list[str]) -> int:
    known = sorted(m.name for m in pkgutil.iter_modules(benchmarks.__path__) if m.name[0] != "_")
    for name in names or known:
        if name not in known:
            print(f"no benchmark is named '{name}'; known are {', '.join(known)}", file=sys.stderr)
            return 2
        module = importlib.import_module(f"benchmarks.{name}")
        print(f"## {module.TITLE}\n\n{table(module.run())}\n", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
