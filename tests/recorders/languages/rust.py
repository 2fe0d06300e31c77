"""Rust, by rustc alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from tests.recorders.calls import Call, stored
from tests.recorders.languages.base import RECORDERS, Recording, compiled, real


def rust_string(text: str) -> str:
    return (
        '"'
        + "".join(c if c.isalnum() and c.isascii() else f"\\u{{{ord(c):x}}}" for c in text)
        + '"'
    )


def rust_value(value: object) -> str:
    if isinstance(value, str):
        return rust_string(value)
    if isinstance(value, float):
        return real(value, "f64::INFINITY", "f64::NAN") + ("_f64" if math.isfinite(value) else "")
    if isinstance(value, list):
        return f"&[{', '.join(map(rust_value, value))}]"
    return repr(value)


def rust_call(call: Call) -> str:
    name, *rest = call

    def view(of: str | None) -> str:
        return "None" if of is None else f"Some({rust_string(of)})"

    def words(text: str) -> str:
        return "".join(part.capitalize() for part in text.split("_"))

    match name, rest:
        case "camera" | "camera_f", [form, order, matrix, of]:
            m = rust_value([float(x) for x in stored(matrix, order)])
            m = m.replace("_f64", "_f32") if name == "camera_f" else m
            return f"r.camera(Form::{words(form)}, Order::{words(order)}, {m}, {view(of)});"
        case "pose", [one, order, matrix]:
            m = rust_value([float(x) for x in stored(matrix, order)])
            return f"r.pose({rust_string(one)}, Order::{words(order)}, {m});"
        case "visible_names", [names, of]:
            return " ".join(f"r.visible_name({rust_string(n)}, {view(of)});" for n in names)
        case "visible_ids" | "visible_nodes", [ids, of]:
            return f"r.{name}({rust_value(ids)}, {view(of)});"
        case "field", [field, value, of]:
            return f"r.field({rust_string(field)}, {rust_value(value)}, {view(of)});"
        case "kill", []:
            return "std::process::abort();"
    return f"r.{name}({', '.join(map(rust_value, rest))});"


def build_rust(recordings: Sequence[Recording], folder: Path, *flags: str) -> list[str]:
    lines = ["use visref_recorder::*;"]
    for number, one in enumerate(recordings):
        lines.append(f"fn recording_{number}() {{ let mut r = Recorder::create(")
        lines.append(f"{rust_string(one.file)}, {one.width}, {one.height});")
        lines += [rust_call(call) for call in one.calls]
        lines.append(
            'match r.close() { Ok(()) => println!("ok"), Err(e) => println!("problem: {e}") } }'
        )
    lines += ["fn main() {", 'let only = std::env::var("ONLY").unwrap_or("|0|".into());']
    lines += [
        f'if only.contains("|{number}|") {{ recording_{number}(); }}'
        for number in range(len(recordings))
    ]
    (folder / "program.rs").write_text("\n".join([*lines, "}"]), encoding="utf-8")
    rustc = ["rustc", "--edition", "2021", "-A", "unreachable_code", "-A", "unused_mut"]
    library = build_rust_library(folder, *flags)
    compiled([*rustc, "--extern", f"visref_recorder={library}", "program.rs"], folder)
    return [str(folder / "program")]


def build_rust_library(folder: Path, *flags: str) -> Path:
    rustc = ["rustc", "--edition", "2021", "-D", "warnings", "--crate-type", "rlib", *flags]
    source = RECORDERS / "rust" / "src" / "lib.rs"
    compiled([*rustc, "--crate-name", "visref_recorder", source], folder)
    return folder / "libvisref_recorder.rlib"
