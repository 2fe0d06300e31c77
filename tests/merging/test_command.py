"""`--shard` and `visref merge` as a CI server calls them."""

from __future__ import annotations

import json
import re

import pytest

from tests.cases.files import add_rectangle, write_path
from tests.support.gltf_files import Gltf
from tests.support.same_bytes import differing
from visref.cli.main import main

ALL = ("lamp", "bolt", "hill")
# The lamp is switched on in frame 2. It is drawn a frame late, and once not at all.
GONE = [["lamp"] if at < 2 else [] for at in range(6)]
DRAWN = [ALL, ALL, ("bolt", "hill"), ALL, ("lamp", "hill"), ("bolt", "hill")]
POLICY = """
latency_frames = 1
[[waive]]
object = "bolt"
reason = "it is small"
frames = "3:6"
[[waive]]
object = "hill"
reason = "never needed"
"""


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A scene, what was drawn of it, the truth, and a policy."""
    folder = tmp_path_factory.mktemp("room")
    gltf = Gltf()
    add_rectangle(gltf, "lamp", -3.0, 0.0, -2.5, 0.4, -5.0)
    add_rectangle(gltf, "bolt", 1.0, 0.0, 1.3, 0.3, -5.0)
    add_rectangle(gltf, "hill", -10.0, -5.0, 30.0, 5.0, -8.0)
    write_path(folder, each=[{"absent": gone} for gone in GONE])
    gltf.write(folder / "scene.glb")
    rows = [{"frame": frame, "visible": list(names)} for frame, names in enumerate(DRAWN)]
    (folder / "drawn.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    (folder / "visref.toml").write_text(POLICY)
    scene, path = str(folder / "scene.glb"), str(folder / "path.json")
    assert main(["truth", scene, "--path", path, "--out", str(folder / "truth.parquet")]) == 0
    return folder


def check(room, out, *more):
    given = [str(room / "scene.glb"), "--path", str(room / "path.json")]
    given += ["--visible", str(room / "drawn.jsonl")]
    return main(["check", *given, "--out", str(out), *map(str, more)])


@pytest.mark.parametrize("with_truth", [True, False])
def test_shards_of_a_recording_are_merged_to_its_verdict_and_reports(room, with_truth, tmp_path):
    given = ["--policy", room / "visref.toml", "--today", "2026-01-01"]
    given += ["--truth", room / "truth.parquet"] if with_truth else []
    # The lamp is lost in frame 5, and the waiver of the hill is stale.
    assert check(room, tmp_path / "whole", *given, "--junit", tmp_path / "whole.xml") == 1
    statuses = []
    for number in (1, 2, 3):
        junit = ["--junit", tmp_path / f"junit-{number}.xml", "--no-summary"]
        out = tmp_path / f"part-{number}"
        statuses.append(check(room, out, *given, *junit, "--shard", f"{number}/3"))
    # Without the truth of frame 1 its part cannot tell that the lamp came into view in frame 2.
    assert statuses == [0, 0 if with_truth else 1, 1]
    parts = [str(tmp_path / f"part-{number}") for number in (3, 1, 2)]
    reports = ["--junit", str(tmp_path / "merged.xml"), "--summary", str(tmp_path / "merged.md")]
    assert main(["merge", *parts, "--out", str(tmp_path / "merged"), *reports]) == 1
    assert differing(tmp_path / "whole", tmp_path / "merged") == []
    said = json.loads((tmp_path / "merged" / "verdict.json").read_text())
    (culler,) = said["cullers"].values()
    assert (culler["late"], culler["waived"], culler["confirmed"]) == (1, 1, 1)
    assert "STALE_WAIVER" in {finding["code"] for finding in said["findings"]}
    # Without the names of the folders, and times.
    texts = [
        re.sub("whole|merged", "run", (tmp_path / name).read_text())
        for name in ("whole.xml", "merged.xml")
    ]
    assert texts[0] == texts[1]
    assert (tmp_path / "merged.md").read_text().startswith("#")


def test_the_report_of_a_merge_that_fails_says_so(room, tmp_path, capsys):
    check(room, tmp_path / "part", "--shard", "1/2")
    capsys.readouterr()
    junit = tmp_path / "junit.xml"
    out = ["--out", str(tmp_path / "merged"), "--junit", str(junit)]
    assert main(["merge", str(tmp_path / "part"), *out]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(tmp_path / "part") in line
    assert "missing: 2/2" in line
    assert "missing: 2/2" in junit.read_text()


@pytest.mark.parametrize("shard", ["0/3", "4/3", "3", "1/0", "a/b", "-1/2", "1/2/3", ""])
def test_what_names_no_part_is_bad_usage(shard, room, tmp_path, capsys):
    assert check(room, tmp_path / "part", f"--shard={shard}") == 2
    assert "--shard" in capsys.readouterr().err


def test_waivers_are_written_of_whole_runs_alone(room, tmp_path, capsys):
    waivers = ["--write-waivers", tmp_path / "new.toml"]
    assert check(room, tmp_path / "part", "--shard", "1/2", *waivers) == 2
    assert "whole run" in capsys.readouterr().err


def test_a_merge_replaces_none_of_its_parts(room, tmp_path, capsys):
    for number in (1, 2):
        check(room, tmp_path / f"part-{number}", "--shard", f"{number}/2")
    parts = [str(tmp_path / f"part-{number}") for number in (1, 2)]
    assert main(["merge", *parts, "--out", parts[0]]) == 2
    assert main(["merge", *parts, "--out", str(tmp_path)]) == 2
    assert main(["merge", *parts, str(room / "truth.parquet"), "--out", str(tmp_path / "x")]) == 2
    assert (tmp_path / "part-1" / "part.json").is_file()


@pytest.mark.parametrize("more", [("--workers", "0"), ("--workers", "2", "--shard", "1/2")])
def test_workers_that_there_cannot_be_are_refused(more, room, tmp_path, capsys):
    assert check(room, tmp_path / "out", *more) == 2
    assert "--workers" in capsys.readouterr().err


def test_two_workers_of_a_recording_leave_the_same_bytes(room, tmp_path):
    given = ["--policy", room / "visref.toml", "--today", "2026-01-01"]
    assert check(room, tmp_path / "one", *given, "--workers", "1") == 1
    assert check(room, tmp_path / "two", *given, "--workers", "2") == 1
    assert differing(tmp_path / "one", tmp_path / "two") == []
