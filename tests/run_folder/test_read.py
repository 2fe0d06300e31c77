"""A run folder comes back as it was written, of both versions; what is spoilt is one clear line."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections import Counter
from dataclasses import fields
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.support import report_runs
from tests.support.report_runs import BROKEN, HIDDEN, NASTY, NASTY_ID
from visref.culler import QueryStats
from visref.errors import InputError
from visref.judging.judge import Counts, MissKind
from visref.report.writing import write_report
from visref.run_folder.explain import explain
from visref.run_folder.layout import (
    COUNTERS,
    COUNTS,
    FRAMES_SCHEMA,
    MISS_KINDS,
    OBJECTS_SCHEMA,
    SINCE_VERSION_2,
    TIMINGS_SCHEMA,
)
from visref.run_folder.read import read_run
from visref.run_folder.rows import FrameRow, HiddenUnit, Sums, TimingRow, Witness

VERSION_1 = Path(__file__).parent / "version_1"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return report_runs.write_runs(tmp_path_factory.mktemp("runs"))["violation"]


@pytest.fixture
def folder(written, tmp_path):
    """A copy to spoil."""
    return shutil.copytree(written, tmp_path / "run")


def test_reading_loads_no_engine_no_compiler_and_no_pictures():
    code = "import sys, visref.run_folder.read; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    ).stdout.split()
    assert "visref.run_folder.read" in loaded
    heavy = ("numba", "PIL", "embreex", "open3d", "moderngl", "trimesh", "matplotlib", "jinja2",
             "visref.engines", "visref.exact", "visref.kernels", "visref.formats")  # fmt: skip
    assert [name for name in heavy if name in loaded] == []


def test_columns_are_those_of_the_referees_counts_and_the_cullers_counters():
    assert set(vars(Counts())) == set(COUNTS)
    assert {field.name for field in fields(QueryStats)} - {"ms"} == set(COUNTERS)
    assert {kind.value for kind in MissKind} == {kind.value for kind in MISS_KINDS}
    assert set(SINCE_VERSION_2) <= {*COUNTS, *OBJECTS_SCHEMA.names}


def test_a_row_has_the_columns_of_its_table():
    def names(row):
        return {field.name for field in fields(row)}

    assert names(Sums) == set(COUNTS)
    assert names(FrameRow) == set(FRAMES_SCHEMA.names)
    assert names(TimingRow) == set(TIMINGS_SCHEMA.names)
    of_hidden = {"samples", "occluder", "occluder_name"}
    assert names(Witness) == set(OBJECTS_SCHEMA.names) - {"culler", "unit", "cause"} - of_hidden
    assert names(HiddenUnit) - {"frames"} <= set(OBJECTS_SCHEMA.names)
    assert of_hidden < names(HiddenUnit)


def test_rows_are_the_tables(written):
    run = read_run(written)
    for name, rows, schema in (
        ("frames", run.frames, FRAMES_SCHEMA),
        ("timings", run.timings, TIMINGS_SCHEMA),
    ):
        table = pq.read_table(written / f"{name}.parquet")
        assert table.schema.equals(schema)
        assert [
            {field: getattr(row, field) for field in schema.names} for row in rows
        ] == table.to_pylist()
    assert pq.read_schema(written / "objects.parquet").equals(OBJECTS_SCHEMA)
    verdict = json.loads((written / "verdict.json").read_text())
    for culler, said in verdict["cullers"].items():
        assert {name: getattr(run.verdict.cullers[culler], name) for name in COUNTS} == {
            name: said[name] for name in COUNTS
        }
    assert run.verdict.cullers[BROKEN].worst == run.lost_objects(BROKEN)[0].worst
    assert run.manifest.exact is False


def test_manifest_says_that_an_exact_engine_is_exact(tmp_path):
    culler = report_runs.Scripted(report_runs.VISIBLE)
    folder = report_runs.write_run(
        tmp_path / "run", [("c", culler)], truth=report_runs.ExactPainter
    )
    assert read_run(folder).manifest.exact is True


def test_objects_of_many_row_groups_are_counted_and_told(written, folder):
    """As of a run with so many rows that they are written in several batches, each of which has
    dictionaries of its own."""
    table = pq.read_table(folder / "objects.parquet")
    pq.write_table(table, folder / "objects.parquet", row_group_size=3)
    assert pq.ParquetFile(folder / "objects.parquet").num_row_groups > 5
    one, many = read_run(written), read_run(folder)
    for culler in one.cullers:
        assert many.superfluous_units(culler) == one.superfluous_units(culler)
        assert many.superfluous_causes(culler) == one.superfluous_causes(culler)
        assert many.lost_objects(culler) == one.lost_objects(culler)
    rows = Counter(
        (row["culler"], row["unit"]) for row in table.to_pylist() if row["kind"] == "superfluous"
    )
    assert {
        (culler, unit): frames
        for culler in many.cullers
        for unit, _, frames in many.superfluous_units(culler)
    } == dict(rows)
    write_report([folder], folder.parent / "page")


def test_a_folder_of_version_1_is_read_shown_and_explained(tmp_path):
    run = read_run(VERSION_1)
    assert (run.manifest.version, run.verdict.version, run.manifest.exact) == (1, 1, None)
    assert run.cullers == ("none", BROKEN, "triangles")
    assert {row.view for row in run.frames} | {row.view for row in run.timings} == {""}
    assert run.sizes == {(report_runs.WIDTH, report_runs.HEIGHT)}
    broken = run.verdict.cullers[BROKEN]
    assert (run.verdict.status, broken.violations, broken.missed_pixels) == ("violation", 2, 8)
    (lost,) = run.lost_objects(BROKEN)
    assert (lost.worst.object, lost.worst.name, lost.samples, lost.frames) == (
        NASTY_ID,
        NASTY,
        8,
        2,
    )
    assert broken.worst == lost.worst
    assert (lost.misses, lost.partly, lost.worst.partly) == (2, 0, False)
    assert (broken.small, broken.late, broken.waived) == (0, 0, 0)
    unknown = (broken.partly_missed, broken.owned_samples, broken.superfluous_confirmed)
    assert unknown == (None, None, None)
    assert {row.undecided_samples for row in run.frames} == {None}
    assert run.manifest.cullers[BROKEN].raster is None
    assert run.hidden_units(BROKEN) == []
    assert [unit for unit, _, _ in run.superfluous_units(BROKEN)] == [HIDDEN]
    assert run.superfluous_causes("none") == {"box_hidden": 2, "outside_view": 1}
    page = write_report([VERSION_1], tmp_path).read_text()
    assert "whether that is exact is not recorded" in page
    # It did not look for what is lost in part, so nobody may say that all was drawn.
    assert "was missed in full" in page
    assert "was drawn wherever it is seen" not in page
    (explanation,) = explain(VERSION_1, 1, str(NASTY_ID))
    assert explanation.holds


def _table(name, change):
    def spoil(folder):
        file = folder / f"{name}.parquet"
        pq.write_table(change(pq.read_table(file)), file)

    return spoil


def _with(column, values):
    def change(table):
        index = table.schema.get_field_index(column)
        kind = table.schema.field(column).type
        return table.set_column(index, column, pa.array(values(table[column].to_pylist()), kind))

    return change


def _cast(column, kind):
    def change(table):
        index = table.schema.get_field_index(column)
        return table.set_column(index, column, table[column].cast(kind))

    return change


def _version(number):
    def spoil(folder):
        file = folder / "verdict.json"
        file.write_text(json.dumps(json.loads(file.read_text()) | {"version": number}))

    return spoil


SPOILT = {
    "no view": (_table("frames", lambda t: t.drop_columns(["view"])), "no column 'view'"),
    "no count": (_table("frames", lambda t: t.drop_columns(["missed"])), "no column 'missed'"),
    "no kind": (_table("objects", lambda t: t.drop_columns(["kind"])), "no column 'kind'"),
    "numbers as text": (_table("frames", _cast("drawn", pa.string())), "'drawn' holds string"),
    "text as numbers": (
        _table("objects", lambda t: t.set_column(0, "culler", pa.array([1] * len(t)))),
        "'culler' holds int64",
    ),
    "an empty cell": (
        _table("timings", _with("ms", lambda v: [None, *v[1:]])),
        "'ms' has an empty",
    ),
    "another culler": (
        _table("frames", _with("culler", lambda v: ["who", *v[1:]])),
        "it judges 'who'",
    ),
    "another frame": (_table("frames", _with("frame", lambda v: [99, *v[1:]])), "frame 99"),
    "another view": (_table("frames", _with("view", lambda v: ["left", *v[1:]])), "view 'left'"),
    "no table": (lambda folder: (folder / "timings.parquet").write_bytes(b"PAR1"), "cannot read"),
    "the verdict of version 1": (_version(1), "its version is not the manifest's"),
}


@pytest.mark.parametrize("name", SPOILT)
def test_a_spoilt_run_folder_is_one_clear_line_naming_the_file(name, folder):
    spoil, expected = SPOILT[name]
    spoil(folder)
    with pytest.raises(InputError) as caught:
        read_run(folder)
    assert expected in str(caught.value)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_miss_without_its_sample_is_a_spoilt_row(folder):
    _table("objects", _with("x", lambda values: [None] * len(values)))(folder)
    with pytest.raises(InputError, match="empty cell"):
        read_run(folder).lost_objects(BROKEN)


def test_columns_that_nobody_knows_are_ignored(written, folder):
    _table("frames", lambda t: t.append_column("someday", pa.array(range(len(t)))))(folder)
    assert read_run(folder).frames == read_run(written).frames
