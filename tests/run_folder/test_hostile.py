"""A run folder from anybody: whatever is in it, `report` and `explain` end with one line and status
2, read nothing outside of it and write nothing but what was named.
"""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import struct
import zlib
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image

from tests.support import report_runs
from tests.support.report_runs import BROKEN, NASTY_ID
from visref.cli.main import main
from visref.errors import InputError
from visref.run_folder import claims
from visref.run_folder.explain import explain
from visref.run_folder.inside import strict_json
from visref.run_folder.layout import slug
from visref.run_folder.read import read_run
from visref.run_folder.write import write_json

WITNESSES = f"witnesses/{slug(BROKEN)}.jsonl"
SECRET = b"root:x:0:0: what nobody may see"
# What every mutation below is tried with: each file of a run folder that is read.
FILES = ("manifest.json", "verdict.json", "frames.parquet", "timings.parquet", "objects.parquet",
         WITNESSES, "pictures/frame-00000.jpg")  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return report_runs.write_runs(tmp_path_factory.mktemp("runs"))["violation"]


@pytest.fixture
def run(written, tmp_path):
    """A copy to spoil, somewhere below a folder that nothing may be written into."""
    return shutil.copytree(written, tmp_path / "a" / "b" / "run")


def statuses(run: Path, capsys) -> dict[str, int]:
    """The status of `report` and of `explain`. Neither may say more than a line of an error, or
    write a file anywhere but where it was told to and below the folder's own witnesses."""
    root = run.parents[2]
    before = {path for path in root.rglob("*") if path != root / "page"}
    found = {}
    asked = ["--frame", "1", "--object", str(NASTY_ID), "--culler", BROKEN]
    for command in (
        ["report", str(run), "--out", str(root / "page")],
        ["explain", str(run), *asked],
    ):
        capsys.readouterr()
        found[command[0]] = main(command)
        said = capsys.readouterr()
        if found[command[0]] not in (0, 1):
            # A terminal of 80 columns may fold the line; a traceback has its own heading.
            assert said.err.startswith("error: ")
            assert "Traceback" not in said.err
            assert len(said.err) < 1000
    made = set(root.rglob("*")) - before
    named = {path for path in made if (root / "page") in (path, *path.parents)}
    beside = {path for path in made if path.parent == run / "witnesses" and path.suffix == ".png"}
    assert made <= named | beside
    if (root / "page" / "report.html").is_file():
        page = (root / "page" / "report.html").read_bytes()
        assert SECRET not in page
        assert base64.b64encode(SECRET)[:40] not in page
    return found


def edit(file: Path, change) -> None:
    """Change the JSON of a file, of a file of lines that of the first one."""
    lines = file.read_text().splitlines() if file.suffix == ".jsonl" else [file.read_text()]
    value = json.loads(lines[0])
    change(value)
    file.write_text("\n".join([json.dumps(value), *lines[1:]]) + "\n")


def test_a_folder_that_nobody_touched_is_shown_and_replayed(run, capsys):
    assert statuses(run, capsys) == {"report": 1, "explain": 0}
    (picture,) = (run / "witnesses").glob("*.png")
    assert picture.name == f"{slug(BROKEN)}-00001-{NASTY_ID}.png"


def _removed(file: Path) -> None:
    file.unlink()


def _a_folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


def _a_pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def _a_device(file: Path) -> None:
    file.unlink()
    file.symlink_to("/dev/zero")


def _a_link_out(file: Path) -> None:
    shutil.copy(file, file.parents[len(file.relative_to(_run_of(file)).parts)] / "elsewhere")
    file.unlink()
    file.symlink_to(_run_of(file).parent / "elsewhere")


def _a_circle(file: Path) -> None:
    file.unlink()
    file.symlink_to(file.name)


def _empty(file: Path) -> None:
    file.write_bytes(b"")


def _cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def _noise(file: Path) -> None:
    file.write_bytes(bytes(range(256)) * 4)


def _run_of(file: Path) -> Path:
    return next(parent for parent in file.parents if parent.name == "run")


