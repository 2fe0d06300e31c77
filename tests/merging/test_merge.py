"""Parts of a run, put together, are the run that judges all frames at once, byte for byte."""

from __future__ import annotations

import json
import re
import shutil
from contextlib import contextmanager, suppress

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.merging.scenes import FRAMES, cullers, stereo, switched
from tests.support.same_bytes import differing
from visref.errors import InputError
from visref.files import replacing_folder
from visref.judging.policy import Policy, Span, Waiver
from visref.merging import merge_into, merge_runs, merge_truths
from visref.picking import Shard
from visref.report.writing import write_report
from visref.run_folder.layout import RUN_FOLDER
from visref.run_folder.read import read_run
from visref.runs import judge_to_folder, merge_naming, truth_to_file

POLICIES = {
    "no policy": None,
    "late": Policy(latency_frames=2, min_samples=3),
    "waived": Policy(
        latency_frames=1,
        waivers=(
            Waiver("pillar", "it is thin", (Span(2, 4),)),
            Waiver("wall", "never needed", (Span(0, 2),)),
            Waiver("no such thing", "gone"),
        ),
    ),
}


def whole_and_merged(root, inputs, kind, count, **given):
    """The folder of one run, and that of as many merged shards, given in the reverse order."""
    judge_to_folder(inputs(), cullers(kind), root / "whole", **given)
    parts = []
    for number in range(count, 0, -1):
        parts.append(root / f"part-{number}")
        judge_to_folder(inputs(), cullers(kind), parts[-1], shard=Shard(number, count), **given)
    with replacing_folder(root / "merged", kind=RUN_FOLDER) as folder:
        merge_naming(folder, parts, inputs())
    return root / "whole", root / "merged"


@pytest.mark.parametrize(
    ("kind", "count", "policy"),
    [
        ("objects", 2, "no policy"),
        ("objects", 4, "late"),
        ("objects", FRAMES, "late"),
        ("objects", 3, "waived"),
        ("broken", 2, "late"),
        ("broken", 4, "no policy"),
        ("broken", FRAMES, "waived"),
        ("units", 2, "waived"),
        ("units", 4, "late"),
        ("units", FRAMES, "late"),
    ],
)
def test_merged_shards_are_the_run(kind, count, policy, tmp_path):
    given = {"policy": POLICIES[policy], "pictures": 2}
    assert differing(*whole_and_merged(tmp_path, switched, kind, count, **given)) == []


@pytest.mark.parametrize(("kind", "count"), [("objects", 3), ("objects", FRAMES), ("units", 2)])
def test_merged_shards_of_more_misses_than_are_surrounded_are_the_run(
    kind, count, tmp_path, monkeypatch
):
    monkeypatch.setattr("visref.run_folder.witnesses.WITNESSES_PER_CULLER", 1)
    monkeypatch.setattr("visref.run_folder.witnesses.SURROUNDED_OBJECTS", 1)
    monkeypatch.setattr("visref.run_folder.write.WITNESSES_PER_CULLER", 1)
    monkeypatch.setattr("visref.run_folder.cuts.VERDICT_CUTS", 1)
    given = {"policy": POLICIES["late"]}
    whole, merged = whole_and_merged(tmp_path, switched, kind, count, **given)
    assert differing(whole, merged) == []
    lines = [
        json.loads(line)
        for file in sorted((merged / "witnesses").iterdir())
        for line in file.read_text().splitlines()
    ]
    told = [("surroundings" in one, one["facts"]["gap_px"] is not None) for one in lines]
    assert set(told) == {(True, True), (False, False)}


@pytest.mark.parametrize(
    ("kind", "inputs", "count"), [("objects", switched, 3), ("units", switched, 2),
                                  ("views", stereo, 2)]
)  # fmt: skip
def test_merged_shards_that_list_all_superfluous_are_the_run(kind, inputs, count, tmp_path):
    given = {"superfluous_rows": True, "pictures": 1}
    whole, merged = whole_and_merged(tmp_path, inputs, kind, count, **given)
    assert differing(whole, merged) == []
    run = read_run(merged)
    assert _superfluous_rows(merged) == sum(row.superfluous for row in run.frames)
    few = tmp_path / "few"
    judge_to_folder(inputs(), cullers(kind), few, pictures=1)
    assert 0 < _superfluous_rows(few) < _superfluous_rows(merged)


