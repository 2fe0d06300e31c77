"""C and C++, with the flags of an engine."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tests.recorders.calls import Call, stored
from tests.recorders.languages.base import RECORDERS, Recording, compiled, real


def c_string(text: str | bytes | None) -> str:
    if text is None:
        return "NULL"
    raw = text if isinstance(text, bytes) else text.encode()
    return (
        '"' + "".join(chr(b) if chr(b).isalnum() and b < 128 else f"\\{b:03o}" for b in raw) + '"'
    )


def c_call(call: Call) -> str:
    def numbers(kind: str, name: str, values: Sequence[float]) -> str:
        listed = ", ".join(real(one, "HUGE_VAL", "(double)NAN") for one in values)
        return f"const {kind} {name}[] = {{{listed or 0}}}; "

    name, *rest = call
    match name, rest:
        case "camera" | "camera_f", [form, order, matrix, view]:
            m = stored(matrix, order)
            if name == "camera_f":
                listed = ", ".join(f"{float(one)!r}f" for one in m)
                values = f"const float m[] = {{{listed}}}; "
            else:
                values = numbers("double", "m", m)
            how = f"VISREF_{form.upper()}, VISREF_{order.upper()}, m"
            return f"{values}visref_{name}(r, {c_string(view)}, {how});"
        case "pose", [one, order, matrix]:
            values = numbers("double", "m", stored(matrix, order))
            return f"{values}visref_pose(r, {c_string(one)}, VISREF_{order.upper()}, m);"
        case "bounds", [one, least, greatest]:
            values = numbers("double", "a", least) + numbers("double", "b", greatest)
            return f"{values}visref_bounds(r, {c_string(one)}, a, b);"
        case "visible_ids" | "visible_nodes", [ids, view]:
            listed = ", ".join(map(str, ids)) or 0
            return (
                f"const int ids[] = {{{listed}}}; "
                f"visref_{name}(r, {c_string(view)}, ids, {len(ids)});"
            )
        case "visible_names", [names, view]:
            return " ".join(
                f"visref_visible_name(r, {c_string(view)}, {c_string(n)});" for n in names
            )
        case "group", [one, names]:
            listed = ", ".join(map(c_string, names)) or "NULL"
            return (
                f"const char *const names[] = {{{listed}}}; "
                f"visref_group(r, {c_string(one)}, names, {len(names)});"
            )
        case "field", [field, value, view]:
            amount = real(value, "HUGE_VAL", "(double)NAN")
            return f"visref_field(r, {c_string(view)}, {c_string(field)}, {amount});"
        case "kill", []:
            return "raise(SIGKILL);"
    arguments = [c_string(one) if isinstance(one, str | bytes) else f"{one!r}" for one in rest]
    return f"visref_{name}({', '.join(['r', *arguments])});"


def c_program(recordings: Sequence[Recording]) -> str:
    body = []
    for number, one in enumerate(recordings):
        calls = "\n".join(f"    {{ {c_call(call)} }}" for call in one.calls)
        body.append(
            f"static void recording_{number}(void) {{\n    char problem[256];\n"
            f"    visref_recorder *r = visref_open({c_string(one.file)}, "
            f"{one.width}, {one.height});\n{calls}\n"
            "    if (visref_close(r, problem, sizeof problem))\n"
            '        printf("problem: %s\\n", problem);\n'
            '    else printf("ok\\n");\n}\n'
        )
    calls = "\n".join(
        f'    if (chosen("|{number}|")) recording_{number}();' for number in range(len(recordings))
    )
    body.append(
        "static int chosen(const char *number) {\n"
        '    const char *only = getenv("ONLY");\n    return !only || strstr(only, number);\n}\n'
    )
    main = f'int main(void) {{\n    setlocale(LC_ALL, "");\n{calls}\n    return 0;\n}}\n'
    return (
        "#define VISREF_RECORDER_IMPLEMENTATION\n#define VISREF_RECORDER_BUFFER 512\n"
        '#include "visref_recorder.h"\n#include <locale.h>\n'
        "#include <math.h>\n#include <signal.h>\n"
        "#include <stdio.h>\n#include <stdlib.h>\n#include <string.h>\n\n" + "\n".join(body) + main
    )


STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I", str(RECORDERS / "c"))


def build_c(recordings: Sequence[Recording], folder: Path) -> list[str]:
    (folder / "program.c").write_text(c_program(recordings), encoding="utf-8")
    # -D: strict C99 has no SIGKILL. -ffast-math, as engines have it, takes NaN for a number.
    flags = ["-std=c99", "-D_POSIX_C_SOURCE=1", "-O1", "-ffast-math", *STRICT]
    compiled(["gcc", *flags, "program.c", "-o", "program", "-lm"], folder)
    return [str(folder / "program")]


def build_cpp(recordings: Sequence[Recording], folder: Path) -> list[str]:
    (folder / "program.cpp").write_text(c_program(recordings), encoding="utf-8")
    flags = ["-std=c++11", "-DVISREF_RECORDER_THREAD_SAFE", *STRICT]
    compiled(["g++", *flags, "program.cpp", "-o", "program", "-pthread"], folder)
    return [str(folder / "program")]