IN_PLACE = (_removed, _a_folder, _a_pipe, _a_device, _a_link_out, _a_circle, _empty, _cut, _noise)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("spoil", IN_PLACE)
def test_what_is_no_ordinary_whole_file_of_the_folder_is_refused(name, spoil, run, capsys):
    spoil(run / name)
    found = statuses(run, capsys)
    of_explain = name in (WITNESSES, "manifest.json")
    # A page is made without witnesses too: a culler that missed nothing has no file of them, and an
    # empty one has none.
    none = name == WITNESSES and spoil in (_removed, _a_circle, _empty)
    assert found["report"] == (1 if none else 2)
    assert found["explain"] == (2 if of_explain else 0)


def test_a_link_that_stays_in_the_folder_is_followed(run, capsys):
    for name in FILES:
        kept = (run / name).with_name(f"kept-{Path(name).name}")
        (run / name).rename(kept)
        (run / name).symlink_to(kept.name)
    assert statuses(run, capsys) == {"report": 1, "explain": 0}


OUTSIDE = ("../../secret.png", "/etc/passwd", "pictures/../../../secret.png", "pictures/a/b.png",
           "pictures\\a.png", "C:a.png", "pictures/x.svg", "", "pictures/\0.png")  # fmt: skip


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_picture_named_outside_of_the_folder_is_never_read(name, run, capsys):
    (run.parents[2] / "secret.png").write_bytes(SECRET)

    def elsewhere(manifest):
        for pictures in manifest["pictures"]:
            pictures["files"]["drawn"] = name

    edit(run / "manifest.json", elsewhere)
    assert statuses(run, capsys)["report"] == 2


