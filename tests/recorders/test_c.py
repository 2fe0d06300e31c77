"""What only C has: compilers' flags, locales, threads, memory, and a switch that turns it off."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.recorders.calls import strict_lines
from tests.recorders.languages.base import RECORDERS, compiled
from tests.recorders.languages.c import STRICT

pytestmark = pytest.mark.needs("gcc")

IMPLEMENTATION = """#define VISREF_RECORDER_IMPLEMENTATION
#include "visref_recorder.h"
#include "visref_cameras.h"
"""
MORE = ("-Wshadow", "-Wconversion", "-Wstrict-prototypes", "-Wmissing-declarations")


def program(
    folder: Path, source: str, *flags: str, compiler: str = "gcc", suffix: str = ".c"
) -> Path:
    (folder / f"program{suffix}").write_text(source, encoding="utf-8")
    made = folder / "program"
    compiled([compiler, *flags, *STRICT, f"program{suffix}", "-o", made, "-lm", "-pthread"], folder)
    return made


def run(made: Path, **environment: str) -> str:
    done = subprocess.run(
        [made], cwd=made.parent, env={**os.environ, **environment}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("option", ["", "THREAD_SAFE", "OFF"])
@pytest.mark.parametrize("standard", ["c99", "c11", "c++11", "c++20"])
def test_the_header_compiles_without_a_warning(standard, option, tmp_path):
    """Included twice, as headers are. Optimised in one standard of each language: what gcc finds by
    following values is the same in all."""
    source = (
        (RECORDERS / "c" / "example.c")
        .read_text("utf-8")
        .replace(
            "#include <stdio.h>",
            '#include "visref_recorder.h"\n#include "visref_cameras.h"\n#include <stdio.h>',
        )
    )
    following = standard in ("c99", "c++20") and option != "OFF"
    flags = ["-O2"] if following else ["-fsyntax-only"]
    flags += [f"-std={standard}", *MORE[: 2 if "+" in standard else 4]]
    flags += [f"-DVISREF_RECORDER_{option}"] if option else []
    if "+" in standard:
        if shutil.which("g++") is None:
            pytest.skip("there is no g++")
        program(tmp_path, source, *flags, compiler="g++", suffix=".cpp")
    else:
        program(tmp_path, source, *flags)


def test_the_example_is_an_engine_in_sixty_lines():
    assert len((RECORDERS / "c" / "example.c").read_text("utf-8").splitlines()) <= 60


def test_off_every_call_is_nothing(tmp_path):
    """No file, no code, and no argument computed."""
    source = """#include "visref_recorder.h"
#include <stdio.h>
static int asked = 0;
static int next_frame(void) { return asked++; }
static const char *name(void) { asked++; return "a"; }
int main(void) {
    char problem[80] = "untouched";
    visref_recorder *r = (asked++, visref_open("recording.jsonl", 64, 48));
    visref_begin_frame(r, 3);
    visref_visible_name(r, NULL, "a");
    visref_end_frame(r);
    printf("%d %d %s\\n", visref_close(r, problem, sizeof problem), asked, problem);
    r = visref_open(name(), next_frame(), 1);
    visref_visible_name(r, NULL, name());
    return 0;
}
"""
    for flags in (["-O0"], ["-O2"]):
        made = program(tmp_path, source, "-std=c99", "-DVISREF_RECORDER_OFF", *flags)
        assert run(made) == "0 1 untouched\n"
        assert not (tmp_path / "recording.jsonl").exists()
    # With the optimiser, nothing at all is left of it.
    assert b"visref" not in made.read_bytes()
    with pytest.raises(AssertionError, match="undefined reference"):
        program(tmp_path, source, "-std=c99")


def test_a_comma_of_the_locale_spoils_no_number(tmp_path):
    (tmp_path / "source").write_text(
        "comment_char %\nescape_char /\n"
        'LC_NUMERIC\ndecimal_point ","\nthousands_sep "."\ngrouping 3;3\nEND LC_NUMERIC\n'
    )
    command = ["localedef", "-c", "-i", "source", "./comma"]
    subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
    source = (
        IMPLEMENTATION
        + """#include <locale.h>
