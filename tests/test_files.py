"""Nothing half-written is ever left in place."""

from __future__ import annotations

import os

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


@pytest.mark.parametrize("make", [replacing_file, lambda p: replacing_folder(p, marker="m")])
def test_a_pipe_or_device_is_never_replaced(make, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="it is no"), make(tmp_path / "pipe"):
        pass
    assert (tmp_path / "pipe").is_fifo()


@pytest.mark.parametrize("make", [replacing_file, lambda p: replacing_folder(p, marker="m")])
def test_name_that_no_file_system_takes_is_a_clear_error(make, tmp_path):
    with pytest.raises(InputError, match="cannot write here"), make(tmp_path / ("n" * 300)):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_name_of_full_length_is_written(tmp_path):
    with replacing_file(tmp_path / ("n" * 255)) as beside:
        beside.write_text("whole")
    assert (tmp_path / ("n" * 255)).read_text() == "whole"


def test_a_link_to_a_run_folder_stays_a_link_to_the_new_one(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "m").write_text("1")
    (tmp_path / "link").symlink_to("run")
    with replacing_folder(tmp_path / "link", marker="m") as beside:
        (beside / "m").write_text("2")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "run" / "m").read_text() == "2"


def test_a_link_to_a_file_stays_a_link_to_the_new_one(tmp_path):
    (tmp_path / "old").write_text("1")
    (tmp_path / "link").symlink_to("old")
    with replacing_file(tmp_path / "link") as beside:
        beside.write_text("2")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "old").read_text() == "2"


def test_the_folder_one_stands_in_is_replaced_like_any(tmp_path, monkeypatch):
    (tmp_path / "run").mkdir()
    monkeypatch.chdir(tmp_path / "run")
    with replacing_folder(".", marker="m") as beside:
        (beside / "m").write_text("1")
    assert (tmp_path / "run" / "m").read_text() == "1"
    assert [p.name for p in tmp_path.iterdir()] == ["run"]
