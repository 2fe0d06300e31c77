"""C#, by Mono's compiler."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

from tests.recorders.calls import Call, stored
from tests.recorders.languages.base import RECORDERS, Recording, compiled


def csharp_string(text: str | None) -> str:
    if text is None:
        return "null"
    units = struct.iter_unpack("<H", text.encode("utf-16-le", "surrogatepass"))
    return '"' + "".join(f"\\u{unit:04x}" for (unit,) in units) + '"'


def csharp_value(value: object) -> str:
    if value is None or isinstance(value, str):
        return csharp_string(value)
    if isinstance(value, float):
        # By its bits: mcs rounds some literals wrongly, and takes a -0.0 in an array for 0.0.
        (bits,) = struct.unpack("<q", struct.pack("<d", value))
        return f"BitConverter.Int64BitsToDouble({bits})"
    if isinstance(value, list):
        kind = "string" if value and isinstance(value[0], str) else "double" if value else "string"
        return f"new {kind}[] {{ {', '.join(map(csharp_value, value))} }}"
    return repr(value)


def csharp_call(call: Call) -> str:
    name, *rest = call

    def words(text: str) -> str:
        return "".join(part.capitalize() for part in text.split("_"))

    match name, rest:
        case "camera" | "camera_f", [form, order, matrix, view]:
            m = csharp_value([float(x) for x in stored(matrix, order)])
            if name == "camera_f":
                m = f"Array.ConvertAll({m}, x => (float)x)"
            how = f"VisrefRecorder.Form.{words(form)}, VisrefRecorder.Order.{words(order)}"
            return f"r.Camera({how}, {m}, {csharp_string(view)});"
        case "pose", [one, order, matrix]:
            m = csharp_value([float(x) for x in stored(matrix, order)])
            return f"r.Pose({csharp_string(one)}, VisrefRecorder.Order.{words(order)}, {m});"
        case "visible_ids" | "visible_nodes", [ids, view]:
            listed = f"new int[] {{ {', '.join(map(str, ids))} }}"
            return f"r.{words(name)}({listed}, {csharp_string(view)});"
        case "visible_names", [names, view]:
            return " ".join(
                f"r.VisibleName({csharp_string(one)}, {csharp_string(view)});" for one in names
            )
        case "kill", []:
            return "System.Diagnostics.Process.GetCurrentProcess().Kill();"
    return f"r.{words(name)}({', '.join(map(csharp_value, rest))});"


def build_csharp(recordings: Sequence[Recording], folder: Path) -> list[str]:
    lines = ["using System;", "static class Program {"]
    for number, one in enumerate(recordings):
        lines += [
            f"static void Recording{number}() {{",
            f"var r = new VisrefRecorder({csharp_string(one.file)},",
            f"{one.width}, {one.height});",
            *(csharp_call(call) for call in one.calls),
            'try { r.Close(); Console.WriteLine("ok"); }',
            "catch (System.IO.InvalidDataException e)",
            '{ Console.WriteLine("problem: " + e.Message); }',
            "}",
        ]
    calls = "\n".join(
        f'if (only.Contains("|{number}|")) Recording{number}();'
        for number in range(len(recordings))
    )
    only = 'string only = Environment.GetEnvironmentVariable("ONLY");'
    lines.append(f"static void Main() {{ {only}\n{calls} }}\n}}")
    (folder / "Program.cs").write_text("\n".join(lines), encoding="utf-8")
    source = RECORDERS / "csharp" / "VisrefRecorder.cs"
    compiled(["mcs", "-warnaserror", "-out:program.exe", source, "Program.cs"], folder)
    return ["mono", str(folder / "program.exe")]
