"""The board has every method on board, and its page is of the runs that its file asks for."""

from __future__ import annotations

from pathlib import Path

from visref.batch.plan import read_batch
from visref.markdown import plain
from visref.registry import CULLERS, available

ROOT = Path(__file__).resolve().parent.parent.parent
JOBS = read_batch(ROOT / "docs" / "board.toml")
PAGE = (ROOT / "docs" / "board.md").read_text(encoding="utf-8")


def test_every_method_on_board_is_in_every_run():
    methods = {
        name for name, entry in available(CULLERS).items() if entry.module.startswith("visref_")
    }
    for job in JOBS:
        assert methods <= {culler.partition(":")[0] for culler in job.cullers}, job.name


def test_the_page_has_a_table_of_each_run_and_a_row_of_each_method():
    assert len(JOBS) >= 6
    for job in JOBS:
        table = PAGE.partition(f"\n### {plain(job.name)}, ")[2].partition("\n### ")[0]
        for culler in job.cullers:
            assert f"\n| {culler} | " in table, (job.name, culler)
