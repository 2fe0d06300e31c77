"""Reports from run folders alone: a page, a JUnit file for CI, a Markdown summary.

All three say what `verdict.json` says; nothing is judged again here.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from visref.errors import InputError
from visref.files import replacing_file
from visref.report.junit import junit_xml
from visref.report.markdown import markdown_summary
from visref.report.page import page_html
from visref.run_record import read_run

__all__ = ["write_report"]


def write_report(run_folders: Sequence[Path], out: Path) -> Path:
    """Write `report.html`, `junit.xml` and `summary.md` into `out`; returns the page's path.

    The page is self-contained. The same run folders give the same bytes. Raises InputError
    where a folder is no run folder or `out` cannot be written to.
    """
    if not run_folders:
        raise InputError("no run folder was given", mend="name one that `visref run` wrote")
    runs = [read_run(Path(folder)) for folder in run_folders]
    page = Path(out) / "report.html"
    for file, text in (
        (page, page_html(runs, Path(out))),
        (Path(out) / "junit.xml", junit_xml(runs)),
        (Path(out) / "summary.md", markdown_summary(runs)),
    ):
        with replacing_file(file) as beside:
            beside.write_text(text, encoding="utf-8")
    return page
