"""JavaScript's and Godot's cameras, as their engines have them."""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.recorders.calls import strict_lines
from tests.recorders.conventions import (
    CLOSE,
    CLOSE_FLOAT,
    LENSES,
    POINTS,
    POSES,
    check_lens,
    from_axes,
    lens_matrix,
    look_at_lh,
    negated,
    orthographic,
    projection,
    seen,
    y_down,
)
from tests.recorders.languages.base import RECORDERS
from tests.recorders.languages.godot import godot_project, run_godot

# JavaScript

RECORDER = json.dumps(str(RECORDERS / "javascript" / "visref_recorder.js"))
JS_MAIN = """const { Recorder } = require(%s);
const r = new Recorder("js.jsonl", %d, %d);
%s
r.close();
"""


def javascript(
    tmp_path: Path, lines: Sequence[str], width: int = 64, height: int = 48
) -> list[dict]:
    (tmp_path / "main.cjs").write_text(JS_MAIN % (RECORDER, width, height, "\n".join(lines)))
    subprocess.run(["node", "main.cjs"], cwd=tmp_path, check=True)
    return strict_lines((tmp_path / "js.jsonl").read_bytes())[1:]


@pytest.mark.needs("node")
def test_javascript_takes_three_js_cameras_as_they_are(tmp_path):
    """Its matrices are column by column, with glTF's axes and OpenGL's projections."""
    lines, views = [], []
    for number, lens in enumerate(LENSES):
        pitch, yaw, eye = POSES[number % len(POSES)]
        view, axes = y_down(eye, pitch, yaw)
        views.append((eye, axes))
        world = np.linalg.inv(np.diag([1, -1, -1, 1]) @ view)
        camera = {
            "matrixWorld": {"elements": list(world.T.flat)},
            "projectionMatrix": {"elements": list(lens_matrix(*lens).T.flat)},
            "near": 0.1,
            "far": 100,
        }
        lines.append(f"r.beginFrame({number}); r.threeCamera({json.dumps(camera)}); r.endFrame();")
    for line, (eye, axes), lens in zip(javascript(tmp_path, lines), views, LENSES, strict=True):
        assert np.allclose(seen(line, POINTS), from_axes(POINTS, eye, *axes), **CLOSE)
        check_lens(line, *lens, tolerance=1e-13)
        assert (line["near"], line["far"]) == (0.1, 100)


def three_camera(projected: np.ndarray) -> str:
    return json.dumps({
        "matrixWorld": {"elements": list(np.eye(4).flat)},
        "projectionMatrix": {"elements": list(projected.T.flat)},
        "near": 0.1,
        "far": 100,
    })  # fmt: skip


