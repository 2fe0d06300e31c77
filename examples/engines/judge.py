"""Records an engine on the scenes of its page in docs/engines, has visref judge it, and prints the
page's tables.

    python examples/engines/judge.py panda3d|three|babylonjs|playcanvas|openscenegraph|bsp --out OUT

Each command is printed before it runs; all of them can be given by hand. What is generated,
recorded and judged stays in OUT: `visref report OUT/RUN --out PAGE` draws the page of a run. The
maps are those of Debian's package openarena-081-maps.
"""

from __future__ import annotations

import argparse
import json
import shlex
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

HERE = Path(__file__).resolve().parent
VISREF = (sys.executable, "-m", "visref")


class Trial(NamedTuple):
    """An engine's settings on a scene."""

    scene: str
    settings: tuple[str, ...] = ()


SIZE = ("--width", "320", "--height", "240")
SCENES = {
    "city": ("city", "--scale", "0.02", "--frames", "12", *SIZE),
    "rooms": ("soda_hall", "--scale", "0.02", "--frames", "12", *SIZE),
    "street": ("busy_street", "--frames", "12", "--width", "160", "--height", "120"),
}
QUERIES = ("--occlusion=optimistic", "--occluders=20")
TRIALS = {
    "panda3d": (
        Trial("city"),
        Trial("city", ("--occluders", "300")),
        Trial("rooms"),
        Trial("rooms", ("--occluders", "300")),
    ),
    "three": (
        Trial("city"),
        Trial("street", ("--level-0",)),
        Trial("street", ("--level-0", "--recompute")),
    ),
    "babylonjs": (
        Trial("city"),
        Trial("city", QUERIES),
        Trial("city", ("--occlusion=strict", "--occluders=20")),
        Trial("city", (*QUERIES, "--rounds=4")),
    ),
    "playcanvas": (Trial("city"),),
    "openscenegraph": (
        Trial("city"),
        Trial("city", ("--occluders", "300")),
        Trial("rooms"),
        Trial("rooms", ("--occluders", "300")),
        Trial("rooms", ("--occluders", "300", "--nested")),
    ),
    "bsp": tuple(
        Trial(f"{one}.bsp") for one in ("aggressor", "oa_dm1", "oa_dm3", "oa_dm5", "oa_minia")
    ),
}
MAPS = Path("/usr/share/games/openarena/baseoa/pak1-maps.pk3")
# Settings with which the conformance suite is recorded too, and what is expected of it.
SUITES = {
    "panda3d": {(): "conformance.toml", ("--occluders", "50"): "conformance-occluders.toml"},
    "three": {(): "conformance.toml"},
    "babylonjs": {},
    "playcanvas": {},
    "openscenegraph": {
        (): "conformance.toml",
        ("--small-feature", "0"): "conformance-all-sizes.toml",
    },
    "bsp": {},
}
COLUMNS = ("visible", "drawn", "superfluous", "missed", "partly_missed", "missed_pixels")
HEADINGS = ("visible", "drawn", "superfluous", "missed", "partly missed", "samples lost", "ages")


def recorder(engine: str) -> tuple[str, ...]:
    if engine in ("panda3d", "openscenegraph", "bsp"):
        words = (sys.executable, str(HERE / engine / "record.py"))
        return (*words, "draw") if engine == "bsp" else words
    return ("node", str(HERE / "web" / "record.mjs"), engine)


def run(*command: str | Path, good: tuple[int, ...] = (0,)) -> str:
    """Its standard output; the command is printed as one gives it by hand."""
    words = [str(word) for word in command]
    shown = ["python" if word == sys.executable else word for word in words]
    print(f"$ {shlex.join(shown).removeprefix('python -m ')}", file=sys.stderr, flush=True)
    done = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode not in good:
        raise SystemExit(f"it ended with status {done.returncode}")
    return done.stdout


def generated(trial: Trial, out: Path) -> tuple[Path, Path]:
    name = SCENES[trial.scene][0]
    scene, path = out / f"{name}.glb", out / f"{name}.path.json"
    if not path.exists():
        run(sys.executable, "-m", "visref_datasets_gen", *SCENES[trial.scene], "--out", out)
    return scene, path


def map_of(trial: Trial, out: Path) -> tuple[Path, Path]:
    """A map out of OpenArena's, which is a zip archive, and a path through it."""
    if not MAPS.exists():
        raise SystemExit(f"there is no {MAPS}; install openarena-081-maps")
    scene = out / trial.scene
    path = scene.with_suffix(".path.json")
    with zipfile.ZipFile(MAPS) as pack:
        scene.write_bytes(pack.read(f"maps/{trial.scene}"))
    run(sys.executable, HERE / "bsp" / "record.py", "path", scene, path)
    return scene, path


def judged(engine: str, trial: Trial, out: Path) -> dict[str, Any]:
    """What the verdict says of one trial."""
    scene, path = map_of(trial, out) if engine == "bsp" else generated(trial, out)
    label = "-".join([engine, trial.scene, *(one.strip("-") for one in trial.settings)])
    folder = out / label.replace("=", "-")
    recording = folder.with_suffix(".jsonl")
    run(*recorder(engine), scene, path, recording, *trial.settings)
    run(*VISREF, "check", scene, "--recording", recording, "--out", folder, good=(0, 1))
    (sums,) = json.loads((folder / "verdict.json").read_text(encoding="utf-8"))["cullers"].values()
    return sums


def row(trial: Trial, sums: dict[str, Any]) -> str:
    ages = ", ".join(f"{age}: {count}" for age, count in sums["ages"].items()) or "–"
    cells = [
        trial.scene,
        f"`{shlex.join(trial.settings)}`" if trial.settings else "",
        *(f"{sums[column]:,}" for column in COLUMNS),
        ages,
        sums["status"].replace("_", " "),
    ]
    return f"| {' | '.join(cells)} |"


def table(engine: str, out: Path) -> list[str]:
    rows = [row(trial, judged(engine, trial, out)) for trial in TRIALS[engine]]
    head = f"| scene | settings | {' | '.join(HEADINGS)} | status |"
    return [head, f"|---|---|{'--:|' * len(HEADINGS)}---|", *rows]


def conformance(engine: str, out: Path) -> list[str]:
    """A line for each of the settings with which the suite is recorded."""
    lines = []
    suite = out / "suite"
    for settings, expected in SUITES[engine].items():
        if not suite.exists():
            run(*VISREF, "conformance", "--write", suite)
        recordings = out / "-".join([engine, "suite", *(one.strip("-") for one in settings)])
        run(*recorder(engine), "--suite", suite, recordings, *settings)
        list_of = HERE / engine / expected
        asked = ("--recordings", recordings, "--suite", suite, "--expected", list_of)
        told = run(*VISREF, "conformance", *asked, good=(0, 1))
        sums = next(line for line in told.splitlines() if " cases: " in line)
        lines.append(f"`{shlex.join(settings)}`: {sums}" if settings else sums)
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("engine", choices=tuple(TRIALS))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--no-suite", action="store_true", help="the scenes alone")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    print("\n".join(table(options.engine, options.out)))
    if not options.no_suite:
        print("\n".join(["", *conformance(options.engine, options.out)]))


if __name__ == "__main__":
    main()
