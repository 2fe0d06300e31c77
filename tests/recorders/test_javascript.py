"""The JavaScript recorder is one for `import`, `require` and a page; its types are those of its
calls."""

from __future__ import annotations

import json
import re
import subprocess

import pytest

from tests.recorders.calls import strict_lines
from tests.recorders.languages.base import RECORDERS

pytestmark = pytest.mark.needs("node")
FOLDER = RECORDERS / "javascript"
RECORD = """
const r = new Recorder(%s, 64, 48);
r.beginFrame(0);
const pose = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1];
r.camera("world_from_camera", "column_major", new Float32Array(pose));
r.visible(new Set([1, "a"]));
r.endFrame();
"""
LINE = {
    "frame": 0,
    "world_from_camera": [[1, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]],
    "visible": [1, "a"],
}


def node(folder, name: str, source: str) -> str:
    (folder / name).write_text(source, encoding="utf-8")
    done = subprocess.run(["node", name], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("name", "get"),
    [
        ("main.mjs", f'import {{ Recorder }} from "{FOLDER}/visref_recorder.mjs";'),
        ("main.cjs", f'const {{ Recorder }} = require("{FOLDER}/visref_recorder.js");'),
    ],
)
def test_modules_of_both_kinds_write_a_file(name, get, tmp_path):
    node(tmp_path, name, get + RECORD % '"recording.jsonl"' + "r.close();")
    assert strict_lines((tmp_path / "recording.jsonl").read_bytes())[1:] == [LINE]


def test_without_a_file_closing_gives_a_blob_of_the_text(tmp_path):
    """Of more than is kept as one piece of text."""
    source = f'const {{ Recorder }} = require("{FOLDER}/visref_recorder.js");' + RECORD % "null"
    source += """
for (let i = 1; i < 3000; i++) {
  r.beginFrame(i);
  r.camera("world_from_camera", "column_major", pose);
  r.visible([]);
  r.endFrame();
}
r.close().text().then((text) => process.stdout.write(text));
"""
    lines = strict_lines(node(tmp_path, "main.cjs", source).encode())
    assert lines[1] == LINE
    assert [line["frame"] for line in lines[1:]] == list(range(3000))


@pytest.mark.parametrize("wrong", ['"\\ud800"', '"a\\udc00b"'])
def test_half_of_a_surrogate_pair_is_told(wrong, tmp_path):
    source = f'const {{ Recorder }} = require("{FOLDER}/visref_recorder.js");' + RECORD % "null"
    source = (
        source.replace('"a"', wrong) + "try { r.close(); } catch (e) { console.log(e.message); }"
    )
    assert node(tmp_path, "main.cjs", source).startswith("frame 0: a name is no Unicode")


@pytest.mark.parametrize("wrong", ["1.5", "NaN", "-0.5", "2 ** 60"])
def test_ids_that_are_no_integers_are_told(wrong, tmp_path):
    source = f'const {{ Recorder }} = require("{FOLDER}/visref_recorder.js");' + RECORD % "null"
    source = source.replace("Set([1, ", f"Set([{wrong}, ")
    source += "try { r.close(); } catch (e) { console.log(e.message); }"
    assert node(tmp_path, "main.cjs", source).startswith("frame 0: an id, a level or a count")


def test_its_types_declare_its_calls_and_no_others(tmp_path):
    source = f'const visref = require("{FOLDER}/visref_recorder.js");'
    source += """
const calls = visref.Recorder.prototype;
const lengths = Object.getOwnPropertyNames(calls).map((name) => [name, calls[name].length]);
console.log(JSON.stringify([Object.keys(visref), lengths]));
"""
    exported, calls = json.loads(node(tmp_path, "main.cjs", source))
    types = (FOLDER / "visref_recorder.d.ts").read_text("utf-8")
    body = types.partition("export class Recorder {")[2]
    declared = dict(re.findall(r"^  (\w+)\((.*?)\)(?:: .*)?;$", body, flags=re.MULTILINE))
    assert set(declared) == {name for name, _ in calls}
    for name, needed in calls:
        if name != "constructor":
            parameters = [one for one in declared[name].split(", ") if one]
            assert len([one for one in parameters if "?:" not in one]) == needed, name
    assert set(re.findall(r"^export class (\w+)", types, flags=re.MULTILINE)) == set(exported)
