"""Names of files that are no text: bytes that no encoding of this day gives."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from tests.cli.test_cli import record, write_scene
from visref.cli.main import main

BAD = os.fsdecode(b"n\xff\xfe")


@pytest.fixture
def named(tmp_path, monkeypatch):
    """Scene, path and what was drawn, under such names, in a folder of such a name."""
    folder = tmp_path / BAD
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system has no such names")
    scene, path = write_scene(folder)
    visible = record(folder, ["front", "beside"], ["front"])
    monkeypatch.chdir(folder)
    names = []
    for file in (scene, path, visible):
        names.append(f"{BAD}{Path(file).suffix}")
        os.rename(file, names[-1])
    return names


def test_a_check_and_its_report_take_any_name(named, capsys):
    scene, path, visible = named
    run = f"{BAD}-run"
    asked = ["check", scene, "--path", path, "--visible", visible, "--pictures", "0"]
    assert main([*asked, "--out", run, "--workers", "1"]) == 1
    assert main(["report", run, "--out", f"{BAD}-page", "--board", f"{BAD}.md"]) == 1
    assert main(["explain", run, "--frame", "1", "--object", "beside"]) == 0
    assert capsys.readouterr().err == ""
    verdict = json.loads((Path(run) / "verdict.json").read_text(encoding="utf-8"))
    assert verdict["status"] == "violation"


def test_a_truth_and_its_labels_take_any_name(named, capsys):
    scene, path, visible = named
    truth, labels = f"{BAD}-truth.parquet", f"{BAD}-labels.parquet"
    files = ["--labels", labels, "--images", f"{BAD}-i", "--coco", f"{BAD}-c.json"]
    assert main(["truth", scene, "--path", path, "--out", truth, *files]) == 0
    assert main(["merge", labels, "--out", f"{BAD}-merged.parquet"]) == 0
    assert Path(f"{BAD}-merged.parquet").read_bytes() == Path(labels).read_bytes()
    asked = ["check", scene, "--path", path, "--visible", visible, "--truth", truth]
    assert main([*asked, "--pictures", "0", "--out", f"{BAD}-run", "--workers", "1"]) == 1
    assert capsys.readouterr().err == ""
