"""What the bench leaves on disk: numbers (JSON, CSV), a plot, a table in Markdown, a page."""

from __future__ import annotations

import csv
import json
import os
import platform
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from markupsafe import Markup

from visref.bench.bounds import ALPHA
from visref.bench.timing import REPEATS, Bench
from visref.bench.verdict import headline, sentences
from visref.camera_path import CameraPath
from visref.recordings.truth_file import path_digest
from visref.report import words
from visref.report.bench_folder import FORMAT, MARKER
from visref.report.environment import page_environment
from visref.scene import Scene
from visref.threads import available_threads

_LIBRARIES = ("visref", "embreex", "open3d-cpu", "open3d", "moderngl", "numba", "numpy")
_DENSITIES = {16: "1", 8: "1/2", 4: "1/4", 2: "1/8", 1: "1/16"}

IMAGE_HEADINGS = (
    ("engine", ""),
    ("samples", "share of the frame's own"),
    ("seconds", "a frame"),
    ("visible", "objects"),
    ("wrong pixels", "numeric"),
    ("missed", "numeric"),
    ("invented", "numeric"),
    ("missed", "sampling"),
    ("missed", "definitional"),
)
GEOMETRIC_HEADINGS = (
    ("method", ""),
    ("rays a pixel", ""),
    ("seconds", "a frame"),
    ("found", "objects"),
    ("missed", "of the known"),
    ("refuted", "by exact"),
    ("share unseen, at most", "95 %, worst frame"),
    ("Good–Turing", "an estimate"),
)


def write_bench(
    folder: Path, bench: Bench, scene: Scene, path: CameraPath, threads: int | None
) -> None:
    """Write all files into a folder that exists and is empty."""
    camera = path.cameras[bench.frames[0]]
    facts = {
        "scene": scene.source,
        "objects": scene.object_count,
        "triangles": scene.triangle_count,
        "width": camera.width,
        "height": camera.height,
        "frames": len(bench.frames),
    }
    title = (
        f"{Path(scene.source).name} · {scene.object_count:,} objects · "
        f"{scene.triangle_count:,} triangles · {len(bench.frames)} frames of "
        f"{camera.width}×{camera.height}"
    )
    machine = _machine(threads)
    record = {
        "format": FORMAT,
        "version": 1,
        "scene": {"source": scene.source, "digest": scene.digest,
                  "objects": scene.object_count, "triangles": scene.triangle_count},
        "path": {"source": path.source, "digest": path_digest(path), "frames": bench.frames},
        "settings": {"threads": threads, "repeats": REPEATS, "alpha": ALPHA,
                     "alpha_each": bench.alpha_each},
        "machine": machine,
        "says": [headline(bench), *sentences(bench)],
        "samples": bench.samples,
        "objects_known": bench.objects_known,
        "image": [asdict(row) for row in bench.image],
        "geometric": [asdict(row) for row in bench.geometric],
        "frame_rows": bench.frame_rows,
        "left_out": [{"what": what, "why": why} for what, why in bench.left_out],
    }  # fmt: skip
    # Of an extra: only who measures needs it.
    from visref.bench.plot import pictures

    svg, png = pictures(bench, title)
    (folder / MARKER).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    (folder / "bench.svg").write_text(svg, encoding="utf-8")
    (folder / "bench.png").write_bytes(png)
    (folder / "bench.md").write_text(_markdown(bench, title), encoding="utf-8")
    (folder / "bench.html").write_text(_page(bench, facts, machine, svg), encoding="utf-8")
    _write_csv(folder / "bench.csv", bench)


def _machine(threads: int | None) -> dict[str, Any]:
    libraries = {}
    for name in _LIBRARIES:
        try:
            libraries[name] = version(name)
        except PackageNotFoundError:
            continue
    return {
        "system": platform.system(),
        "processor": platform.machine(),
        "cores": os.cpu_count(),
        "threads": threads or available_threads(),
        "python": platform.python_version(),
        "libraries": libraries,
    }


def image_cells(bench: Bench) -> list[tuple[str, ...]]:
    """The image truth's table, text by text, as `IMAGE_HEADINGS`."""
    count = words.count
    return [
        (
            row.engine,
            _DENSITIES[row.sixteenths],
            f"{row.seconds:.3f}",
            count(row.visible),
            count(row.numeric_wrong_samples),
            count(row.numeric_missed),
            count(row.numeric_extra),
            "–" if row.sampling_missed is None else count(row.sampling_missed),
            count(row.definitional_missed),
        )
        for row in bench.image
    ]


def geometric_cells(bench: Bench) -> list[tuple[str, ...]]:
    """The geometric truth's table, as `GEOMETRIC_HEADINGS`."""
    return [
        (
            row.method,
            str(row.rays_per_pixel or "–"),
            f"{row.seconds:.3f}",
            words.count(row.found),
            words.count(row.missed_of_known),
            words.count(row.refuted) if row.rays_per_pixel else "–",
            "–" if row.bound is None else f"{row.bound:.2e}",
            "–" if row.good_turing is None else f"{row.good_turing:.2e}",
        )
        for row in bench.geometric
    ]


def _markdown(bench: Bench, title: str) -> str:
    lines = [f"# {headline(bench)}", "", words.plain(title), ""]
    for sentence in sentences(bench):
        lines += [sentence, ""]
    for heading, headings, cells in (
        ("Image truth", IMAGE_HEADINGS, image_cells(bench)),
        ("Geometric truth", GEOMETRIC_HEADINGS, geometric_cells(bench)),
    ):
        names = [f"{name} ({note})" if note else name for name, note in headings]
        lines += [f"## {heading}", "", f"| {' | '.join(names)} |"]
        lines += ["|---|" + "--:|" * (len(names) - 1)]
        lines += [f"| {' | '.join(row)} |" for row in cells]
        lines.append("")
    lines += [f"Left out: {words.plain(what)}: {words.plain(why)}" for what, why in bench.left_out]
    lines.append(
        "Counts are sums over frames, seconds a mean of each frame's median of "
        f"{REPEATS}. The three errors are not to be added up."
    )
    return "\n".join(lines) + "\n"


def _write_csv(file: Path, bench: Bench) -> None:
    image = [{"promise": "image", **asdict(row)} for row in bench.image]
    geometric = [{"promise": "geometric", **asdict(row)} for row in bench.geometric]
    columns = list(dict.fromkeys(name for row in (*image, *geometric) for name in row))
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.DictWriter(out, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows([*image, *geometric])


def _page(bench: Bench, facts: dict[str, Any], machine: dict[str, Any], svg: str) -> str:
    environment = page_environment("visref.bench")
    libraries = ", ".join(f"{name} {number}" for name, number in machine["libraries"].items())
    return environment.get_template("bench.html.j2").render(
        headline=headline(bench),
        sentences=sentences(bench),
        facts=facts,
        name=Path(facts["scene"]).name,
        svg=Markup(svg),
        image_headings=IMAGE_HEADINGS,
        image=image_cells(bench),
        geometric_headings=GEOMETRIC_HEADINGS,
        geometric=geometric_cells(bench),
        left_out=bench.left_out,
        repeats=REPEATS,
        confidence=f"{100 * (1 - ALPHA):g} %",
        alpha_each=f"{bench.alpha_each:.2g}",
        machine=machine,
        libraries=libraries,
    )
