"""Truth files: what is written is read back, and what visref did not write is refused."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from tests.support import report_runs
from tests.support.hand_made import camera, scene_of_squares, truth
from visref.camera_path import CameraPath, Frame
from visref.errors import InputError
from visref.recordings import truth_file
from visref.recordings.truth_file import TruthTable
from visref.recordings.truth_reading import read_rows, read_truth, write_joined
from visref.visibility import objects_seen

SCENE = scene_of_squares(0.0, -1.0, -2.0)
PATH = CameraPath((camera(), camera(), camera()))


@pytest.fixture
def file(tmp_path):
    table = TruthTable(SCENE)
    for frame, owners in ((2, [[0, 4]]), (0, [[2, 2]]), (1, [[-1, -1]])):
        table.add(frame, 2, objects_seen(truth(owners), SCENE))
    table.write(tmp_path / "t.parquet", engine="hand", path=PATH, ties_complete=True, exact=True)
    return tmp_path / "t.parquet"


def test_frames_come_back_whatever_their_order(file):
    read = read_truth(file, SCENE, PATH, range(3))
    assert (read.engine, read.exact) == ("hand", True)
    assert {frame: rows.objects.tolist() for frame, rows in read.frames.items()} == {
        0: [1],
        1: [],
        2: [0, 2],
    }
    assert read.frames[0].samples.tolist() == [2]
    assert {frame: rows.owned for frame, rows in read.frames.items()} == {0: 2, 1: 0, 2: 2}


@pytest.mark.parametrize("exact", [True, False, None])
def test_whether_the_engine_is_exact_comes_back(tmp_path, exact):
    TruthTable(SCENE).write(
        tmp_path / "t.parquet", engine="hand", path=PATH, ties_complete=False, exact=exact
    )
    assert read_truth(tmp_path / "t.parquet", SCENE, PATH, ()).exact is exact


def with_views(*views):
    """A path of two frames, each of which has these views of two samples by one."""
    return CameraPath([Frame(tuple(replace(camera(2, 1), view=view) for view in views))] * 2)


def test_views_of_a_frame_come_back_apart(tmp_path):
    path = with_views("left", "right", "rear")
    table = TruthTable(SCENE)
    for view, owners in (("left", [[0, 0]]), ("right", [[2, -1]]), ("rear", [[-1, -1]])):
        table.add(1, 2, objects_seen(truth(owners), SCENE), view=view)
    table.write(tmp_path / "t.parquet", engine="hand", path=path, ties_complete=True, exact=True)
    read = read_truth(tmp_path / "t.parquet", SCENE, path, [1])
    assert {cell: rows.objects.tolist() for cell, rows in read.views.items()} == {
        (1, "left"): [0],
        (1, "right"): [1],
        (1, "rear"): [],
    }
    assert read.views[1, "rear"].owned == 0
    assert pq.read_table(tmp_path / "t.parquet")["view"].to_pylist() == ["left", "right"]


def test_a_path_with_other_views_is_another_path(tmp_path):
    TruthTable(SCENE).write(
        tmp_path / "t.parquet", engine="hand", path=with_views("a", "b"), ties_complete=True
    )
    with pytest.raises(InputError, match="it was cast for another path"):
        read_truth(tmp_path / "t.parquet", SCENE, with_views("a", "c"), ())


# A version 1 file, as visref wrote them: of the run whose folder is kept beside.
VERSION_1 = Path(__file__).parents[1] / "run_folder" / "version_1" / "truth.parquet"


def test_a_file_of_version_1_is_read_and_its_reader_told_what_it_does_not_say():
    read = read_truth(VERSION_1, report_runs.scene(), report_runs.path(4), range(4))
    assert (read.engine, read.exact) == ("exact:tile=64", None)
    assert [finding.code for finding in read.findings] == ["TRUTH_UNSEALED"]
    assert set(read.views) == {(frame, "") for frame in range(4)}
    for frame, rows in read.frames.items():
        seen = objects_seen(
            report_runs.Painter(report_runs.scene()).frame(report_runs.path(4).cameras[frame]),
            report_runs.scene(),
        )
        assert rows.objects.tolist() == np.flatnonzero(seen.visible).tolist()
        assert rows.samples.tolist() == seen.samples[seen.visible].tolist()
        assert rows.owned == seen.owned


def test_a_file_from_before_owned_samples_were_counted_is_still_read(tmp_path):
    older = _facts(lambda facts: facts.pop("owned"))(pq.read_table(VERSION_1))
    pq.write_table(older, tmp_path / "t.parquet")
    read = read_truth(tmp_path / "t.parquet", report_runs.scene(), report_runs.path(4), range(4))
    assert {rows.owned for rows in read.frames.values()} == {None}


def _facts(change):
    def spoil(table):
        facts = json.loads(table.schema.metadata[b"visref"])
        change(facts)
        return table.replace_schema_metadata({b"visref": json.dumps(facts).encode()})

    return spoil


def _metadata(text):
    return lambda table: table.replace_schema_metadata({b"visref": text})


def _column(name, values):
    return lambda table: table.set_column(table.schema.get_field_index(name), name, values)


SPOILT = {
    "no metadata": (lambda table: table.replace_schema_metadata(None), "not a truth file"),
    "metadata cut short": (_metadata(b'{"format": "visref-tr'), "not a truth file"),
    "metadata a list": (_metadata(b"[1]"), "not a truth file"),
    "metadata of lists too deep": (_metadata(b"[" * 100_000), "not a truth file"),
    "a column twice": (lambda t: t.append_column("frame", t["frame"]), "its columns"),
    "another version": (_facts(lambda facts: facts.update(version=3)), "its version is 3"),
    "no digest": (_facts(lambda facts: facts.pop("digest")), "its digest"),
    "no word of exactness": (_facts(lambda facts: facts.pop("exact")), "its exact"),
    "no engine": (_facts(lambda facts: facts.pop("engine")), "its engine"),
    "frames a number": (_facts(lambda facts: facts.update(frames=3)), "its frames"),
    "no pixels": (lambda table: table.drop_columns(["pixels"]), "its columns"),
    "objects as text": (_column("object", pa.array(["0", "1", "2"])), "its columns"),
    "an empty cell": (_column("frame", pa.array([0, 1, None], pa.int32())), "its columns"),
}


@pytest.mark.parametrize("name", SPOILT)
def test_spoilt_truth_file_is_one_clear_line_naming_the_file(name, file):
    spoil, expected = SPOILT[name]
    pq.write_table(spoil(pq.read_table(file)), file)
    with pytest.raises(InputError) as caught:
        read_truth(file, SCENE, PATH, range(3))
    message = str(caught.value)
    assert message.startswith(str(file))
    assert expected in message
    assert "\n" not in message


def _sealed(file, change):
    """Spoil a file and seal it again, as a writer with a fault would."""
    table = change(pq.read_table(file))
    facts = json.loads(table.schema.metadata[b"visref"])
    facts["digest"] = truth_file.digest_of([table], facts)
    pq.write_table(table.replace_schema_metadata({b"visref": json.dumps(facts).encode()}), file)


SEALED = {
    "unknown object": (
        _column("object", pa.array(np.array([0, 1, 3], np.int32))),
        "an object that the scene lacks",
    ),
    "a frame missing": (_facts(lambda facts: facts.update(frames=[0, 1])), "lacks frames"),
    "another scene": (_facts(lambda facts: facts.update(scene="0")), "another scene"),
    "a frame twice": (_facts(lambda facts: facts.update(frames=[2, 0, 1, 1])), "go together"),
    "frames that are lists": (_facts(lambda facts: facts.update(frames=[[2], 0, 1])), "its frames"),
    "a frame beyond the path": (
        _facts(lambda facts: facts.update(frames=[2, 0, 1, 9])),
        "together",
    ),
    "a view that is a number": (
        _facts(lambda facts: facts.update(views=[1, "", ""])),
        "its frames",
    ),
    "a view of no camera": (_facts(lambda facts: facts.update(views=["", "x", ""])), "together"),
    "more owned than samples": (_facts(lambda facts: facts.update(owned=[2, 2, 99])), "together"),
    "owned as text": (_facts(lambda facts: facts.update(owned=["2", 2, 0])), "together"),
    "owned too few": (_facts(lambda facts: facts.update(owned=[2, 2])), "together"),
    "a row of a frame that is not listed": (
        _column("frame", pa.array(np.array([7, 7, 7], np.int32))),
        "does not list",
    ),
    "an object twice": (
        _column("object", pa.array(np.array([0, 0, 1], np.int32))),
        "stands twice",
    ),
    "a sample outside the image": (
        _column("x", pa.array(np.array([0, 0, 99], np.int32))),
        "does not have",
    ),
    "a depth that is no number": (_column("depth", pa.array([1.0, np.nan, 1.0])), "does not have"),
    "no sample at all": (_column("pixels", pa.array([0, 1, 1], pa.int64())), "does not have"),
    "another status": (_column("status", pa.array(["visible", "tie", "x"])), "its status"),
    "more rows than objects": (lambda table: pa.concat_tables([table] * 4), "more than objects"),
}


@pytest.mark.parametrize("name", SEALED)
def test_a_sealed_file_of_something_else_is_refused(name, file):
    spoil, expected = SEALED[name]
    _sealed(file, spoil)
    with pytest.raises(InputError, match=expected):
        read_truth(file, SCENE, PATH, range(3))


EDITS = {
    "one sample more": _column("pixels", pa.array([2, 1, 2], pa.int64())),
    "another owner": _column("object", pa.array(np.array([0, 1, 1], np.int32))),
    "a name": _column("name", pa.array(["a", "b", "c"])),
    "letters moved between names": _column("name", pa.array(["0-", "21", "-0"])),
    "a view": _column("view", pa.array(["", "", "left"])),
    "a tie made whole": _column("status", pa.array(["tie", "visible", "visible"])),
    "another pixel": _column("x", pa.array(np.array([0, 0, 0], np.int32))),
    "a row left out": lambda table: table.slice(1),
    "rows in another order": lambda table: table.take(pa.array([2, 1, 0])),
    "exact, it says": _facts(lambda facts: facts.update(exact=False)),
    "another engine": _facts(lambda facts: facts.update(engine="exact")),
    "more owned": _facts(lambda facts: facts.update(owned=[9, 9, 9])),
}


@pytest.mark.parametrize("name", EDITS)
def test_an_edited_truth_file_is_refused(name, file):
    table = pq.read_table(file)
    edited = EDITS[name](table)
    assert not edited.equals(table, check_metadata=True)
    pq.write_table(edited, file)
    with pytest.raises(InputError, match="changed after it was written"):
        read_truth(file, SCENE, PATH, range(3))


def test_the_digest_is_of_the_values_and_not_of_how_they_are_laid_out(file):
    pq.write_table(pq.read_table(file), file, compression="none", row_group_size=1)
    assert set(read_truth(file, SCENE, PATH, range(3)).frames) == {0, 1, 2}


@pytest.mark.parametrize("keep", [0, 4, 300])
def test_truncated_truth_file_is_a_clear_error(keep, file):
    file.write_bytes(file.read_bytes()[:keep])
    with pytest.raises(InputError, match="cannot read it as a truth file"):
        read_truth(file, SCENE, PATH, range(3))


def test_missing_truth_file_or_folder_is_said_to_be_missing(tmp_path):
    for place in (tmp_path / "none.parquet", tmp_path):
        with pytest.raises(InputError, match="no such truth file"):
            read_truth(place, SCENE, PATH, range(3))


@pytest.mark.parametrize("rows", [1, 2])
def test_row_groups_are_read_one_after_another_as_one_table(rows, file):
    whole = read_truth(file, SCENE, PATH, range(3))
    pq.write_table(pq.read_table(file), file, row_group_size=rows)
    read = read_truth(file, SCENE, PATH, range(3))
    assert list(read.views) == list(whole.views)
    assert list(read_rows(file, 3).recorded.views) == list(whole.views)
    for again in (read, read_rows(file, 3).recorded):
        for cell, known in whole.views.items():
            mine = again.views[cell]
            assert mine.objects.tolist() == known.objects.tolist()
            assert mine.samples.tolist() == known.samples.tolist()
            assert mine.owned == known.owned


@pytest.mark.parametrize("rows", [1, 3])
def test_an_object_twice_is_refused_wherever_row_groups_part(rows, file):
    table = pq.read_table(file)
    first = table.slice(0, 1)
    # Its second row is as far from it as can be.
    _sealed(file, lambda _: pa.concat_tables([first, table.slice(2), first]))
    pq.write_table(pq.read_table(file), file, row_group_size=rows)
    with pytest.raises(InputError, match="stands twice"):
        read_truth(file, SCENE, PATH, range(3))
    with pytest.raises(InputError, match="stands twice"):
        assert read_rows(file, 3).recorded


def test_parts_in_row_groups_are_joined_as_one_table(file, tmp_path):
    whole = file.read_bytes()
    parts = []
    for name, frames in (("early", [0]), ("late", [1, 2])):
        part = tmp_path / f"{name}.parquet"
        shutil.copyfile(file, part)

        def of_part(table, frames=frames):
            facts = json.loads(table.schema.metadata[b"visref"])
            kept = [at for at, frame in enumerate(facts["frames"]) if frame in frames]
            kept.sort(key=lambda at: facts["frames"][at])
            facts.update({n: [facts[n][at] for at in kept] for n in ("frames", "views", "owned")})
            table = table.filter(pc.is_in(table["frame"], pa.array(frames, pa.int32())))
            return table.replace_schema_metadata({b"visref": json.dumps(facts).encode()})

        _sealed(part, of_part)
        pq.write_table(pq.read_table(part), part, row_group_size=1)
        parts.append(read_rows(part))
    write_joined(tmp_path / "joined.parquet", parts)
    table = pq.read_table(tmp_path / "joined.parquet")
    assert table.equals(pq.read_table(pa.BufferReader(whole)).sort_by("frame"))
    assert read_truth(tmp_path / "joined.parquet", SCENE, PATH, range(3)).engine == "hand"