def _superfluous_rows(folder):
    kinds = pq.read_table(folder / "objects.parquet", columns=["kind"])["kind"].to_pylist()
    return kinds.count("superfluous")


def test_a_part_that_lists_all_superfluous_is_not_of_a_run_that_does_not(tmp_path):
    for number in (1, 2):
        given = {"shard": Shard(number, 2), "superfluous_rows": number == 2}
        judge_to_folder(switched(), cullers("objects"), tmp_path / f"part-{number}", **given)
    with pytest.raises(InputError, match="part-2: it was run with other settings"):
        merge_runs([tmp_path / "part-1", tmp_path / "part-2"], tmp_path / "out")


def test_without_the_scene_merged_shards_are_the_run_but_for_its_causes(tmp_path):
    whole, merged = whole_and_merged(tmp_path, switched, "objects", 2)
    merge_runs([tmp_path / "part-1", tmp_path / "part-2"], tmp_path / "without")
    apart = [one for one in differing(whole, tmp_path / "without") if "witnesses" not in one]
    assert sorted(apart) == ["objects.parquet", "verdict.json"]
    named = [read_run(one).verdict.cullers for one in (whole, merged, tmp_path / "without")]
    causes = [{name: culler.causes for name, culler in one.items()} for one in named]
    assert any(causes[0].values())
    assert causes[1] == causes[0]
    assert not any(causes[2].values())


@pytest.mark.parametrize("count", [2, 5])
def test_merged_shards_of_several_views_are_the_run(count, tmp_path):
    given = {"policy": POLICIES["late"], "pictures": 2}
    assert differing(*whole_and_merged(tmp_path, stereo, "views", count, **given)) == []


@pytest.mark.parametrize("kind", ["objects", "units"])
def test_merged_shards_that_went_by_a_truth_file_are_the_run(kind, tmp_path):
    truth = tmp_path / "truth.parquet"
    truth_to_file(switched(), truth)
    given = {"policy": POLICIES["late"], "truth": truth}
    assert differing(*whole_and_merged(tmp_path, switched, kind, 3, **given)) == []


def test_merged_shards_of_cullers_asked_again_are_the_run(tmp_path):
    @contextmanager
    def anew():
        # Its second answers come from another start.
        made = cullers("objects")
        made[2][1].draw = made[0][1].draw
        yield made

    given = {"repeat": 2, "anew": anew}
    whole, merged = whole_and_merged(tmp_path, switched, "objects", 3, **given)
    assert differing(whole, merged) == []
    findings = read_run(merged).verdict.findings
    assert "NOT_DETERMINISTIC" in {finding.code for finding in findings}


def test_a_culler_that_looks_back_depends_on_the_frames_before_its_part(tmp_path):
    """What the test above rests on: without them its part would tell otherwise."""
    judge_to_folder(switched(), cullers("objects"), tmp_path / "whole")
    from visref.judging import asking

    original = asking.Panel.warm_up
    asking.Panel.warm_up = lambda *given: None
    try:
        parts = [tmp_path / f"part-{number}" for number in (1, 2)]
        for number, part in enumerate(parts, 1):
            judge_to_folder(switched(), cullers("objects"), part, shard=Shard(number, 2))
    finally:
        asking.Panel.warm_up = original
    merge_runs(parts, tmp_path / "merged")
    assert "verdict.json" in differing(tmp_path / "whole", tmp_path / "merged")


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    """Three shards of a run, and by name of what is otherwise, folders that belong to another."""
    root = tmp_path_factory.mktemp("parts")

    def part(name, number=2, count=3, inputs=switched, kind="units", **given):
        folder = root / name
        judge_to_folder(inputs(), cullers(kind), folder, shard=Shard(number, count), **given)
        return folder

    for number in (1, 2, 3):
        part(f"part-{number}", number)
    part("frames", inputs=lambda: switched(6))
    part("path", inputs=lambda: stereo(9))
    part("cullers", kind="objects")
    part("policy", policy=Policy(min_samples=5))
    part("pictures", pictures=1)
    part("shards", 2, 4)
    judge_to_folder(switched(), cullers("units"), root / "a run of its own")
    return root


