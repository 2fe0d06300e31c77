"""The board: what it says of methods on several scenes is what their run folders say."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.support.report_runs import Scripted, write_run
from tests.support.run_values import run_folder
from visref.cli import main as cli
from visref.culler import Promise
from visref.errors import InputError
from visref.report.board import BASELINE, board_markdown, write_board
from visref.run_folder.layout import CULL_PHASE
from visref.run_folder.read import read_run

ALL, SEEN, WALL = tuple(range(6)), (0, 1, 2), (0,)


def cells(text: str, heading: str, method: str) -> dict[str, str]:
    """A method's row of the table under a heading, by column."""
    table = text.partition(heading)[2].partition("\n\n")[2].partition("\n\n")[0].splitlines()
    names, rows = table[0], table[2:]
    (row,) = (one for one in rows if one.startswith(f"| {method} |"))
    split = ([cell.strip() for cell in line.strip("|").split("|")] for line in (names, row))
    return dict(zip(*split, strict=True))


def timed(**ms):
    """A run of frames with these times, by culler."""
    rows = {name: [{"frame": frame} for frame in range(len(of))] for name, of in ms.items()}
    timings = [
        {"culler": name, "frame": frame, "view": "", "phase": CULL_PHASE, "ms": one}
        for name, of in ms.items()
        for frame, one in enumerate(of)
    ]
    return run_folder(rows, timings)


def test_times_are_quotients_of_medians_without_the_first_frame():
    text = board_markdown([timed(frustum=[900.0, 2.0, 4.0, 3.0], mine=[1.0, 6.0, 12.0, 9.0])])
    assert cells(text, "### scene", "mine")[f"time over {BASELINE}"] == "3.00"
    assert cells(text, "### scene", BASELINE)[f"time over {BASELINE}"] == "1.00"


def test_a_baseline_with_options_is_one():
    run = timed(**{"frustum:fragments=true": [9.0, 2.0], "mine": [9.0, 6.0]})
    assert cells(board_markdown([run]), "### scene", "mine")[f"time over {BASELINE}"] == "3.00"


def test_without_the_baseline_or_a_second_frame_there_is_no_time():
    for run in (timed(mine=[1.0, 6.0]), timed(frustum=[1.0], mine=[1.0])):
        assert cells(board_markdown([run]), "### scene", "mine")[f"time over {BASELINE}"] == "–"


def test_over_all_scenes_there_are_medians():
    runs = [
        replace(timed(frustum=[9.0, 1.0], mine=[9.0, ms]), folder=type(timed().folder)(name))
        for name, ms in (("a", 2.0), ("b", 5.0), ("c", 3.0))
    ]
    row = cells(board_markdown(runs), "## All scenes (3)", "mine")
    assert row[f"time over {BASELINE}"] == "3.00"
    assert row["scenes"] == "3 of 3"


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    root = tmp_path_factory.mktemp("board")
    loose = Scripted(SEEN, WALL, SEEN, promise=Promise.APPROXIMATE, queries=3)
    return [
        write_run(root / "one", [("safe", Scripted(ALL)), ("loose", loose)], pictures=()),
        write_run(
            root / "two",
            [("safe", Scripted(WALL)), ("falls", Scripted(ALL, fails_at=1))],
            pictures=(),
        ),
    ]


def test_what_a_promise_forbids_is_a_violation_and_all_else_a_miss_with_its_age(runs):
    text = board_markdown([read_run(run) for run in runs])
    safe, loose = (cells(text, "### one", name) for name in ("safe", "loose"))
    assert (safe["violations"], safe["missed"], safe["oldest miss"]) == ("0", "0", "–")
    # Three of the six objects show.
    assert safe["drawn for nothing"] == "50.0 %"
    assert (loose["violations"], loose["missed"], loose["verdict"]) == (
        "0",
        "2",
        "measured, not convicted",
    )
    assert cells(text, "### two", "safe")["violations"] == "10"
    over_all = cells(text, "## All scenes (2)", "safe")
    assert over_all["with violations"] == over_all["with misses"] == "1 of 2"
    assert over_all["promise"] == "conservative"
    assert cells(text, "## All scenes (2)", "loose")["with misses"] == "1 of 1"
    # What broke down is judged nowhere.
    assert cells(text, "## All scenes (2)", "falls")["scenes"] == "0 of 2"


def test_the_command_writes_it_and_refuses_what_it_reads(runs, tmp_path, capsys):
    board = tmp_path / "board.md"
    assert cli.main(["report", *map(str, runs), "--board", str(board)]) == 1
    assert board.read_text() == board_markdown([read_run(run) for run in runs])
    assert cli.main(["report", str(runs[0]), "--board", str(runs[0] / "verdict.json")]) == 2
    assert "verdict.json" in capsys.readouterr().err
    assert cli.main(["report", str(runs[0]), "--board", str(runs[0] / "board.md")]) == 2
    assert "a board in a run's folder" in capsys.readouterr().err
    (tmp_path / "notes.md").write_text("# Mine\n")
    assert cli.main(["report", str(runs[0]), "--board", str(tmp_path / "notes.md")]) == 2
    assert "of another kind" in capsys.readouterr().err
    assert (tmp_path / "notes.md").read_text() == "# Mine\n"
    # Over an earlier one.
    assert cli.main(["report", *map(str, runs), "--board", str(board)]) == 1


def test_nothing_and_two_of_one_name_are_refused(runs, tmp_path):
    with pytest.raises(InputError, match="no run folder"):
        write_board([], tmp_path / "board.md")
    with pytest.raises(InputError, match="two runs are named one"):
        board_markdown([read_run(runs[0]), read_run(runs[0])])
