"""`tools/records compare` sees a changed record, and takes a new field for none."""

import json
import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

pytestmark = pytest.mark.slow

TOOL = Path(__file__).resolve().parent.parent / "tools" / "records"
BROKEN = "culling.broken:HastyQueryCulling"
FRAMES = {"culler": ["none", "none", BROKEN], "frame": [0, 1, 0], "visible": [3, 4, 3]}
FACTS = {"format": "visref-truth", "version": 1, "frames": [0, 1]}
TRUTH = {"frame": [0, 1], "name": ["wall", "door"], "depth": [1.5, float("nan")]}
WITNESS = {"culler": BROKEN, "frame": 0, "triangles": [{"object": 2, "drawn": True}]}


def write_json(file, value):
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(value))


def write_table(file, columns, facts=None):
    table = pa.table(columns)
    if facts is not None:
        table = table.replace_schema_metadata({"visref": json.dumps(facts)})
    pq.write_table(table, file)


def records(root, broken=BROKEN, slug="culling.broken_HastyQueryCulling-5df85ba8"):
    """A folder as `make` writes it: one run and one command. Returns the run's folder."""
    run = root / "runs" / "town"
    sums = {"visible": 7, "missed": 0, "worst": None}
    findings = [{"code": "MISSED_OBJECT", "frame": 0}]
    write_json(run / "verdict.json", {"cullers": {broken: sums}, "findings": findings})
    settings = {"version": 1, "versions": {"numpy": "2.0"}, "machine": {"cores": 2}}
    write_json(run / "manifest.json", {**settings, "cullers": {broken: {"slug": slug}}})
    names = [name.replace(BROKEN, broken) for name in FRAMES["culler"]]
    write_table(run / "frames.parquet", {**FRAMES, "culler": names})
    write_table(run / "truth.parquet", TRUTH, FACTS)
    write_table(run / "timings.parquet", {"ms": [1.0]})
    write_json(run / "witnesses" / f"{slug}.jsonl", {**WITNESS, "culler": broken})
    said = {"command": ["visref", "run", f"--culler={broken}"], "status": 1}
    said |= {"stdout": ["culler  frames", f"{broken}  2", "in 1.5 s"], "stderr": [""]}
    write_json(root / "commands" / "run-town.json", said)
    return run


def compare(*arguments):
    """The exit status of `tools/records compare`, and what it printed."""
    command = [sys.executable, str(TOOL), "compare", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert not done.stderr
    return done.returncode, done.stdout


@pytest.fixture
def folders(tmp_path):
    """The folders of the old and the new records, and the new run's."""
    records(tmp_path / "old")
    return tmp_path / "old", tmp_path / "new", records(tmp_path / "new")


def changed(file, edit):
    """Edit a JSON file in place."""
    value = json.loads(file.read_text())
    edit(value)
    file.write_text(json.dumps(value))


def one_frame_count(run):
    write_table(run / "frames.parquet", {**FRAMES, "visible": [3, 5, 3]})


def two_rows_swapped(run):
    columns = {name: [rows[1], rows[0], rows[2]] for name, rows in FRAMES.items()}
    write_table(run / "frames.parquet", columns)


def one_row_less(run):
    write_table(run / "frames.parquet", {name: rows[:2] for name, rows in FRAMES.items()})


def one_column_less(run):
    write_table(run / "frames.parquet", {name: FRAMES[name] for name in ("culler", "frame")})


def one_depth(run):
    write_table(run / "truth.parquet", {**TRUTH, "depth": [1.5, 2.0]}, FACTS)


def the_truths_facts(run):
    write_table(run / "truth.parquet", TRUTH, {**FACTS, "frames": [0, 2]})


def one_sum(run):
    changed(run / "verdict.json", lambda v: v["cullers"][BROKEN].update(missed=1))


def one_finding(run):
    changed(run / "verdict.json", lambda v: v["findings"][0].update(code="OBJECT_MISSED"))


def one_key_less(run):
    changed(run / "verdict.json", lambda v: v["cullers"][BROKEN].pop("worst"))


def a_witness(run):
    (file,) = (run / "witnesses").iterdir()
    changed(file, lambda v: v["triangles"][0].update(drawn=False))


def a_file_less(run):
    (run / "frames.parquet").unlink()


def the_exit_status(run):
    changed(run / "../../commands/run-town.json", lambda v: v.update(status=0))


def the_output(run):
    changed(run / "../../commands/run-town.json", lambda v: v["stdout"].insert(1, "more"))


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (one_frame_count, "frames.parquet: column visible, row 1: 4 became 5"),
        (two_rows_swapped, "frames.parquet: column frame, row 0: 0 became 1"),
        (one_row_less, "frames.parquet: rows: 3 became 2"),
        (one_column_less, "frames.parquet: column visible: 'int64' became 'nothing'"),
        (one_depth, "truth.parquet: column depth, row 1: nan became 2.0"),
        (the_truths_facts, "truth.parquet: metadata.frames.1: 1 became 2"),
        (one_sum, f"verdict.json: cullers.{BROKEN}.missed: 0 became 1"),
        (one_finding, "verdict.json: findings.0.code: 'MISSED_OBJECT' became 'OBJECT_MISSED'"),
        (one_key_less, f"verdict.json: cullers.{BROKEN}.worst: None became 'nothing'"),
        (a_witness, "0.triangles.0.drawn: True became False"),
        (a_file_less, "frames.parquet: file: 'there' became 'missing'"),
        (the_exit_status, "run-town.json: status: 1 became 0"),
        (the_output, "run-town.json: stdout.length: 3 became 4"),
    ],
)
def test_one_planted_change_is_a_difference_with_its_place(folders, change, place):
    old, new, run = folders
    change(run)
    status, said = compare(old, new)
    assert status == 1
    assert place in said