@pytest.mark.parametrize(
    ("names", "culprit", "problem"),
    [
        (("part-1", "part-3"), "part-1", "missing: 2/3"),
        (("part-1", "part-2", "part-3", "part-2"), "part-2", "so is"),
        (("part-1", "frames", "part-3"), "frames", "another path"),
        (("part-1", "path", "part-3"), "path", "another path"),
        (("part-1", "cullers", "part-3"), "cullers", "other cullers"),
        (("part-1", "policy", "part-3"), "policy", "another policy"),
        (("part-1", "pictures", "part-3"), "pictures", "pictures"),
        (("part-1", "shards", "part-3"), "shards", "number of shards"),
        (("part-1", "a run of its own"), "a run of its own", "not a part"),
        (("part-1", "nowhere"), "nowhere", "no run folder"),
    ],
)
def test_folders_that_do_not_belong_together_are_refused_by_name(
    names, culprit, problem, parts, tmp_path
):
    with pytest.raises(InputError, match=re.escape(problem)) as refused:
        merge_runs([parts / name for name in names], tmp_path / "merged")
    assert str(refused.value.source) == str(parts / culprit)
    assert not (tmp_path / "merged").exists()


def test_other_scenes_settings_engines_and_versions_are_refused(parts, tmp_path):
    for place, value, problem in (
        (("scene", "sha256"), "0" * 64, "another scene"),
        (("settings", "lenient"), True, "other settings"),
        (("engine",), "open3d", "another engine"),
        (("versions", "visref"), "9.9", "other versions"),
    ):
        other = tmp_path / "other"
        shutil.copytree(parts / "part-2", other)
        manifest = json.loads((other / "manifest.json").read_bytes())
        inner = manifest
        for name in place[:-1]:
            inner = inner[name]
        inner[place[-1]] = value
        (other / "manifest.json").write_text(json.dumps(manifest))
        with pytest.raises(InputError, match=problem) as refused:
            merge_runs([parts / "part-1", other, parts / "part-3"], tmp_path / "merged")
        assert str(refused.value.source) == str(other)
        shutil.rmtree(other)


def test_a_merged_folder_has_its_report(parts, tmp_path):
    merge_runs([parts / f"part-{number}" for number in (1, 2, 3)], tmp_path / "merged")
    write_report([tmp_path / "merged"], tmp_path / "page")
    assert (tmp_path / "page" / "junit.xml").is_file()
    assert read_run(tmp_path / "merged").manifest.settings.get("shard") is None


def test_a_part_says_which_it_is_and_has_a_report_of_its_own(parts, tmp_path):
    assert read_run(parts / "part-2").manifest.settings["shard"] == "2/3"
    write_report([parts / "part-2"], tmp_path / "page")


def test_a_shard_without_a_frame_is_refused(tmp_path):
    with pytest.raises(InputError, match="no frame"):
        judge_to_folder(stereo(2), cullers("views"), tmp_path / "part", shard=Shard(1, 3))


def test_merged_truths_are_the_truth_of_all_frames(tmp_path):
    from dataclasses import replace

    truth_to_file(switched(), tmp_path / "whole.parquet")
    files = []
    for frames in (range(5, 9), range(5)):
        files.append(tmp_path / f"{frames.start}.parquet")
        truth_to_file(replace(switched(), frames=frames), files[-1])
    assert merge_truths(files, tmp_path / "merged.parquet") == FRAMES
    merged = (tmp_path / "merged.parquet").read_bytes()
    assert merged == (tmp_path / "whole.parquet").read_bytes()
    with pytest.raises(InputError, match="overlap"):
        merge_truths([*files, files[0]], tmp_path / "again.parquet")
    truth_to_file(stereo(), tmp_path / "other.parquet")
    with pytest.raises(InputError, match="another path"):
        merge_truths([files[0], tmp_path / "other.parquet"], tmp_path / "again.parquet")


