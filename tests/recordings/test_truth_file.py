"""Truth files: what is written is read back, and what visref did not write is refused."""

from __future__ import annotations

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.support.hand_made import camera, scene_of_squares, truth
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.recordings.truth_file import TruthTable, read_truth
from visref.visibility import objects_seen

SCENE = scene_of_squares(0.0, -1.0, -2.0)
PATH = CameraPath((camera(), camera(), camera()))


@pytest.fixture
def file(tmp_path):
    table = TruthTable(SCENE)
    for frame, owners in ((2, [[0, 4]]), (0, [[2, 2]]), (1, [[-1, -1]])):
        table.add(frame, 2, objects_seen(truth(owners), SCENE))
    table.write(tmp_path / "t.parquet", engine="hand", path=PATH, ties_complete=True)
    return tmp_path / "t.parquet"


def test_frames_come_back_whatever_their_order(file):
    read = read_truth(file, SCENE, PATH, range(3))
    assert (read.engine, read.exact) == ("hand", True)
    assert {frame: rows.objects.tolist() for frame, rows in read.frames.items()} == {
        0: [1],
        1: [],
        2: [0, 2],
    }
    assert read.frames[0].pixels.tolist() == [2]
    assert {frame: rows.owned for frame, rows in read.frames.items()} == {0: 2, 1: 0, 2: 2}


def test_a_file_from_before_owned_samples_were_counted_is_still_read(file):
    older = _facts(lambda facts: facts.pop("owned"))(pq.read_table(file))
    pq.write_table(older, file)
    read = read_truth(file, SCENE, PATH, range(3))
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
    "another version": (_facts(lambda facts: facts.update(version=2)), "its version is 2"),
    "no engine": (_facts(lambda facts: facts.pop("engine")), "its engine"),
    "frames a number": (_facts(lambda facts: facts.update(frames=3)), "its frames"),
    "no pixels": (lambda table: table.drop_columns(["pixels"]), "its columns"),
    "objects as text": (_column("object", pa.array(["0", "1", "2"])), "its columns"),
    "an empty cell": (_column("frame", pa.array([0, 1, None], pa.int32())), "its columns"),
    "unknown object": (
        _column("object", pa.array(np.array([0, 1, 3], np.int32))),
        "an object that the scene lacks",
    ),
    "a frame missing": (_facts(lambda facts: facts.update(frames=[0, 1])), "lacks frames"),
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


@pytest.mark.parametrize("keep", [0, 4, 300])
def test_truncated_truth_file_is_a_clear_error(keep, file):
    file.write_bytes(file.read_bytes()[:keep])
    with pytest.raises(InputError, match="cannot read it as a truth file"):
        read_truth(file, SCENE, PATH, range(3))


def test_missing_truth_file_or_folder_is_said_to_be_missing(tmp_path):
    for place in (tmp_path / "none.parquet", tmp_path):
        with pytest.raises(InputError, match="no such truth file"):
            read_truth(place, SCENE, PATH, range(3))
