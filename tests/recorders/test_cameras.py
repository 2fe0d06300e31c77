"""Cameras of engines with other axes: what the engine sees to the right, above and ahead of its
camera, the converted camera sees there too. The conversions share no code with `conventions`."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Sequence

import numpy as np
import pytest

from tests.recorders.calls import strict_lines
from tests.recorders.conventions import (
    CLOSE,
    CLOSE_FLOAT,
    LENSES,
    POINTS,
    POSES,
    check_left_handed,
    check_lens,
    check_y_down,
    check_yfov,
    from_axes,
    in_unreal,
    lens_matrix,
    lines_of,
    look_at_lh,
    negated,
    seen,
    unreal,
    y_down,
)
from tests.recorders.languages.base import RECORDERS, compiled
from tests.recorders.languages.c import STRICT
from tests.recorders.languages.rust import build_rust_library

# C, Rust, C#: the same conversions.

C_MAIN = r"""#include <stdio.h>
#include "visref_cameras.h"
static void told(const double m[16]) {
    int i;
    for (i = 0; i < 16; i++) printf("%s%.17g", i ? "," : "[", m[i]);
    printf("]\n");
}
int main(void) {
    double out[16];
CALLS
    printf("[%.17g]\n", visref_yfov_from_xfov(1.5707963267948966, 1600, 900));
    return 0;
}
"""


def c_array(values: Sequence[float]) -> str:
    return f"{{{', '.join(repr(float(x)) for x in values)}}}"


@pytest.mark.needs("gcc")
def test_c_converts_unreal_left_handed_and_y_down_cameras(tmp_path):
    calls = []
    for pitch, yaw, eye in POSES:
        values = [eye, *unreal(pitch, yaw), look_at_lh(eye, pitch, yaw)[0].flat]
        down = y_down(eye, pitch, yaw)[0]
        values += [down.T.flat, down.flat]
        names = "abcdefg"
        arrays = "".join(
            f"const double {n}[] = {c_array(list(v))}; "
            for n, v in zip(names, values, strict=False)
        )
        calls.append(
            f"{{ {arrays} visref_from_unreal(out, a, b, c, d); told(out);"
            " visref_from_left_handed(out, e, 0); told(out);"
            " visref_from_left_handed(out, e, 2); told(out);"
            " visref_from_y_down(out, f, 0); told(out); visref_from_y_down(out, g, 1); told(out); }"
        )
    (tmp_path / "main.c").write_text(C_MAIN.replace("CALLS", "\n".join(calls)))
    compiled(["gcc", "-std=c99", *STRICT, "main.c", "-o", "main", "-lm"], tmp_path)
    told = lines_of(
        subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout
    )
    assert len(told) == 5 * len(POSES) + 1
    for number, (pitch, yaw, eye) in enumerate(POSES):
        of_unreal, x, z, by_columns, by_rows = told[5 * number : 5 * number + 5]
        forward, right, up = unreal(pitch, yaw)
        engine = from_axes(in_unreal(POINTS), eye, right, up, forward) / 100
        assert np.allclose(
            seen({"world_from_camera": np.reshape(of_unreal, (4, 4))}, POINTS), engine, **CLOSE
        )
        check_left_handed(x, z, eye, pitch, yaw)
        check_y_down(by_columns, eye, pitch, yaw)
        assert np.array_equal(np.reshape(by_rows, (4, 4)).T, np.reshape(by_columns, (4, 4)))
    check_yfov(told[-1][0])


def test_an_unreal_camera_that_looks_along_x_from_a_known_place():
    """By hand: 1, 2 and 3 metres along Unreal's axes is (1, 3, 2); its right is the scene's +z."""
    forward, right, up = unreal(0, 0)
    assert (forward, right) == ([1, 0, 0], [0, 1, 0])
    assert np.allclose(
        from_axes(in_unreal(np.array([[5.0, 3.0, 2.0]])), (100, 200, 300), right, up, forward),
        [[0, 0, 400]],
    )


@pytest.mark.needs("rustc")
def test_rust_converts_left_handed_and_y_down_cameras(tmp_path):
    lines = ["use visref_recorder::*;", "fn main() {"]
    for pitch, yaw, eye in POSES:
        lh = list(map(float, look_at_lh(eye, pitch, yaw)[0].flat))
        down = list(map(float, y_down(eye, pitch, yaw)[0].T.flat))
        lines += [f'println!("{{:?}}", from_left_handed(&{lh}, {axis}));' for axis in (0, 2)]
        lines.append(f'println!("{{:?}}", from_y_down(&{down}));')
    lines += ['println!("[{:?}]", yfov_from_xfov(std::f64::consts::FRAC_PI_2, 1600, 900));', "}"]
    (tmp_path / "main.rs").write_text("\n".join(lines))
    library = build_rust_library(tmp_path)
    compiled(
        ["rustc", "--edition", "2021", "--extern", f"visref_recorder={library}", "main.rs"],
        tmp_path,
    )
    told = lines_of(
        subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout
    )
    for number, (pitch, yaw, eye) in enumerate(POSES):
        x, z, down = told[3 * number : 3 * number + 3]
        check_left_handed(x, z, eye, pitch, yaw)
        check_y_down(down, eye, pitch, yaw)
    check_yfov(told[-1][0])


# What is needed of Unity: its matrices are column by column when indexed with one number.
UNITY = """namespace UnityEngine {
    public struct Matrix4x4 {
        public float[] m;
        public float this[int i] { get { return m[i]; } }
        public float this[int row, int column] { get { return m[row + 4 * column]; } }
    }
    public class Camera {
        public Matrix4x4 worldToCameraMatrix, projectionMatrix;
        public float nearClipPlane, farClipPlane;
        public bool orthographic;
    }
}
"""


def test_the_lenses_of_these_tests_have_a_shift_as_the_samples_definition_has_it():
    """Pixel (x, y) has the ray F + (2(x + shift_x) + 1 - w) R + (h - 2(y + shift_y) - 1) U, R and
    U of length tan(yfov / 2) / h; the matrix must map it to the middle of that pixel."""
    for kind, size, (sx, sy) in LENSES:
        for x, y in ((0, 0), (63, 47), (20, 31)):
            s = (math.tan(size / 2) if kind == "yfov" else size) / 48
            across, up = (2 * (x + sx) + 1 - 64) * s, (48 - 2 * (y + sy) - 1) * s
            depth = 7.0 if kind == "yfov" else 1.0
            clip = lens_matrix(kind, size, (sx, sy)) @ (across * depth, up * depth, -depth, 1)
            assert np.allclose(
                clip[:2] / clip[3], ((2 * x + 1) / 64 - 1, 1 - (2 * y + 1) / 48), **CLOSE
            )


@pytest.mark.needs("mcs", "mono")
def test_csharp_takes_unity_s_cameras_and_objects_as_they_are(tmp_path):
    """Unity is left-handed and yaw turns from +Z to +X; its view matrix is of OpenGL's kind."""
    lines = [
        "using System;",
        "static class Program {",
        "static float[] F(params double[] m) { return Array.ConvertAll(m, x => (float)x); }",
    ]
    lines += ["static void Main() {", 'var r = new VisrefRecorder("unity.jsonl", 64, 48);']
    poses, views = [], []
    for number, (pitch, yaw, eye) in enumerate(POSES):
        view, axes = look_at_lh(eye, pitch, yaw)
        views.append((eye, axes))
        poses.append(np.linalg.inv(view.T))
        looks_back = np.diag([1, 1, -1, 1]) @ view.T
        kind, size, shift = LENSES[number]
        matrices = [looks_back, lens_matrix(kind, size, shift), poses[-1]]
        m = [
            "new UnityEngine.Matrix4x4 { m = F("
            + ", ".join(repr(float(x)) for x in one.T.flat)
            + ") }"
            for one in matrices
        ]
        lines.append(
            f"r.BeginFrame({number}); r.Camera(new UnityEngine.Camera {{"
            f" worldToCameraMatrix = {m[0]}, projectionMatrix = {m[1]}, nearClipPlane = 0.1f,"
            f" farClipPlane = 100, orthographic = {str(kind == 'ymag').lower()} }});"
            f' r.Pose("a", {m[2]}); r.EndFrame();'
        )
    for pitch, yaw, eye in POSES:
        values = ", ".join(repr(float(x)) for x in look_at_lh(eye, pitch, yaw)[0].flat)
        for axis in (0, 2):
            made = f"VisrefRecorder.FromLeftHanded(new double[] {{ {values} }}, {axis})"
            lines.append(
                f'Console.WriteLine("[" + string.Join(",", Array.ConvertAll({made},'
                ' x => x.ToString("G17"))) + "]");'
            )
    lines.append("r.Close(); } }")
    (tmp_path / "Program.cs").write_text("\n".join(lines))
    (tmp_path / "Unity.cs").write_text(UNITY)
    sources = [RECORDERS / "csharp" / "VisrefRecorder.cs", RECORDERS / "csharp" / "VisrefUnity.cs"]
    compiled(
        ["mcs", "-warnaserror", "-out:program.exe", *sources, "Program.cs", "Unity.cs"], tmp_path
    )
    ran = subprocess.run(
        ["mono", "program.exe"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    frames = strict_lines((tmp_path / "unity.jsonl").read_bytes())[1:]
    for line, (eye, axes), pose, lens in zip(frames, views, poses, LENSES, strict=False):
        engine = from_axes(negated(POINTS, 0), eye, *axes)
        assert np.allclose(seen(line, POINTS), engine, **CLOSE_FLOAT)
        check_lens(line, *lens, tolerance=1e-6)
        assert (line["near"], line["far"]) == (pytest.approx(0.1, rel=1e-7), 100)
        # A point of the mesh, whose x the importer has negated too.
        moved = np.c_[negated(POINTS, 0), np.ones(20)] @ pose.T
        told = np.c_[POINTS, np.ones(20)] @ np.array(line["world_from_object"]["a"]).T
        assert np.allclose(negated(told[:, :3], 0), moved[:, :3], **CLOSE_FLOAT)
    told = lines_of(ran.stdout)
    for number, (pitch, yaw, eye) in enumerate(POSES):
        check_left_handed(told[2 * number], told[2 * number + 1], eye, pitch, yaw)


# Python


@pytest.fixture
def recorder(monkeypatch):
    monkeypatch.syspath_prepend(str(RECORDERS / "python"))
    import visref_recorder

    yield visref_recorder
    sys.modules.pop("visref_recorder")


def z_up(points: np.ndarray) -> np.ndarray:
    """A scene in glTF, as Blender and Panda3D have read it: (x, -z, y)."""
    return np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)


@pytest.mark.parametrize(("pitch", "yaw", "eye"), POSES)
def test_python_converts_blender_panda3d_and_opencv_cameras(recorder, pitch, yaw, eye):
    # Heading and pitch in a world with Z up: at rest it looks along +Y.
    forward = [-math.sin(yaw) * math.cos(pitch), math.cos(yaw) * math.cos(pitch), math.sin(pitch)]
    right = [math.cos(yaw), math.sin(yaw), 0.0]
    up = list(np.cross(right, forward))
    engine = from_axes(z_up(POINTS), eye, right, up, forward)
    # Blender: columns, and a camera looks down its own -Z with +Y up.
    blender = np.eye(4)
    blender[:3] = np.stack([right, up, -np.array(forward), eye], axis=1)
    assert np.allclose(seen(dict([recorder.from_blender(blender)]), POINTS), engine, **CLOSE)
    # Panda3D: rows, and a camera looks along its own +Y with +Z up.
    panda = np.eye(4)
    panda[:, :3] = right, forward, up, eye
    assert np.allclose(seen(dict([recorder.from_panda3d(panda)]), POINTS), engine, **CLOSE)
    view, axes = y_down(eye, pitch, yaw)
    opencv = dict([recorder.from_opencv(view[:3, :3], view[:3, 3])])
    assert np.allclose(seen(opencv, POINTS), from_axes(POINTS, eye, *axes), **CLOSE)
    check_yfov(recorder.yfov_from_xfov(math.pi / 2, 1600, 900))


def test_a_blender_camera_as_blender_puts_it_by_hand(recorder):
    """At (7, -6, 5), turned by nothing, it looks straight down; in glTF that is at (7, 5, 6)."""
    matrix = np.eye(4)
    matrix[:3, 3] = 7, -6, 5
    ahead = seen(
        dict([recorder.from_blender(matrix)]), np.array([[7.0, 0.0, 6.0], [8.0, 0.0, 6.0]])
    )
    assert np.allclose(ahead, [[0, 0, 5], [1, 0, 5]])
