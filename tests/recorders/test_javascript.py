"""The JavaScript recorder is one for `import`, `require` and a page; its types are those of its
calls."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Sequence

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


def problems_of(folder, setup: str, calls: Sequence[str]) -> list[str]:
    """What `close` throws after each such call in frame 0; no other call may throw."""
    source = f"const {{ Recorder, threeNode }} = require('{FOLDER}/visref_recorder.js');{setup}\n"
    for call in calls:
        source += f"{{ const r = new Recorder(null, 64, 48); r.beginFrame(0); {call};\n"
        source += "try { r.close(); } catch (e) { console.log(e.message); } }\n"
    return node(folder, "main.cjs", source).splitlines()


def test_what_is_no_number_name_or_list_is_told_at_the_end_and_throws_nowhere_else(tmp_path):
    told = {
        "visible([1.5])": "visible got 1.5; ids are whole numbers",
        "visible([undefined])": "visible got undefined; ids are whole numbers",
        "visible([-1])": "visible got -1; ids are whole numbers",
        "visibleNodes([undefined])": "visibleNodes got undefined; node indices are whole numbers",
        "visibleNodes([1e300])": "visibleNodes got 1e+300; node indices are whole numbers",
        "visibleNodes(['tower'])": "visibleNodes got tower; node indices are whole numbers",
        "level('a', NaN)": "level got NaN; levels are whole numbers",
        "stat('queries', Symbol('a'))": "stat got Symbol(a); counts are whole numbers",
        "visible('tower')": "visible takes a list, and got tower",
        "visibleNodes(undefined)": "visibleNodes takes a list, and got undefined",
        "absent(undefined)": "a name is a text, and not undefined",
        "visible(['a'], 7)": "a name is a text, and not 7",
        "camera('world_from_camera', 'row_major')": "a matrix is 16 numbers and their order",
        "bounds('a', undefined, [1, 1, 1])": "a number is not finite",
    }
    problems = problems_of(tmp_path, "", [f"r.{call}" for call in told])
    assert problems == [f"frame 0: {text}" for text in told.values()]


@pytest.mark.parametrize("wrong", ['"\\ud800"', '"a\\udc00b"'])
def test_a_file_tells_half_of_a_surrogate_pair_in_unicode(wrong, tmp_path):
    source = f'const {{ Recorder }} = require("{FOLDER}/visref_recorder.js");'
    source += (RECORD % '"recording.jsonl"').replace('"a"', wrong) + "try { r.close(); } catch {}"
    node(tmp_path, "main.cjs", source)
    (_, line) = strict_lines((tmp_path / "recording.jsonl").read_bytes())
    told = json.loads(wrong).encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")
    assert line == {"stopped": f"frame 0: a name is no Unicode: {told}"}


# A node of one primitive is its mesh; of several, a group of meshes; and a mesh of no file.
OBJECTS = """
const group = { name: "pair", parent: { name: "", parent: null } };
const [one, child, own] = [{ name: "one", parent: group.parent }, { name: "pair_1", parent: group }, { name: "own", parent: null }];
const associations = new Map([[one, { nodes: 0, meshes: 4 }], [group, { nodes: 7 }], [child, { meshes: 5, primitives: 0 }]]);
const gltf = { parser: { associations } };
"""  # noqa: E501


def test_objects_of_three_js_are_told_by_the_node_of_the_file(tmp_path):
    source = f'const {{ threeNode }} = require("{FOLDER}/visref_recorder.js");{OBJECTS}'
    source += "console.log(JSON.stringify([one, group, child].map((o) => threeNode(gltf, o))));"
    source += "console.log(threeNode(gltf, own), threeNode(gltf, null));"
    told = node(tmp_path, "main.cjs", source)
    assert told.split("\n")[:2] == ["[0,7,7]", "undefined undefined"]
    calls = "r.visibleNodes([one, own].map((o) => threeNode(gltf, o)))"
    (problem,) = problems_of(tmp_path, OBJECTS, [calls])
    assert problem.startswith("frame 0: visibleNodes got undefined;")


def test_meshes_of_babylon_js_are_told_by_their_node_s_name(tmp_path):
    """A node may have such a name itself, below another or not."""
    meshes = [
        ({"name": "tower"}, "tower"),
        ({"name": "tower", "parent": {"name": "__root__"}}, "tower"),
        ({"name": "tower_primitive0", "parent": {"name": "tower"}}, "tower"),
        ({"name": "a_primitive1_primitive12", "parent": {"name": "a_primitive1"}}, "a_primitive1"),
        ({"name": "a_primitive1", "parent": {"name": "__root__"}}, "a_primitive1"),
        ({"name": "a_primitive1", "parent": None}, "a_primitive1"),
        ({"name": "line\nend_primitive0", "parent": {"name": "line\nend"}}, "line\nend"),
    ]
    source = f'import {{ babylonName }} from "{FOLDER}/visref_recorder.mjs";'
    source += f"console.log(JSON.stringify({json.dumps([m for m, _ in meshes])}.map(babylonName)));"
    assert json.loads(node(tmp_path, "main.mjs", source)) == [name for _, name in meshes]


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
    assert set(re.findall(r"^export (?:class|function) (\w+)", types, re.MULTILINE)) == set(
        exported
    )