int main(void) {
    const double m[16] = {1.5, 0, 0, 1e-7, 0, 1, 0, 12345678.25, 0, 0, 1, -0.125, 0, 0, 0, 1};
    const float f[16] = {0.1f, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    visref_recorder *r;
    if (!setlocale(LC_NUMERIC, "comma")) return 77;
    printf("%.1f\\n", 0.5);
    r = visref_open("recording.jsonl", 64, 48);
    visref_begin_frame(r, 0);
    visref_camera(r, NULL, VISREF_WORLD_FROM_CAMERA, VISREF_ROW_MAJOR, m);
    visref_pose_f(r, "a", VISREF_ROW_MAJOR, f);
    visref_end_frame(r);
    return visref_close(r, NULL, 0);
}
"""
    )
    made = program(tmp_path, source, "-std=c99")
    assert run(made, LOCPATH=str(tmp_path)) == "0,5\n"
    (_, line) = strict_lines((tmp_path / "recording.jsonl").read_bytes())
    assert line["world_from_camera"][:3] == [
        [1.5, 0, 0, 1e-7],
        [0, 1, 0, 12345678.25],
        [0, 0, 1, -0.125],
    ]
    assert line["world_from_object"]["a"][0][0] == 0.100000001


@pytest.mark.parametrize("compiler", ["gcc", "g++"])
def test_threads_may_fill_one_frame(compiler, tmp_path):
    if shutil.which(compiler) is None:
        pytest.skip(f"there is no {compiler}")
    source = (
        IMPLEMENTATION
        + """#include <pthread.h>
enum { THREADS = 4, OBJECTS = 2000 };
static visref_recorder *r;
static void *cull(void *first) {
    int i, id = *(const int *)first;
    char name[32];
    for (i = 0; i < OBJECTS; i++, id += THREADS) {
        const double least[3] = {(double)id, 0, 0}, greatest[3] = {(double)id, 1, 1};
        snprintf(name, sizeof name, "%d", id);
        visref_visible_ids(r, id % 2 ? "left" : "right", &id, 1);
        visref_bounds(r, name, least, greatest);
    }
    return NULL;
}
int main(void) {
    const double m[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    int i, k, first[THREADS];
    pthread_t threads[THREADS];
    r = visref_open("recording.jsonl", 64, 48);
    for (k = 0; k < 3; k++) {
        visref_begin_frame(r, k);
        visref_camera(r, NULL, VISREF_WORLD_FROM_CAMERA, VISREF_ROW_MAJOR, m);
        for (i = 0; i < THREADS; i++) {
            first[i] = i;
            pthread_create(&threads[i], NULL, cull, &first[i]);
        }
        for (i = 0; i < THREADS; i++) pthread_join(threads[i], NULL);
        visref_end_frame(r);
    }
    return visref_close(r, NULL, 0);
}
"""
    )
    suffix = ".cpp" if compiler == "g++" else ".c"
    flags = ["-DVISREF_RECORDER_THREAD_SAFE", "-O2"]
    run(program(tmp_path, source, *flags, compiler=compiler, suffix=suffix))
    (_, *frames) = strict_lines((tmp_path / "recording.jsonl").read_bytes())
    assert len(frames) == 3
    for frame in frames:
        assert sorted(frame["visible"]["left"]) == list(range(1, 8000, 2))
        assert sorted(frame["visible"]["right"]) == list(range(0, 8000, 2))
        assert frame["bounds"] == {str(i): [[i, 0, 0], [i, 1, 1]] for i in range(8000)}


def test_a_frame_that_is_no_longer_than_those_before_takes_no_memory(tmp_path):
    source = (
        """#include <stdio.h>
#include <stdlib.h>
static int taken = 0;
static void *counted(void *at, size_t size) { taken++; return realloc(at, size); }
#define realloc counted
#define malloc(size) counted(NULL, size)
"""
        + IMPLEMENTATION
        + """
int main(void) {
    const double m[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    int k, i;
    visref_recorder *r = visref_open("recording.jsonl", 64, 48);
    for (k = 0; k < 100; k++) {
        visref_begin_frame(r, k);
        visref_camera(r, "left", VISREF_WORLD_FROM_CAMERA, VISREF_ROW_MAJOR, m);
        for (i = 0; i < 1000 - k; i++) {
            visref_visible_name(r, "left", "an object");
            visref_pose(r, "an object", VISREF_ROW_MAJOR, m);
        }
        visref_end_frame(r);
        if (k == 0) { printf("%d ", taken > 0); taken = 0; }
    }
    printf("%d\\n", taken);
    return visref_close(r, NULL, 0);
}
"""
    )
    # The numbers of frames become longer by a digit; the room that was taken has some to spare.
    assert run(program(tmp_path, source, "-std=c99")) == "1 0\n"


BAD_UTF_8 = (
    b"\xff", b"a\x80", b"\xc3", b"\xc0\xaf", b"\xe0\x80\xaf", b"\xed\xa0\x80",
    b"\xf0\x80\x80\x80", b"\xf4\x90\x80\x80", b"\xf5",
)  # fmt: skip
GOOD_UTF_8 = (
    "\x7f",
    "\x80",
    "\u07ff",
    "\u0800",
    "\ud7ff",
    "\ue000",
    "\uffff",
    "\U00010000",
    "\U0010ffff",
)


def test_names_that_are_no_utf_8_are_told_and_all_others_written(tmp_path):
    names = [*BAD_UTF_8, *(name.encode() for name in GOOD_UTF_8)]
    listed = ", ".join('"' + "".join(f"\\{byte:03o}" for byte in name) + '"' for name in names)
    source = (
        IMPLEMENTATION
        + f"""
int main(void) {{
    const char *const names[] = {{{listed}, NULL}};
    const double m[16] = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}};
    char file[32], problem[200];
    int i;
    for (i = 0; i < {len(names) + 1}; i++) {{
        visref_recorder *r;
        snprintf(file, sizeof file, "%d.jsonl", i);
        r = visref_open(file, 64, 48);
        visref_begin_frame(r, 0);
        visref_camera(r, NULL, VISREF_WORLD_FROM_CAMERA, VISREF_ROW_MAJOR, m);
        visref_visible_name(r, NULL, names[i]);
        visref_end_frame(r);
        printf("%s\\n", visref_close(r, problem, sizeof problem) ? "problem" : "ok");
    }}
    return 0;
}}
"""
    )
    told = run(program(tmp_path, source, "-std=c99")).split()
    assert told == ["problem"] * len(BAD_UTF_8) + ["ok"] * len(GOOD_UTF_8) + ["problem"]
    for number, name in enumerate(GOOD_UTF_8, len(BAD_UTF_8)):
        (_, line) = strict_lines((tmp_path / f"{number}.jsonl").read_bytes())
        assert line["visible"] == [name]
    for number, name in enumerate(BAD_UTF_8):
        assert not strict_utf_8(name)
        # Told in the recording too, with a mark for each byte that belongs to no character.
        (_, line) = strict_lines((tmp_path / f"{number}.jsonl").read_bytes())
        (start, marks) = line["stopped"].split("UTF-8: ")
        assert start == "frame 0: a name is no "
        assert marks.lstrip("a") == "\ufffd" * len(name.lstrip(b"a"))


def strict_utf_8(raw: bytes) -> bool:
    """The oracle: Python's own decoder."""
    try:
        raw.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True


def test_no_recorder_at_all_is_told(tmp_path):
    """As where memory is out: the calls do nothing, and closing says it."""
    source = (
        IMPLEMENTATION
        + """
int main(void) {
    char problem[9];
    visref_begin_frame(NULL, 1);
    visref_flush(NULL);
    printf("%d %s\\n", visref_close(NULL, problem, sizeof problem), problem);
    return 0;
}
"""
    )
    assert run(program(tmp_path, source, "-std=c99")) == "1 out of m\n"
