"""JavaScript and Python."""

from __future__ import annotations

import json
import sys
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.recorders.calls import Call, stored
from tests.recorders.languages.base import RECORDERS, Recording, real

JAVASCRIPT = RECORDERS / "javascript" / "visref_recorder.js"


def script_call(call: Call, camel: bool, none: str, value: Callable[[object], str]) -> str:
    name, *rest = call
    named = {"visible_ids": "visible", "visible_names": "visible"}.get(name, name)
    if name == "visible_names" and not rest[0]:
        return ""
    if name in ("camera", "pose"):
        order = rest[1]
        matrix = stored(rest[2], order)
        column = ["column_major=" + repr(order == "column_major")]
        if name == "camera":
            rest = [rest[0], order, matrix, rest[3]] if camel else [rest[0], matrix, rest[3]]
        else:
            rest = [rest[0], order, matrix] if camel else [rest[0], matrix]
        arguments = [value(one) for one in rest] + ([] if camel else column)
    else:
        arguments = [value(one) for one in rest]
    if camel:
        head, *tail = named.split("_")
        named = head + "".join(part.capitalize() for part in tail)
    return f"r.{named}({', '.join(arguments)})"


def javascript_value(value: object) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(javascript_value, value))}]"
    if isinstance(value, float):
        return real(value, "Infinity", "NaN")
    return json.dumps(value)


def javascript_program(recordings: Sequence[Recording]) -> str:
    lines = [f"const {{ Recorder }} = require({json.dumps(str(JAVASCRIPT))});"]
    for number, one in enumerate(recordings):
        lines.append(
            f'if (process.env.ONLY.includes("|{number}|")) {{\n'
            f"const r = new Recorder({json.dumps(one.file)}, {one.width}, {one.height});"
        )
        for call in one.calls:
            kill = 'process.kill(process.pid, "SIGKILL")'
            lines.append(
                kill if call == ("kill",) else script_call(call, True, "null", javascript_value)
            )
        lines.append(
            'try { r.close(); console.log("ok"); }\n'
            "catch (error) { console.log(`problem: ${error.message}`); }\n}"
        )
    return "\n".join(lines)


def build_javascript(recordings: Sequence[Recording], folder: Path) -> list[str]:
    (folder / "program.cjs").write_text(javascript_program(recordings), encoding="utf-8")
    return ["node", str(folder / "program.cjs")]


def python_value(value: object) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(python_value, value))}]"
    return real(value, "math.inf", "math.nan") if isinstance(value, float) else ascii(value)


def python_program(recordings: Sequence[Recording]) -> str:
    lines = [
        "import math, os, signal, sys",
        f"sys.path.insert(0, {str(RECORDERS / 'python')!r})",
        "import visref_recorder",
        "visref_recorder.BUFFER = 512",
    ]
    for number, one in enumerate(recordings):
        made = [f"r = visref_recorder.Recorder({one.file!r}, {one.width}, {one.height})"]
        for call in one.calls:
            kill = "os.kill(os.getpid(), signal.SIGKILL)"
            made.append(
                kill if call == ("kill",) else script_call(call, False, "None", python_value)
            )
        made.append(
            "try:\n    r.close()\n    print('ok', flush=True)\n"
            "except visref_recorder.RecordingError as error:\n"
            "    print(f'problem: {error}', flush=True)"
        )
        lines.append(f"if '|{number}|' in os.environ['ONLY']:")
        lines.append(textwrap.indent("\n".join(made), "    "))
    return "\n".join(lines)


def build_python(recordings: Sequence[Recording], folder: Path) -> list[str]:
    (folder / "program.py").write_text(python_program(recordings), encoding="utf-8")
    return [sys.executable, "-B", str(folder / "program.py")]
