"""Nothing half-written is ever left in place."""

from __future__ import annotations

import pytest

from visref.errors import InputError
from visref.files import replacing_file, replacing_folder


def test_file_appears_whole_or_not_at_all(tmp_path):
    target = tmp_path / "deep" / "out.bin"
    with pytest.raises(ZeroDivisionError), replacing_file(target) as beside:
        beside.write_text("half")
        raise ZeroDivisionError
    assert not target.exists()
    with replacing_file(target) as beside:
        beside.write_text("whole")
    assert target.read_text() == "whole"
    assert [p.name for p in target.parent.iterdir()] == ["out.bin"]


def test_failed_run_leaves_the_last_good_one(tmp_path):
    target = tmp_path / "run"
    with replacing_folder(target, marker="manifest.json") as beside:
        (beside / "manifest.json").write_text("1")
    with (
        pytest.raises(ZeroDivisionError),
        replacing_folder(target, marker="manifest.json") as beside,
    ):
        (beside / "manifest.json").write_text("2")
        raise ZeroDivisionError
    assert (target / "manifest.json").read_text() == "1"
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_a_folder_that_is_not_ours_is_never_replaced(tmp_path):
    (tmp_path / "precious.txt").write_text("keep")
    refused = pytest.raises(InputError, match="not empty")
    with refused, replacing_folder(tmp_path, marker="manifest.json"):
        pass
    assert (tmp_path / "precious.txt").read_text() == "keep"


@pytest.mark.parametrize("make", [replacing_file, lambda p: replacing_folder(p, marker="m")])
def test_unwritable_place_is_a_clear_error(make, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write here"), make(tmp_path / "file" / "below"):
        pass