def _png(width: int, height: int) -> bytes:
    """A PNG that says it is of that size, and has a row of it."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    rows = zlib.compress(b"\0" * (width + 1))
    start = b"\x89PNG\r\n\x1a\n"
    return start + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


PICTURES = {
    "text": lambda file: file.write_bytes(SECRET),
    "a bomb": lambda file: file.write_bytes(_png(100_000, 100_000)),
    "half of one": lambda file: file.write_bytes(file.read_bytes()[: file.stat().st_size // 2]),
    "another size": lambda file: Image.new("RGB", (7, 7)).save(file),
    "another format": lambda file: Image.new("RGB", (48, 32)).save(file, format="GIF"),
}


@pytest.mark.parametrize("what", PICTURES)
def test_a_picture_is_a_picture_of_its_frames_size(what, run, capsys):
    (file,) = (run / "pictures").glob("frame-00003-ids.png")
    PICTURES[what](file)
    assert statuses(run, capsys)["report"] == 2


JSON_TRAPS = {
    "lists without end": lambda text: "[" * 100_000,
    "objects without end": lambda text: '{"a":' * 100_000,
    "NaN": lambda text: text.replace("1", "NaN", 1),
    "beyond float64": lambda text: text.replace("1", "1e999", 1),
    "a number of 5000 digits": lambda text: text.replace("{", '{"someday": ' + "9" * 5000 + ",", 1),
    "a key twice": lambda text: text.replace("{", '{"frame": 1, "frame": 1, ', 1),
    "NUL in a text": lambda text: text.replace("{", '{"someday": "\\u0000", ', 1),
    "half a character": lambda text: text.replace("{", '{"someday": "\\ud800", ', 1),
    "half a character as a key": lambda text: text.replace("{", '{"\\udfff": 1, ', 1),
    "no object": lambda text: "[]",
}


@pytest.mark.parametrize("name", ["manifest.json", "verdict.json", WITNESSES])
@pytest.mark.parametrize("trap", JSON_TRAPS)
def test_json_that_is_a_trap_is_refused(trap, name, run, capsys):
    (run / name).write_text(JSON_TRAPS[trap]((run / name).read_text()))
    found = statuses(run, capsys)
    assert 2 in found.values()
    assert found["explain"] == (0 if name == "verdict.json" else 2)


def test_whole_characters_pass():
    text = '{"a": "\\ud83d\\ude00", "b": 1.5e300, "c": [-3, "\U0001f600"]}'
    assert strict_json(text.encode(), "f", "") == json.loads(text)


def _witness(**changes):
    def spoil(run):
        edit(run / WITNESSES, lambda witness: witness.update(changes))

    return spoil


def _samples(**changes):
    def spoil(run):
        edit(run / WITNESSES, lambda witness: witness["samples"].update(changes))

    return spoil


def _triangle(**changes):
    def spoil(run):
        edit(run / WITNESSES, lambda witness: witness["triangles"][0].update(changes))

    return spoil


HUGE = [["0x1.0000000000000p+1000"] * 3] * 3
CLAIMS = {
    "a culler that leads out": _witness(culler="/../../x"),
    "another culler": _witness(culler="none"),
    "an object that leads out": _witness(object="../../x"),
    "an object beyond the scene": lambda run: edit(
        run / WITNESSES, lambda w: w.update(object=99, object_name=str(NASTY_ID))
    ),
    "a view that leads out": _witness(view="../../x"),
    "a sample beside the image": _witness(x=report_runs.WIDTH),
    "a sample below the image": _witness(y=10**9),
    "a triangle beyond the scene": _witness(triangle=10**6),
    "no triangles": _witness(triangles=None),
    "thousands of triangles": lambda run: edit(
        run / WITNESSES,
        lambda w: w.update(triangles=w["triangles"][:1] * (claims.MAX_TRIANGLES + 1)),
    ),
    "a width without end": _samples(width=1 << 40),
    "another camera": _samples(width=report_runs.WIDTH + 1),
    "NaN": _samples(near="nan"),
    "an infinite eye": _samples(e=["inf"] * 3),
    "no projection": _samples(projection="fisheye"),
    "a vertex beyond float32": _triangle(vertices=HUGE),
    "a vertex that is no float32": _triangle(vertices=[["0x1.0000000000001p+0"] * 3] * 3),
    "a vertex that is NaN": _triangle(vertices=[["nan"] * 3] * 3),
    "two corners": _triangle(vertices=HUGE[:2]),
    "an unknown alpha": _triangle(alpha=7),
    "an unknown mask": _triangle(mask=-1),
    "drawn as a number": _triangle(drawn=1),
}


@pytest.mark.parametrize("what", CLAIMS)
def test_a_hostile_witness_is_refused_and_writes_nothing(what, run, capsys):
    CLAIMS[what](run)
    assert statuses(run, capsys)["explain"] == 2
    assert not list(run.rglob("*.png")) or not list((run / "witnesses").glob("*.png"))


@pytest.mark.parametrize("place", ["witnesses", f"witnesses/{slug(BROKEN)}-00001-{NASTY_ID}.png"])
def test_a_neighbourhood_is_never_written_through_a_link(place, run, capsys):
    outside = run.parents[2] / "outside"
    if place == "witnesses":
        (run / place).rename(outside)
    else:
        outside.write_bytes(b"precious")
    (run / place).symlink_to(outside)
    assert statuses(run, capsys)["explain"] == 2
    assert outside.is_dir() or outside.read_bytes() == b"precious"


def test_a_witness_of_as_many_triangles_as_may_be_is_replayed(run):
    def many(witness):
        triangles = witness["triangles"]
        witness["triangles"] = [*triangles, *triangles[:1] * 300]

    edit(run / WITNESSES, many)
    (explanation,) = explain(run, 1, str(NASTY_ID), BROKEN)
    assert len(explanation.witness["triangles"]) > 300


def _column(name, column, value, *, all_=False):
    """A cell, or all, replaced by a value; the file's own column keeps its type."""

    def spoil(run):
        file = run / f"{name}.parquet"
        table = pq.read_table(file)
        kind = table.schema.field(column).type
        values = table[column].to_pylist()
        filled = next(i for i, old in enumerate(values) if old is not None)
        values = [value] * len(values) if all_ else [*values[:filled], value, *values[filled + 1 :]]
        table = table.set_column(
            table.schema.get_field_index(column), column, pa.array(values, kind)
        )
        pq.write_table(table, file)

    return spoil