def of_aspect(aspect: float, lens: str, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """A projection of this aspect, whatever its size in pixels, with its window moved by such parts
    of its height."""
    made = projection if lens == "yfov" else orthographic
    return made(aspect, 1.0, 0.9 if lens == "yfov" else 2.5, shift)  # type: ignore[arg-type]


@pytest.mark.needs("node")
def test_javascript_tells_an_aspect_that_is_not_the_view_s(tmp_path):
    """By hand, of 1707 by 821: a size that is a pixel off both ways, 1706 by 822, has the aspect
    2.07543, and 1708 by 820 has 2.08293."""
    wrong = {
        1.0: "1",
        2.06915: "2.06915",
        1706 / 822 - 1e-5: "2.07542",
        1708 / 820 + 1e-5: "2.08294",
    }
    program = f"const {{ Recorder }} = require({RECORDER});"
    for aspect in wrong:
        camera = three_camera(of_aspect(aspect, "yfov"))
        program += (
            "{ const r = new Recorder(null, 1707, 821); r.beginFrame(0);"
            f"r.threeCamera({camera});"
            "try { r.close(); } catch (e) { console.log(e.message); } }"
        )
    (tmp_path / "main.cjs").write_text(program)
    done = subprocess.run(
        ["node", "main.cjs"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == [
        f"frame 0: the camera's aspect is {told}, but the view is 1707x821 (2.07917): "
        "set camera.aspect = canvas.width / canvas.height before rendering, or give Recorder "
        "the size that the aspect was made of"
        for told in wrong.values()
    ]


# Of 1366 by 657 at 1.25 device pixels, a canvas has 1707 by 821; and the farthest roundings.
ROUNDED = (1366 / 657, 1707 / 821, 1707.5 / 821.25, 1706 / 822 + 1e-12, 1708 / 820 - 1e-12)


@pytest.mark.needs("node")
@pytest.mark.parametrize("lens", ["yfov", "ymag"])
def test_a_rounded_aspect_is_recorded_within_what_the_camera_saw(lens, tmp_path):
    """Both ways no edge of the recorded view lies beyond the camera's, in one direction they agree,
    and the other differs by (aspect + 1) / 2 pixels at most."""
    width, height, shift = 1707, 821, (0.125, -0.25)
    cameras = [three_camera(of_aspect(aspect, lens, shift)) for aspect in ROUNDED]
    lines = [
        f"r.beginFrame({number}); r.threeCamera({camera}); r.endFrame();"
        for number, camera in enumerate(cameras)
    ]
    for line, aspect in zip(javascript(tmp_path, lines, width, height), ROUNDED, strict=True):
        half = math.tan(line[lens] / 2) if lens == "yfov" else line[lens]
        its = math.tan(0.9 / 2) if lens == "yfov" else 2.5
        per_pixel = 2 * half / height
        centre = np.array([line["shift_x_px"], line["shift_y_px"]]) * per_pixel
        recorded = np.array([half * width / height, half])
        seen_by_it = np.array([its * aspect, its])
        # Of the same centre, so that it is within where it is no larger; some 20 roundings, and in
        # pixels of 821, or 1707, as many of 2e-13 each.
        assert np.allclose(centre, np.array(shift) * 2 * its, rtol=1e-14)
        assert (recorded <= seen_by_it * (1 + 1e-14)).all()
        lost = np.sort((seen_by_it - recorded) / per_pixel)
        assert abs(lost[0]) < 1e-9
        assert lost[1] <= (aspect + 1) / 2 + 1e-9
        assert (lost[1] > 1e-3) == (aspect != width / height)


@pytest.mark.needs("node")
@pytest.mark.parametrize("right_handed", [False, True])
def test_javascript_takes_babylon_js_cameras_as_they_are(right_handed, tmp_path):
    """Row vectors in rows. A left-handed scene looks along +Z, its projection too, and its glTF
    loader negates x; maxZ 0 is an endless far plane."""
    lines, views = [], []
    for number, lens in enumerate(LENSES[:3]):
        pitch, yaw, eye = POSES[number]
        if right_handed:
            view, axes = y_down(eye, pitch, yaw)
            memory = list((np.diag([1, -1, -1, 1]) @ view).T.flat)
        else:
            view, axes = look_at_lh(eye, pitch, yaw)
            memory = list(view.flat)
        clip = lens_matrix(*lens)
        if not right_handed:
            clip = clip @ np.diag([1, 1, -1, 1])
        views.append((eye, axes))
        made = (
            f"{{ getScene: () => ({{ useRightHandedSystem: {json.dumps(right_handed)} }}),"
            f" minZ: 0.1, maxZ: 0,"
            f" getViewMatrix: () => ({{ m: {json.dumps(memory)} }}),"
            f" getProjectionMatrix: () => ({{ m: {json.dumps(list(clip.T.flat))} }}) }}"
        )
        lines.append(f"r.beginFrame({number}); r.babylonCamera({made}); r.endFrame();")
    for line, (eye, axes), lens in zip(javascript(tmp_path, lines), views, LENSES[:3], strict=True):
        world = POINTS if right_handed else negated(POINTS, 0)
        assert np.allclose(seen(line, POINTS), from_axes(world, eye, *axes), **CLOSE)
        check_lens(line, *lens, tolerance=1e-13)
        assert (line["near"], line["far"]) == (0.1, None)


@pytest.mark.needs("node")
def test_a_path_flown_in_left_handed_babylon_js_as_documented_is_recorded_as_it_was(tmp_path):
    """Of any roll. Babylon.js looks from a position at a target as Direct3D's LookAtLH does."""
    lines, flown = [], []
    clip = lens_matrix(*LENSES[0]) @ np.diag([1, 1, -1, 1])
    for number, (pitch, yaw, eye) in enumerate(POSES):
        right, up, forward = y_down(eye, pitch, yaw)[1]
        roll = 0.7 * number
        m = np.eye(4)
        m[:3, 0] = math.cos(roll) * right + math.sin(roll) * up
        m[:3, 1] = math.cos(roll) * up - math.sin(roll) * right
        m[:3, 2], m[:3, 3] = -forward, eye
        flown.append(m)
        # As docs/recorders.md says.
        up, back, eye = (m[:3, i] * (-1, 1, 1) for i in (1, 2, 3))
        target = eye - back
        z = (target - eye) / np.linalg.norm(target - eye)
        x = np.cross(up, z) / np.linalg.norm(np.cross(up, z))
        view = np.eye(4)
        view[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
        view[3, :3] = -eye @ view[:3, :3]
        made = (
            "{ getScene: () => ({}), minZ: 0.1, maxZ: 9,"
            f" getViewMatrix: () => ({{ m: {json.dumps(list(view.flat))} }}),"
            f" getProjectionMatrix: () => ({{ m: {json.dumps(list(clip.T.flat))} }}) }}"
        )
        lines.append(f"r.beginFrame({number}); r.babylonCamera({made}); r.endFrame();")
    for line, m in zip(javascript(tmp_path, lines), flown, strict=True):
        assert np.allclose(np.array(line["camera_from_world"]) @ m, np.eye(4), **CLOSE)


# Godot

GODOT_MAIN = """extends SceneTree
const Recorder = preload("res://visref_recorder.gd")

func _init() -> void:
	get_root().size = Vector2(64, 48)
	var r = Recorder.new("godot.jsonl", 64, 48)
	var camera := Camera3D.new()
	get_root().add_child(camera)
	camera.current = true
%s
	r.close()
	quit()
"""


@pytest.mark.needs("godot4|godot3-server")
def test_gdscript_takes_godot_s_cameras_as_they_are(tmp_path):
    """Rows of a Transform3D; and a field of view, a size or an offset of either side."""
    body, expected = [], []
    lower = 2 * math.atan(math.tan(math.radians(25)) * 48 / 64)
    moved = {"size": 1.0, "frustum_offset": (0.25, -0.125)}
    settings = (
        ("PERSPECTIVE", "KEEP_HEIGHT", {"fov": 50.0}, ("yfov", math.radians(50), (0.0, 0.0))),
        ("PERSPECTIVE", "KEEP_WIDTH", {"fov": 50.0}, ("yfov", lower, (0.0, 0.0))),
        ("ORTHOGONAL", "KEEP_HEIGHT", {"size": 6.0}, ("ymag", 3.0, (0.0, 0.0))),
        ("ORTHOGONAL", "KEEP_WIDTH", {"size": 8.0}, ("ymag", 3.0, (0.0, 0.0))),
        # At the near plane, half a unit away, the view is one high: 48 pixels to the unit.
        ("FRUSTUM", "KEEP_HEIGHT", moved, ("yfov", math.pi / 2, (12.0, 6.0))),
    )  # fmt: skip
    for number, (kind, keep, values, lens) in enumerate(settings):
        pitch, yaw, eye = POSES[number % len(POSES)]
        _, axes = y_down(eye, pitch, yaw)
        expected.append((eye, axes, lens))
        right, up, forward = axes
        vectors = [
            f"Vector3({x!r}, {y!r}, {z!r})"
            for x, y, z in (map(float, v) for v in (right, up, -forward, eye))
        ]
        body += [
            f"camera.projection = Camera3D.PROJECTION_{kind}",
            f"camera.keep_aspect = Camera3D.{keep}",
        ]
        body += [
            f"camera.transform = Transform3D({', '.join(vectors)})",
            "camera.near = 0.5",
            "camera.far = 100.0",
        ]
        body += [
            f"camera.{name} = {f'Vector2{v}' if isinstance(v, tuple) else v}"
            for name, v in values.items()
        ]
        body += [
            f"r.begin_frame({number})",
            "r.camera_3d(camera)",
            'r.pose("a", r.VisrefText.rows_of(camera.transform))',
            "r.end_frame()",
        ]
    godot_project(tmp_path, {"program.gd": GODOT_MAIN % "\n".join("\t" + line for line in body)})
    run_godot(tmp_path)
    frames = strict_lines((tmp_path / "godot.jsonl").read_bytes())[1:]
    assert len(frames) == len(settings)
    for line, (eye, axes, lens) in zip(frames, expected, strict=True):
        assert np.allclose(seen(line, POINTS), from_axes(POINTS, eye, *axes), **CLOSE_FLOAT)
        assert np.allclose(line["world_from_object"]["a"], line["world_from_camera"], **CLOSE_FLOAT)
        check_lens(line, *lens, tolerance=1e-6)
        assert (line["near"], line["far"]) == (0.5, 100)
