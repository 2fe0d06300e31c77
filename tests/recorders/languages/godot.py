"""GDScript, in Godot 4 or, translated, in Debian's Godot 3."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import struct
import subprocess
from collections.abc import Sequence
from pathlib import Path

from tests.recorders.calls import Call
from tests.recorders.languages.base import RECORDERS, Recording, real


def gdscript_value(value: object) -> str:
    if value is None:
        return '""'
    if isinstance(value, str):
        return '"' + "".join(f"\\u{ord(c):04x}" if ord(c) < 128 else c for c in value) + '"'
    if isinstance(value, float):
        # By its bits, since Godot rounds what it reads.
        (bits,) = struct.unpack("<q", struct.pack("<d", value))
        # The least integer has no literal.
        return f"double({bits + 1} - 1)" if math.isfinite(value) else real(value, "INF", "NAN")
    if isinstance(value, list):
        return f"[{', '.join(map(gdscript_value, value))}]"
    return repr(value)


def gdscript_call(call: Call) -> str:
    name, *rest = call
    named = {"visible_ids": "visible", "visible_names": "visible"}.get(name, name)
    if name == "visible_names" and not rest[0]:
        return "pass"
    if name == "kill":
        return "OS.kill(OS.get_process_id())"
    if name in ("camera", "pose"):
        rest.pop(1)  # it takes row by row only
        rest[1] = [float(x) for x in rest[1]]
    return f"r.{named}({', '.join(map(gdscript_value, rest))})"


def gdscript_program(recordings: Sequence[Recording]) -> str:
    lines = ["extends SceneTree", 'const Recorder = preload("res://visref_recorder.gd")', ""]
    lines += ["func double(bits: int) -> float:", "\tvar peer := StreamPeerBuffer.new()"]
    lines += ["\tpeer.put_64(bits)", "\tpeer.seek(0)", "\treturn peer.get_double()", ""]
    for number, one in enumerate(recordings):
        # Godot runs in the project's folder.
        file = f'OS.get_environment("OUT") + {json.dumps("/" + one.file)}'
        made = f"Recorder.new({file}, {one.width}, {one.height})"
        lines += [f"func recording_{number}() -> void:", f"\tvar r = {made}"]
        lines += [f"\t{gdscript_call(call)}" for call in one.calls]
        lines += [
            "\tvar told = r.close()",
            '\tprint("ok" if told == "" else "problem: " + told)',
            "",
        ]
    lines += ["func _init() -> void:"]
    lines += ['\tvar only = OS.get_environment("ONLY")']
    lines += [
        f'\tif "|{number}|" in only:\n\t\trecording_{number}()' for number in range(len(recordings))
    ]
    return "\n".join([*lines, "\tquit()", ""])


# What Godot 3, which Debian has, calls otherwise. The recorder is for Godot 4; what it does is the
# same.
IN_GODOT_3 = (
    ("extends RefCounted", "extends Reference"),
    ("Camera3D", "Camera"),
    ("Transform3D", "Transform"),
    ("Vector2i", "Vector2"),
    (" or one is StringName", ""),
    (".is_empty()", ".empty()"),
    (".unicode_at(", ".ord_at("),
    ("deg_to_rad(", "deg2rad("),
    (": FileAccess", ": File"),
    ('",".join(PackedStringArray(texts))', 'PoolStringArray(texts).join(",")'),
    (
        "_file = FileAccess.open(path, FileAccess.WRITE)\n\tif _file == null:",
        "_file = File.new()\n\tif _file.open(path, File.WRITE) != OK:\n\t\t_file = null",
    ),
    ("FileAccess.get_open_error()", "FAILED"),
    (
        "_file.flush()",
        "_file.close(); _file.open(_path, File.READ_WRITE); _file.seek_end()",
    ),
    (
        "var file := FileAccess.open(path, FileAccess.READ)",
        "var file = File.new()\n\tif file.open(path, File.READ) != OK:\n\t\tfile = null",
    ),
    (".get_length()", ".get_len()"),
    (".to_utf8_buffer()", ".to_utf8()"),
)
MAP_OF_GODOT_3 = """

func _map(values: Array, function: String) -> Array:
	var made := []
	for value in values:
		made.append(call(function, value))
	return made
"""


def for_godot_3(source: str) -> str:
    for new, old in IN_GODOT_3:
        source = source.replace(new, old)
    source = re.sub(r"\b(max|min|abs)i\(([^()]*)\)", r"int(\1(\2))", source)
    mapped = re.sub(r"(\w+)\.map\((\w+)\)", r'_map(\1, "\2")', source)
    return mapped + MAP_OF_GODOT_3 if mapped != source else source


def build_gdscript(recordings: Sequence[Recording], folder: Path) -> list[str]:
    return godot_project(folder, {"program.gd": gdscript_program(recordings)})


def godot_project(folder: Path, sources: dict[str, str]) -> list[str]:
    """A project of the recorder and of such scripts; the command that runs `program.gd`."""
    ours = shutil.which("godot4")
    for file in (RECORDERS / "gdscript").glob("*.gd"):
        # Without an editor's scan nothing has a name of its own.
        text = file.read_text("utf-8").replace("class_name", "# class_name", 1)
        if file.name == "visref_recorder.gd":
            text = text.replace(
                "const FORMS", 'const VisrefText = preload("visref_text.gd")\nconst FORMS'
            )
        sources[file.name] = text
    for name, text in sources.items():
        (folder / name).write_text(text if ours else for_godot_3(text), encoding="utf-8")
    (folder / "project.godot").write_text("config_version=5\n" if ours else "config_version=4\n")
    os.environ.setdefault("HOME", str(folder))
    headless = ["--headless"] if ours else []
    return [ours or "godot3-server", *headless, "--path", str(folder), "-s", "program.gd"]


def run_godot(folder: Path) -> None:
    command = godot_project(folder, {})
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)
    assert "SCRIPT ERROR" not in done.stdout + done.stderr, done.stderr
