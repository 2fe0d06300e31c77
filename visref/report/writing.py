"""Writing a report: page, JUnit file and summary of run folders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from visref.beside import steady
from visref.errors import InputError
from visref.files import refuse_inputs, replacing_file
from visref.report.bench_folder import is_bench, read_bench
from visref.report.junit import junit_xml
from visref.report.markdown import markdown_summary
from visref.report.page import page_html
from visref.report.view3d import view3d_of
from visref.run_folder.layout import (
    REPORT,
    REPORT_JUNIT,
    REPORT_PAGE,
    REPORT_SCENE,
    REPORT_SUMMARY,
)
from visref.run_folder.read import read_run
from visref.scene import Scene

__all__ = ["write_report"]

# Characters of a page that has the view in three dimensions in it; of a larger one that is written
# beside. Nearly all of them are ASCII, a byte each.
MAX_PAGE = 8_000_000


def write_report(folders: Sequence[Path], out: Path, *, scene: str | Scene | None = None) -> Path:
    """Write `report.html`, `junit.xml` and `summary.md` into `out`; returns the page's path.

    A folder that `visref bench` wrote may stand among the run folders: its plot and its advice
    come too. `scene`: the one run's scene, loaded, a file or a generated one, which adds a view of
    it in three dimensions. The page is self-contained, but for `scene3d.js` beside it where the
    scene or the page is large. The same folders give the same bytes. Raises InputError where a
    folder is neither, no run is among them, `scene` is not what was judged, `out` cannot be written
    to, or a file there is one of theirs.
    """
    out = Path(out)
    benches = [read_bench(folder) for folder in map(Path, folders) if is_bench(folder)]
    runs = [steady(folder, read_run) for folder in map(Path, folders) if not is_bench(folder)]
    if not runs:
        raise InputError("no run folder was given", fix="name one that `visref run` wrote")
    source = scene.source if isinstance(scene, Scene) else scene
    read = [file for folder in folders for file in Path(folder).rglob("*")]
    for name in REPORT:
        # An earlier report may stand in a run folder.
        refuse_inputs(out / name, [source, *(file for file in read if file.name not in REPORT)])
    page = out / REPORT_PAGE
    flight = None
    if scene is not None:
        if len(runs) > 1:
            raise InputError("--scene goes with one run", fix="make a report of that run alone")
        flight = view3d_of(runs[0], scene)
    html = page_html(runs, benches, out, flight)
    if flight is not None and flight.scene and not flight.beside and len(html) > MAX_PAGE:
        flight = replace(flight, beside=True)
        html = page_html(runs, benches, out, flight)
    if flight is not None and flight.beside:
        with replacing_file(out / REPORT_SCENE) as beside:
            beside.write_text(flight.script(), encoding="utf-8")
    for file, text in (
        (page, html),
        (out / REPORT_JUNIT, junit_xml(runs, out)),
        (out / REPORT_SUMMARY, markdown_summary(runs, benches, out)),
    ):
        with replacing_file(file) as beside:
            beside.write_text(text, encoding="utf-8")
    return page