def _table(name, change):
    def spoil(run):
        pq.write_table(change(pq.read_table(run / f"{name}.parquet")), run / f"{name}.parquet")

    return spoil


def _as(column, kind):
    def change(table):
        place = table.schema.get_field_index(column)
        return table.set_column(place, column, table[column].cast(kind))

    return change


def _not_utf8(table):
    wrong = pa.array([b"\xff\xfe"] * len(table), pa.binary())
    texts = pa.StringArray.from_buffers(len(table), *wrong.buffers()[1:])
    return table.set_column(table.schema.get_field_index("view"), "view", texts)


TABLES = {
    "a count below zero": _column("frames", "missed_pixels", -1),
    "a counter below zero": _column("frames", "queries", -1),
    "a frame below zero": _column("frames", "frame", -1),
    "a row twice": _table("frames", lambda t: pa.concat_tables([t, t.slice(0, 1)])),
    "rows without end": _table("frames", lambda t: pa.concat_tables([t] * 100)),
    "a column twice": _table("frames", lambda t: t.append_column("frame", t["frame"])),
    "large texts": _table("frames", _as("culler", pa.large_string())),
    "texts that are not UTF-8": _table("frames", _not_utf8),
    "a picture of a frame that was not judged": _table("frames", lambda t: t.slice(0, 1)),
    "a time that is NaN": _column("timings", "ms", float("nan")),
    "an infinite time": _column("timings", "ms", float("inf")),
    "a time below zero": _column("timings", "ms", -1.0),
    "a time of nobody": _column("timings", "culler", "who"),
    "a time of no frame": _column("timings", "frame", 99),
    "an unknown kind": _column("objects", "kind", "who"),
    "an unknown cause": _column("objects", "cause", "who"),
    "an object beyond the scene": _column("objects", "object", 99),
    "a unit beyond the culler's": _column("objects", "unit", 10**6),
    "a triangle beyond the scene": _column("objects", "triangle", 10**6),
    "a sample beside the image": _column("objects", "x", 10**6),
    "a depth that is NaN": _column("objects", "depth", float("nan")),
    "NUL in a name": _column("objects", "name", "a\0b"),
    "misses without samples": _column("objects", "x", None, all_=True),
    "a row more than was counted": _table("objects", lambda t: pa.concat_tables([t, t])),
}


@pytest.mark.parametrize("what", TABLES)
def test_a_table_that_says_what_cannot_be_is_refused(what, run, capsys):
    TABLES[what](run)
    assert statuses(run, capsys)["report"] == 2


def test_a_column_by_a_dictionary_is_read_as_what_it_holds(written, run):
    for name, columns in (("frames", ("culler",)), ("objects", ("kind", "name", "unit"))):
        table = pq.read_table(run / f"{name}.parquet")
        for column in columns:
            place = table.schema.get_field_index(column)
            table = table.set_column(place, column, table[column].dictionary_encode())
        pq.write_table(table, run / f"{name}.parquet")
        assert pa.types.is_dictionary(
            pq.read_schema(run / f"{name}.parquet").field(columns[0]).type
        )
    before, after = read_run(written), read_run(run)
    assert after.frames == before.frames
    assert after.objects.to_pylist() == before.objects.to_pylist()


def _json(name, *at):
    """A value in a JSON file replaced by the last of `at`."""

    def spoil(run):
        def change(value):
            for key in at[:-2]:
                value = value[key]
            value[at[-2]] = at[-1]

        edit(run / f"{name}.json", change)

    return spoil


