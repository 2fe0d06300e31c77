"""Reports from run folders alone: a page, a JUnit file for CI, a Markdown summary.

All three say what `verdict.json` says; nothing is judged again here.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from visref.beside import steady
from visref.errors import InputError
from visref.files import refuse_inputs, replacing_file
from visref.report.bench_folder import is_bench, read_bench
from visref.report.junit import junit_xml
from visref.report.markdown import markdown_summary
from visref.report.page import page_html
from visref.run_folder.layout import REPORT, REPORT_JUNIT, REPORT_PAGE, REPORT_SUMMARY
from visref.run_folder.read import read_run

__all__ = ["write_report"]


def write_report(folders: Sequence[Path], out: Path) -> Path:
    """Write `report.html`, `junit.xml` and `summary.md` into `out`; returns the page's path.

    A folder that `visref bench` wrote may stand among the run folders: its plot and its advice
    come too. The page is self-contained. The same folders give the same bytes. Raises InputError
    where a folder is neither, no run is among them, `out` cannot be written to, or a file there is
    one of theirs.
    """
    out = Path(out)
    benches = [read_bench(folder) for folder in map(Path, folders) if is_bench(folder)]
    runs = [steady(folder, read_run) for folder in map(Path, folders) if not is_bench(folder)]
    if not runs:
        raise InputError("no run folder was given", fix="name one that `visref run` wrote")
    read = [file for folder in folders for file in Path(folder).rglob("*")]
    for name in REPORT:
        # An earlier report may stand in a run folder.
        refuse_inputs(out / name, [file for file in read if file.name not in REPORT])
    page = out / REPORT_PAGE
    for file, text in (
        (page, page_html(runs, benches, out)),
        (out / REPORT_JUNIT, junit_xml(runs, out)),
        (out / REPORT_SUMMARY, markdown_summary(runs, benches, out)),
    ):
        with replacing_file(file) as beside:
            beside.write_text(text, encoding="utf-8")
    return page
