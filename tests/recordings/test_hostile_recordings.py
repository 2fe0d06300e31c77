"""Recordings that were made to harm: refused in one line, before they take memory or time."""

from __future__ import annotations

import os

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.support.hand_made import scene_of_squares, still_path
from visref.errors import InputError
from visref.recordings.visible_sets import read_visible_sets

LIMIT = 16 << 20
SCENE = scene_of_squares(-1.0, -2.0)


def refused(file, match):
    with pytest.raises(InputError, match=match) as caught:
        read_visible_sets(file, SCENE, range(1), still_path(1), max_memory=LIMIT)
    line = str(caught.value)
    assert line.startswith(str(file))
    assert "\n" not in line
    assert len(line) < 1500


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("v.jsonl", '{"frame": 0, "visible": [' + "0," * 4_000_000, "the line would"),
        ("v.jsonl", " " * (5 << 20), "the line would"),
        ("v.jsonl", "[" * 100_000, "too deep"),
        ("v.jsonl", '{"frame": 0, "visible": [' + "9" * 4000 + "]}", r"object id 9+\.\.\.9+ is"),
        ("v.jsonl", '{"frame": NaN, "visible": []}', "frame is nan"),
        ("v.jsonl", '{"frame": ' + "9" * 4000 + ', "visible": []}', r"frame 9+\.\.\.9+ is not on"),
        ("v.jsonl", '{"frame": 0, "visible": ["' + "x" * 100_000 + '"]}', "no object named"),
        ("v.csv", "frame,object_id\n" + "0,0\n" * 100_000, "its rows would need"),
        ("v.csv", "frame,object_id\n0,1_0\n", "object_id is '1_0'"),
        ("v.csv", "frame,object_id\n0,٢\n", "object_id is '٢'"),
        ("v.csv", "frame," + "x" * 100_000 + "\n", "columns are frame, x{40};"),
    ],
)
def test_text_without_end_or_sense_is_refused(tmp_path, name, text, match):
    (tmp_path / name).write_text(text)
    refused(tmp_path / name, match)


def test_small_parquet_of_many_rows_is_refused_by_its_count(tmp_path):
    rows = 5_000_000
    table = pa.table({"frame": np.zeros(rows, "i4"), "object_id": np.zeros(rows, "i4")})
    pq.write_table(table, tmp_path / "v.parquet", compression="zstd")
    assert (tmp_path / "v.parquet").stat().st_size < 100_000
    refused(tmp_path / "v.parquet", "its 5,000,000 rows would need")


@pytest.mark.parametrize(
    ("columns", "match"),
    [
        ({"frame": [0.5], "object": ["a"]}, "frame is of type double"),
        ({"frame": [0], "object": [[1]]}, "object is of type list"),
        ({"frame": [0], "object_id": [{"a": 1}]}, "object_id is of type struct"),
        ({"frame": [None], "object_id": [1]}, "frame is of type null"),
        ({"frame": pa.array([2**63], "u8"), "object_id": [0]}, "frame 9223372036854775808"),
    ],
)
def test_parquet_of_other_types_is_refused(tmp_path, columns, match):
    pq.write_table(pa.table(columns), tmp_path / "v.parquet")
    refused(tmp_path / "v.parquet", match)


def test_parquet_with_dictionaries_says_the_same(tmp_path):
    names = pa.array([SCENE.names[1], None, SCENE.names[1]]).dictionary_encode()
    pq.write_table(pa.table({"frame": [0, 0, 0], "object": names}), tmp_path / "v.parquet")
    recorded = read_visible_sets(tmp_path / "v.parquet", SCENE, range(1), still_path(1))
    assert recorded.frames[0].tolist() == [1]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")
@pytest.mark.parametrize("ending", ["jsonl", "csv", "parquet"])
def test_pipe_is_not_waited_for(tmp_path, ending):
    os.mkfifo(tmp_path / f"v.{ending}")
    refused(tmp_path / f"v.{ending}", "this is a pipe")