def _spoilt(value):
    """Wrong values of one JSON field, by what is wrong with it."""
    yield "gone", None
    for wrong in (None, [], -1, [{"x": None}]):
        if wrong != value:
            yield repr(wrong), wrong


def test_a_spoilt_part_is_refused_in_one_line_or_merged(parts, tmp_path):
    """Whatever stands in `part.json`: an error that names the folder, never another exception."""
    others = [parts / "part-1", parts / "part-3"]
    spoilt = tmp_path / "spoilt"
    shutil.copytree(parts / "part-2", spoilt)
    said = json.loads((spoilt / "part.json").read_bytes())
    merged = set()
    for name, value in [*said.items(), *(("cullers", one) for one in said["cullers"])]:
        for how, wrong in _spoilt(value):
            other = {key: one for key, one in said.items() if key != name}
            (spoilt / "part.json").write_text(
                json.dumps(other if how == "gone" else {**other, name: wrong})
            )
            with suppress(InputError):
                merge_runs([*others, spoilt], tmp_path / "merged")
                merged.add(name)
    # What may as well be true: nothing was found, nothing moved, another frame is a cut.
    assert merged <= {"caster", "cuts", "examined", "failures", "moved", "paths", "rounded"}


@pytest.mark.parametrize(
    "file", ["part.parquet", "objects.parquet", "truth.parquet", "frames.parquet"]
)
def test_a_part_that_lacks_rows_is_refused(file, parts, tmp_path):
    spoilt = tmp_path / "spoilt"
    shutil.copytree(parts / "part-2", spoilt)
    table = pq.read_table(spoilt / file)
    pq.write_table(table.slice(0, len(table) - 1), spoilt / file)
    with pytest.raises(InputError) as refused:
        merge_runs([parts / "part-1", spoilt, parts / "part-3"], tmp_path / "merged")
    assert str(spoilt) in str(refused.value)


def test_a_part_without_a_witness_or_a_picture_is_refused(parts, tmp_path):
    for name in ("witnesses/Halves.jsonl", "manifest.json"):
        spoilt = tmp_path / "spoilt"
        shutil.copytree(parts / "part-2", spoilt)
        if name == "manifest.json":
            manifest = json.loads((spoilt / name).read_bytes())
            (spoilt / name).write_text(json.dumps({**manifest, "pictures": []}))
        else:
            (spoilt / name).write_text("")
        with pytest.raises(InputError):
            merge_runs([parts / "part-1", spoilt, parts / "part-3"], tmp_path / "merged")
        shutil.rmtree(spoilt)


class Drawn:
    """A run's listener that keeps what was drawn, and by which units what was missed."""

    def __init__(self):
        self.found = []

    def on_truth(self, *given):
        pass

    def on_frame_done(self, frame):
        pass

    def on_verdict(self, job, judged):
        record = judged.record
        lost = None if judged.followed is None else _listed(judged.followed.lost)
        drawn = np.unique(judged.drawn_units).tolist()
        self.found.append((job.spec, record.frame, record.view, drawn, lost))


def _listed(lost):
    return {index: units.tolist() for index, units in sorted(lost.items())}


@pytest.mark.parametrize(("kind", "inputs"), [("units", switched), ("views", stereo)])
def test_the_parts_tell_what_was_drawn_and_by_which_units_objects_were_missed(
    kind, inputs, tmp_path
):
    whole = Drawn()
    judge_to_folder(inputs(), cullers(kind), tmp_path / "whole", listeners=[whole])
    parts = [tmp_path / f"part-{number}" for number in (1, 2)]
    for number, part in enumerate(parts, 1):
        judge_to_folder(inputs(), cullers(kind), part, shard=Shard(number, 2))
    (tmp_path / "merged").mkdir()
    found = []

    def on_cell(cell):
        lost = None if cell.followed is None else _listed(cell.followed.lost)
        record = cell.record
        found.append((cell.spec, record.frame, record.view, cell.drawn.tolist(), lost))
        if cell.spec == "Halves":
            units = cell.part.units["Halves"]
            assert units.triangles.tolist() == list(range(12))

    merge_into(tmp_path / "merged", parts, on_cell=on_cell)
    assert found == whole.found
    assert any(lost for *_, lost in found)