TOGETHER = {
    "green in spite of a violation": _json("verdict", "exit_status", 0),
    "a run that is well in spite of a culler": _json("verdict", "status", "no_violation_found"),
    "a culler that is well in spite of violations": _json(
        "verdict", "cullers", BROKEN, "status", "no_violation_found"
    ),
    "a culler that is guilty without violations": _json(
        "verdict", "cullers", "none", "status", "violation"
    ),
    "a count beyond int64": _json("verdict", "cullers", "none", "visible", 1 << 63),
    "frames that are not defined": _json("manifest", "path", "frames", 4),
    "another slug": _json("manifest", "cullers", BROKEN, "slug", "none"),
    "a slug that leads out": _json("manifest", "cullers", BROKEN, "slug", "../x"),
    "a picture of no culler": _json("manifest", "pictures", 0, "culler", "who"),
    "a picture of no frame": _json("manifest", "pictures", 0, "frame", 99),
    "how it was generated, as a number": _json("manifest", "settings", {"generated": 7}),
    "settings too deep": _json("manifest", "settings", json.loads("[" * 50 + "]" * 50)),
    "an image without end": _json("manifest", "samples", 0, "", "width", 1 << 30),
}


@pytest.mark.parametrize("what", TOGETHER)
def test_files_that_do_not_go_together_are_refused(what, run, capsys):
    TOGETHER[what](run)
    assert statuses(run, capsys)["report"] == 2


BREAKING = "</script><script>x()</script><!--\u2028\u202e\"'>&{{7*7}}{% raw %}"


def test_no_text_of_a_run_folder_gets_out_of_its_place_on_the_page(run, tmp_path):
    """Every text that anybody may choose is one that would end an element, an attribute, a
    comment, a script or a template."""
    for name in ("frames", "timings", "objects"):
        table = pq.read_table(run / f"{name}.parquet")
        for column in ("culler", "name", "occluder_name"):
            if column in table.column_names:
                texts = [
                    text
                    if text in (None, "")
                    else BREAKING
                    if column != "culler" or text == BROKEN
                    else text
                    for text in table[column].to_pylist()
                ]
                place = table.schema.get_field_index(column)
                table = table.set_column(place, column, pa.array(texts, pa.string()))
        pq.write_table(table, run / f"{name}.parquet")

    def manifest(value):
        value["cullers"][BREAKING] = value["cullers"].pop(BROKEN) | {"slug": slug(BREAKING)}
        for pictures in value["pictures"]:
            if pictures["culler"] == BROKEN:
                pictures["culler"] = BREAKING
        value["engine"] = value["scene"]["source"] = value["scene"]["sha256"] = BREAKING
        value["path"] |= {"source": BREAKING, "sha256": BREAKING}
        value["machine"] |= {"cpu": BREAKING, "system": BREAKING}
        value["versions"] = {BREAKING: BREAKING}
        value["settings"] = {BREAKING: BREAKING, "generated": {BREAKING: BREAKING}}

    def verdict(value):
        value["cullers"][BREAKING] = value["cullers"].pop(BROKEN)
        value["cullers"][BREAKING]["worst"]["object_name"] = BREAKING
        value["cullers"][BREAKING]["unit_kind"] = "object"
        for finding in value["findings"]:
            finding |= {"message": BREAKING, "object": BREAKING}

    edit(run / "manifest.json", manifest)
    edit(run / "verdict.json", verdict)
    assert main(["report", str(run), "--out", str(tmp_path / "page")]) == 1
    page = (tmp_path / "page" / "report.html").read_text()
    # What is only data is never run.
    assert len(re.findall('<script(?! type="application/octet-stream")', page)) == 1
    assert page.count("<script") == page.count("</script>")
    assert "<!--" not in page
    assert "{{7*7}}" in page
    assert ">49<" not in page
    assert "x()" in page


def test_what_visref_writes_of_a_name_that_is_no_unicode_is_read(tmp_path):
    write_json(tmp_path / "a.json", {"source": "caf\udce9.glb", "fine": "\U0001f600é"})
    written = strict_json((tmp_path / "a.json").read_bytes(), "a.json", "")
    assert written == {"source": "caf\ufffd.glb", "fine": "\U0001f600é"}


def test_a_folder_is_refused_by_its_reader_and_not_by_its_printer(run):
    (run / "verdict.json").write_text("{}")
    with pytest.raises(InputError, match="version: it is missing"):
        read_run(run)