def test_equal_records_do_not_differ_and_every_value_is_counted(folders):
    old, new, _ = folders
    status, said = compare(old, new)
    assert status == 0
    assert "frames: 1 files, 9 values compared, 0 differences" in said
    assert "New fields: none" in said
    assert said.endswith("Nothing differs.\n")


def test_new_columns_and_keys_are_listed_once_and_are_no_difference(folders):
    old, new, run = folders
    write_table(run / "frames.parquet", {**FRAMES, "view": ["", "", ""]})
    changed(run / "verdict.json", lambda v: v["cullers"][BROKEN].update(waived=0, late=0))
    changed(run / "verdict.json", lambda v: v["findings"][0].update(view=""))
    status, said = compare(old, new)
    assert status == 0
    _, fields = said.split("New fields:\n")
    assert [line.strip() for line in fields.splitlines()[:4]] == [
        "frames: column view (1 times)",
        "verdicts: cullers.*.late (1 times)",
        "verdicts: cullers.*.waived (1 times)",
        "verdicts: findings.*.view (1 times)",
    ]


def test_times_machines_and_packages_are_left_out(folders):
    old, new, run = folders
    write_table(run / "timings.parquet", {"ms": [2.0]})
    changed(run / "manifest.json", lambda v: v.update(machine={"cores": 64}, versions={}))
    said = {"stdout": ["culler frames", f"{BROKEN}    2", "in 27.25 s"]}
    changed(new / "commands" / "run-town.json", lambda v: v.update(said))
    status, said = compare(old, new)
    assert (status, "Nothing differs." in said) == (0, True)


def test_renamed_packages_are_one_name_in_texts_keys_rows_and_file_names(tmp_path):
    records(tmp_path / "old")
    slug = "visref_culling.broken_HastyQueryCulling-01234567"
    run = records(tmp_path / "new", f"visref_{BROKEN}", slug)
    assert compare(tmp_path / "old", tmp_path / "new")[0] == 0
    write_table(run / "frames.parquet", {**FRAMES, "culler": ["none", "none", "no:OtherCulling"]})
    status, said = compare(tmp_path / "old", tmp_path / "new")
    assert status == 1
    assert f"column culler, row 2: '{BROKEN}' became 'no:OtherCulling'" in said


def test_nothing_to_compare_is_no_success(tmp_path):
    for name in ("old", "new"):
        (tmp_path / name).mkdir()
    assert compare(tmp_path / "old", tmp_path / "new")[0] == 1
