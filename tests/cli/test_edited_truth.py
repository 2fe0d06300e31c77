"""A truth file that somebody edited gives no verdict; one that has no seal is not kept quiet."""

from __future__ import annotations

import json

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from tests.cli.test_cli import record, write_scene
from visref.cli.main import main
from visref.judging.status import Exit


def _without_beside(table: pa.Table) -> pa.Table:
    return table.filter(pc.not_equal(table["name"], "beside"))


def _facts(table: pa.Table, change) -> pa.Table:
    facts = json.loads(table.schema.metadata[b"visref"])
    change(facts)
    return table.replace_schema_metadata({b"visref": json.dumps(facts).encode()})


def _fewer_pixels(table: pa.Table) -> pa.Table:
    ones = pa.array(np.ones(len(table), np.int64))
    return table.set_column(table.schema.get_field_index("pixels"), "pixels", ones)


EDITS = {
    "rows dropped": _without_beside,
    "all rows dropped": lambda table: table.slice(0, 0),
    "rows in another order": lambda table: table.take(list(range(len(table)))[::-1]),
    "fewer samples": _fewer_pixels,
    "another engine in the metadata": lambda t: _facts(t, lambda f: f.update(engine="exact")),
    "exact in the metadata": lambda t: _facts(t, lambda f: f.update(exact=True)),
    "other counts in the metadata": lambda t: _facts(t, lambda f: f.update(owned=[1, 1])),
    "digest removed": lambda t: _facts(t, lambda f: f.pop("digest")),
    "rows dropped and digest emptied": lambda t: _facts(
        _without_beside(t), lambda f: f.update(digest="")
    ),
    "rows dropped and digest no text": lambda t: _facts(
        _without_beside(t), lambda f: f.update(digest=None)
    ),
    "rows dropped and version 1 claimed": lambda t: _facts(
        _without_beside(t), lambda f: f.update(version=1)
    ),
}


@pytest.fixture
def cast(tmp_path, capsys):
    """A scene, a path, their truth file, and a culler's record that misses `beside`."""
    scene, path = write_scene(tmp_path)
    truth = tmp_path / "truth.parquet"
    assert main(["truth", scene, "--path", path, "--out", str(truth)]) == 0
    capsys.readouterr()
    return scene, path, truth, record(tmp_path, ["front"], ["front"])


@pytest.mark.parametrize("edit", EDITS)
def test_an_edited_truth_file_is_bad_input_in_one_line_for_check_and_run(
    edit, cast, tmp_path, capsys
):
    scene, path, truth, missing = cast
    judged = {
        "check": ["check", scene, "--path", path, "--visible", missing],
        "run": ["run", scene, "--path", path, "--culler", "none"],
    }
    for arguments in judged.values():
        out = tmp_path / "out"
        more = ["--truth", str(truth), "--pictures", "0", "--out"]
        assert main([*arguments, *more, str(out)]) in (Exit.NO_VIOLATION, Exit.VIOLATION)
        capsys.readouterr()
    pq.write_table(EDITS[edit](pq.read_table(truth)), truth)
    for name, arguments in judged.items():
        out = tmp_path / f"of {name}"
        status = main([*arguments, "--truth", str(truth), "--pictures", "0", "--out", str(out)])
        assert status == Exit.BAD_INPUT
        printed = capsys.readouterr()
        assert printed.out == ""
        (line,) = printed.err.splitlines()
        assert line.startswith(f"error: {truth}: ")
        assert not out.exists()


def test_a_file_that_was_made_to_look_like_version_1_is_named_on_the_console(
    cast, tmp_path, capsys
):
    """Version 1 has no digest: whoever forges one is not found out, but said to be unsealed."""
    scene, path, truth, missing = cast
    table = _without_beside(pq.read_table(truth)).drop_columns(["view"])
    fields = ("view", "views", "digest", "exact")
    old = _facts(table, lambda f: [f.pop(name, None) for name in fields] and f.update(version=1))
    pq.write_table(old, truth)
    arguments = ["check", scene, "--path", path, "--visible", missing, "--truth", str(truth)]
    main([*arguments, "--pictures", "0", "--out", str(tmp_path / "out")])
    lines = capsys.readouterr().out.splitlines()
    (said,) = [line for line in lines if line.startswith("TRUTH_UNSEALED: ")]
    assert said.endswith(f"{truth} is of version 1 and has no digest")
