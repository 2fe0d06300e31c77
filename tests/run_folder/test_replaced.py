"""What a run folder may hold to be replaced by the next run, and what is never an output."""

from __future__ import annotations

import os
import resource
import subprocess
import sys

import pyarrow.parquet as pq
import pytest
import trimesh

from tests.cli.test_cli import record, write_scene
from tests.support.dying import content
from visref.cli.main import main
from visref.recordings.truth_file import TRUTH_BEGINS


@pytest.fixture
def run(tmp_path):
    """A run with a miss, all that other commands add to its folder, and the arguments to make
    another."""
    scene, path = write_scene(tmp_path)
    visible = record(tmp_path, ["behind", "beside"], ["front", "beside"])
    out = tmp_path / "run"
    arguments = ["check", scene, "--path", path, "--visible", visible, "--out", str(out)]
    assert main(arguments) == 1
    assert main(["explain", str(out), "--frame", "0", "--object", "front"]) == 0
    assert main(["report", str(out), "--out", str(out)]) == 1
    return out, arguments


def test_a_run_folder_with_all_that_visref_adds_to_it_is_replaced(run):
    out, arguments = run
    added = set(content(out))
    assert main(arguments) == 1
    gone = added - set(content(out))
    assert {name for name in gone if not name.startswith("witnesses/")} == {
        "report.html", "junit.xml", "summary.md",
    }  # fmt: skip
    assert [name.endswith(".png") for name in gone if name.startswith("witnesses/")] == [True]


@pytest.mark.parametrize(
    "name",
    ["notes.txt", "pictures/holiday.jpg", "witnesses/notes.jsonl", "src/main.c", ".git/HEAD",
     "witnesses/front.png", "pictures/deep/frame.png", "objects.parquet.bak"],
)  # fmt: skip
@pytest.mark.parametrize("by_link", [False, True])
def test_what_the_user_put_into_it_stays(name, by_link, run, capsys):
    out, arguments = run
    file = out / name
    file.parent.mkdir(exist_ok=True)
    if by_link:
        file.symlink_to(out.parent / "path.json")
    else:
        file.write_text("mine")
    before = content(out.parent)
    capsys.readouterr()
    assert main(arguments) == 2
    assert content(out.parent) == before
    (line,) = capsys.readouterr().err.splitlines()
    assert name.partition("/")[0] in line


@pytest.mark.parametrize("manifest", ["{}", '{"format": "visref-run"}', '{"name": "site"}', "[]"])
def test_a_folder_with_the_manifest_of_something_else_stays(manifest, tmp_path):
    scene, path = write_scene(tmp_path)
    site = tmp_path / "site"
    (site / "src").mkdir(parents=True)
    (site / ".git").mkdir()
    (site / "manifest.json").write_text(manifest)
    before = content(site)
    commands = (["run", scene, "--path", path, "--culler", "none"],
                ["bench", scene, "--path", path])  # fmt: skip
    for command in commands:
        assert main([*command, "--out", str(site)]) == 2
        assert content(site) == before


def test_an_output_that_is_an_input_is_refused_by_every_command(run, capsys):
    out, _ = run
    folder = out.parent
    scene, path, visible = (
        str(folder / name) for name in ("scene.glb", "path.json", "drawn.jsonl")
    )
    truth = folder / "truth.parquet"
    given = [scene, "--path", path]
    assert main(["truth", *given, "--out", str(truth)]) == 0
    (folder / "link").symlink_to(scene)
    (folder / "hard link").hardlink_to(path)
    (out / "truth.parquet").unlink()
    (out / "truth.parquet").hardlink_to(truth)
    before = content(folder)
    check = ["check", *given, "--visible", visible]
    picture = ["explain", str(out), "--frame", "0", "--object", "front", "--picture"]
    for command in (
        *(["truth", *given, "--out", file] for file in (scene, path, "link", "hard link")),
        ["truth", *given, "--out", "new", "--geometric", scene],
        *(["run", *given, "--culler", "none", "--out", file] for file in (scene, path)),
        [*check, "--out", visible],
        [*check, "--out", str(folder)],
        [*check, "--truth", str(out / "truth.parquet"), "--out", str(out)],
        ["bench", *given, "--out", path],
        ["report", str(out), "--out", str(out / "manifest.json")],
        *([*picture, str(file)] for file in out.rglob("*.jpg")),
        [*picture, str(out / "manifest.json")],
        [*picture, scene],
    ):
        at_folder = [str(folder / part) if part in ("link", "hard link", "new") else part
                     for part in command]  # fmt: skip
        capsys.readouterr()
        assert main(at_folder) == 2, command
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("error: "), command
        assert content(folder) == before, command


def test_a_report_that_leads_to_a_file_of_its_run_is_refused(run):
    out, _ = run
    page = out.parent / "page"
    page.mkdir()
    for name in ("report.html", "junit.xml", "summary.md"):
        (page / name).symlink_to(out / "verdict.json")
        before = content(out.parent)
        assert main(["report", str(out), "--out", str(page)]) == 2
        assert content(out.parent) == before
        (page / name).unlink()


def test_a_tilde_is_a_name_in_every_command(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "~").mkdir()
    write_scene(tmp_path / "~")
    record(tmp_path / "~", ["front", "beside"], ["front", "beside"])
    monkeypatch.chdir(tmp_path)
    given = ["~/scene.glb", "--path", "~/path.json"]
    assert main(["truth", *given, "--out", "~/truth.parquet"]) == 0
    more = ["--truth", "~/truth.parquet", "--visible", "~/drawn.jsonl"]
    assert main(["check", *given, *more, "--out", "~/run"]) == 0
    assert main(["report", "~/run", "--out", "~/page"]) == 0
    assert main(["explain", "~/run", "--frame", "0", "--object", "front"]) == 2
    table = pq.read_table(tmp_path / "~" / "truth.parquet", columns=["frame", "name"])
    table = table.rename_columns(["frame", "object"])
    pq.write_table(table, tmp_path / "~" / "drawn.parquet")
    more = ["--visible", "~/drawn.parquet"]
    assert main(["check", *given, *more, "--out", "~"]) == 2
    assert main(["check", *given, *more, "--out", "~/~"]) == 0
    trimesh.creation.box().export(tmp_path / "~" / "box.stl")
    assert main(["objects", "~/box.stl"]) == 0
    assert (tmp_path / "~" / "page" / "report.html").is_file()
    assert (tmp_path / "~" / "~" / "verdict.json").is_file()
    assert not (tmp_path / "home").exists()


def test_a_full_disk_is_one_line_and_what_stood_there_stays(run):
    """Of a file system that takes 3,000 bytes of a file: each of these writes a larger one."""
    out, arguments = run
    scene, path = arguments[1], arguments[3]
    truth = out.parent / "truth.parquet"
    truth.write_bytes(TRUTH_BEGINS)
    page = out.parent / "page"
    before = content(out.parent)
    for command in (
        arguments,
        ["truth", scene, "--path", path, "--out", str(truth)],
        ["report", str(out), "--out", str(page)],
    ):
        done = subprocess.run(
            [sys.executable, "-m", "visref", *command],
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000)),
            capture_output=True,
            text=True,
        )
        assert done.returncode == 2, done.stderr
        (line,) = done.stderr.splitlines()
        assert "File too large" in line
        now = content(out.parent)
        now.pop("page", None)
        assert now == before
        assert os.listdir(page) == [] if page.exists() else True
