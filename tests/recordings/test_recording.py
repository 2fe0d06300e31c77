"""One-file recordings: the header, frames by their numbers, what was drawn, and where they end."""

from __future__ import annotations

import json
import math
import time
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from tests.support.gltf_files import TRIANGLE, Gltf
from tests.support.hand_made import scene_of_squares
from visref import path_frame
from visref.camera import Camera, look_at
from visref.cli.main import main
from visref.errors import InputError
from visref.findings import Code
from visref.formats import load_scene
from visref.inputs import picked_frames
from visref.recordings import read_recording
from visref.scene import Group, Scene

POSE = look_at((0.0, 0.0, 3.0), (0.0, 0.0, -5.0)).tolist()
HEADER = {
    "format": "visref-recording", "version": 1,
    "width": 8, "height": 6, "near": 0.1, "far": None, "yfov": 1.0,
}  # fmt: skip
# Three squares, one behind the other, at z -1, -2 and -3.
SCENE = scene_of_squares(-1.0, -2.0, -3.0)


def line(frame: int, visible=(), **fields):
    return {"frame": frame, "world_from_camera": POSE, "visible": list(visible), **fields}


def write(folder, *lines, end="\n"):
    file = folder / "run.jsonl"
    file.write_text("\n".join(one if isinstance(one, str) else json.dumps(one) for one in lines)
                    + end)  # fmt: skip
    return file


def read(folder, *lines, scene: Scene = SCENE, end="\n"):
    return read_recording(write(folder, *lines, end=end), scene)


def drawn(recording, frame: int, view: str = "") -> list[int]:
    """The objects of which a triangle was drawn."""
    sets = recording.sets
    triangles = sets.units.gather(sets.sets[frame][view])
    return np.unique(recording.scene.object_of_triangle[triangles]).tolist()


def test_a_frame_has_its_number_its_camera_and_what_was_drawn(tmp_path):
    recording = read(tmp_path, HEADER, line(0, [2, 0]), line(1, ["square0", 1], near=0.5))
    assert recording.path.numbers == range(2)
    near, nearer = (recording.path.views(frame)[0] for frame in (0, 1))
    expected = Camera(np.array(POSE), 8, 6, near=0.1, yfov=1.0)
    assert near.definition() == expected.definition()
    assert nearer.definition() == replace(expected, near=0.5).definition()
    assert drawn(recording, 0) == [0, 2]


def test_frames_that_are_left_out_stay_left_out(tmp_path):
    recording = read(tmp_path, {**HEADER, "fps": 10}, line(3), line(7, [1]), line(1000, [2]))
    assert list(recording.path.numbers) == [3, 7, 1000]
    # Time is that of the frame's number.
    assert [frame.time_s for frame in recording.path.frames] == [0.3, 0.7, 100.0]
    assert [drawn(recording, frame) for frame in (3, 7, 1000)] == [[], [1], [2]]


def test_records_of_a_run_go_by_the_recordings_numbers(tmp_path, capsys):
    scene = files_scene(tmp_path)
    file = write(tmp_path, HEADER, line(4, [0]), line(9, []), line(10, []))
    out = tmp_path / "out"
    assert main(["check", scene, "--recording", str(file), "--out", str(out)]) == 1
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["path"]["numbers"] == [4, 9, 10]
    verdict = json.loads((out / "verdict.json").read_text())
    (culler,) = verdict["cullers"].values()
    assert (culler["frames"], culler["missed"], culler["worst"]["frame"]) == (3, 2, 9)
    assert main(["report", str(out), "--out", str(tmp_path / "page.html")]) == 1
    assert main(["explain", str(out), "--frame", "9", "--object", "sail"]) == 0
    # After frames that were not judged all is in view by right; in frame 10 it has been for one.
    assert culler["ages"] == {}
    assert main(["check", scene, "--recording", str(file), "--frames", "4:5",
                 "--out", str(out)]) == 0  # fmt: skip
    assert main(["check", scene, "--recording", str(file), "--frames", "5:9",
                 "--out", str(out)]) == 2  # fmt: skip
    assert "picks none of the path's 3 frames" in capsys.readouterr().err


def files_scene(folder) -> str:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh(gltf.primitive(TRIANGLE - np.float32([0.3, 0.3, 0]))), name="sail")
    file = folder / "scene.glb"
    file.write_bytes(gltf.glb())
    return str(file)


def test_wherever_a_recording_is_cut_off_its_whole_frames_are_judged_or_it_is_one_line(tmp_path):
    lines = [{**HEADER, "groups": {"gü": [0, 1]}}, line(0, ["gü"]), line(3, [2])]
    text = "".join(json.dumps(one, ensure_ascii=False) + "\r\n" for one in lines)
    whole = [len(part.encode()) for part in text.split("\r\n")]
    file = tmp_path / "run.jsonl"
    data = b"\xef\xbb\xbf" + text.encode()
    first = 3 + whole[0] + 2 + whole[1]
    for end in range(len(data) + 1):
        file.write_bytes(data[:end])
        if end < first:
            with pytest.raises(InputError, match=r"\A[^\n]+\Z"):
                read_recording(file, SCENE)
            continue
        recording = read_recording(file, SCENE)
        second = first + 2 + whole[2]
        assert list(recording.path.numbers) == ([0, 3] if end >= second else [0])
        assert bool(recording.path.remarks) == (first + 2 < end < second)


@pytest.mark.parametrize("keep", [1, 20, -3, -1])
def test_a_line_that_is_cut_off_ends_the_recording_and_is_said(tmp_path, keep):
    last = json.dumps(line(2, [1]))[:keep]
    recording = read(tmp_path, HEADER, line(0, [0]), line(1, [1]), last, end="")
    assert list(recording.path.numbers) == [0, 1]
    ((code, text),) = recording.path.remarks
    assert code == Code.RECORDING_CUT_OFF
    assert "line 4 is not whole; the recording is judged up to frame 1" in text


def test_a_recorder_that_stopped_is_judged_up_to_there_and_says_why(tmp_path):
    lines = (HEADER, line(0, [0]), line(1, [1]), {"stopped": "frame 2: a name is NULL\n"})
    recording = read(tmp_path, *lines)
    assert list(recording.path.numbers) == [0, 1]
    ((code, text),) = recording.path.remarks
    assert code == Code.RECORDING_CUT_OFF
    assert "the recorder stopped: frame 2: a name is NULL; the recording is judged up to" in text


def test_a_cut_in_the_middle_of_a_letter_is_one_too(tmp_path):
    file = write(tmp_path, HEADER, line(0, [0]))
    file.write_bytes(file.read_bytes() + '{"frame": 1, "visible": ["ü'.encode()[:-1])
    assert [code for code, _ in read_recording(file, SCENE).path.remarks] == [
        Code.RECORDING_CUT_OFF
    ]


def test_a_whole_last_line_without_its_newline_counts(tmp_path):
    recording = read(tmp_path, HEADER, line(0), line(1, [2]), end="")
    assert len(recording.path) == 2
    assert recording.path.remarks == ()


def test_a_broken_line_that_is_not_the_last_is_an_error(tmp_path):
    for lines in ((HEADER, line(0), '{"frame": 1,', line(2)), (HEADER, line(0), '{"frame": 1,')):
        with pytest.raises(InputError, match="line 3: not valid JSON"):
            read(tmp_path, *lines)


VIEWS = {"left": {"world_from_camera": POSE}, "right": {"world_from_camera": POSE, "width": 3}}


def test_views_have_their_sets(tmp_path):
    frame = {"frame": 0, "views": VIEWS, "visible": {"left": [0], "right": [1, 2]}}
    recording = read(tmp_path, HEADER, frame)
    assert [camera.width for camera in recording.path.views(0)] == [8, 3]
    assert drawn(recording, 0, "left") == [0]
    assert drawn(recording, 0, "right") == [1, 2]


def test_groups_of_the_header_are_names_of_several_objects_and_one_unit(tmp_path):
    header = {**HEADER, "groups": {"pair": [0, SCENE.names[2]]}}
    recording = read(tmp_path, header, line(0, ["pair"]), line(1, ["group:pair", 1]))
    assert drawn(recording, 0) == [0, 2]
    assert recording.sets.units.count == 2
    assert [len(recording.sets.sets[frame][""]) for frame in (0, 1)] == [1, 2]


def scene_of_nodes(folder) -> Scene:
    """Nodes 1 and 2 with one name and 3 with two instances, below node 0, which has no mesh."""
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(TRIANGLE))
    gltf.node(name="root", children=[1, 2, 3])
    for _ in range(2):
        gltf.node(root=False, mesh=mesh, name="leaf")
    places = {"TRANSLATION": gltf.accessor(np.float32([[0, 0, 0], [5, 0, 0]]))}
    instanced = {"EXT_mesh_gpu_instancing": {"attributes": places}}
    gltf.node(root=False, mesh=mesh, name="grass", extensions=instanced)
    return load_scene(gltf.write(folder / "nodes.glb"))


def test_a_node_without_a_mesh_is_none(tmp_path):
    frame = {"frame": 0, "world_from_camera": POSE, "visible_nodes": [1, 0]}
    with pytest.raises(InputError, match="line 2: node 0 has no mesh, or is not in the scene"):
        read(tmp_path, HEADER, frame, scene=scene_of_nodes(tmp_path))


def test_nodes_are_named_by_their_index_and_instances_are_a_group(tmp_path):
    scene = scene_of_nodes(tmp_path)
    assert scene.nodes is not None
    assert scene.nodes.tolist() == [1, 2, 3, 3]
    frames = [
        {"frame": k, "world_from_camera": POSE, "visible_nodes": nodes}
        for k, nodes in enumerate(([2], [1, 3], []))
    ]
    recording = read(tmp_path, HEADER, *frames, scene=scene)
    assert [drawn(recording, frame) for frame in range(3)] == [[1], [0, 2, 3], []]
    assert recording.sets.units.count == 3


BOX = [[0, 0, 0], [1, 1, 1]]
# Lines after the header, and what is said; a first entry that is a dictionary changes the header.
WRONG = {
    "no header": ([{"format": None}, line(0)], "line 1: this is no recording"),
    "nothing in it": ([], "it is empty; record again: the program ended before"),
    "a path": ([{"format": "visref-path"}, line(0)], "this is a camera path; give it as --path"),
    "stopped before the header": (
        [{"format": ..., "stopped": "no disk"}],
        "line 1: the recorder stopped before it wrote anything: no disk",
    ),
    "stopped at once": (
        [{}, {"stopped": "no memory"}],
        "there is no whole frame in it (line 2: the recorder stopped: no memory)",
    ),
    "a frame after the end": (
        [{}, line(0), {"stopped": "x"}, line(1)],
        "line 4: the recorder stopped before it",
    ),
    "another version": ([{"version": 2}, line(0)], "line 1: version: version 2 is not known"),
    "no frame": ([{}], "there is no whole frame in it"),
    "not ascending": ([{}, line(1), line(1)], "line 3: frame 1 comes after frame 1"),
    "below zero": ([{}, line(-1)], "line 2: frame is -1"),
    "too large": ([{}, line(1 << 31)], "line 2: frame is 2147483648"),
    "no camera": ([{}, {"frame": 0, "visible": []}], "line 2: world_from_camera is missing"),
    "nothing drawn is not said": ([{}, {"frame": 0, "world_from_camera": POSE}], "line 2: a line"),
    "both": ([{}, line(0, visible_nodes=[])], "line 2: both visible and visible_nodes"),
    "a node of a scene without nodes": (
        [{}, {"frame": 0, "world_from_camera": POSE, "visible_nodes": [0]}],
        "line 2: the scene's file has no nodes",
    ),
    "a name as a node": (
        [{}, {"frame": 0, "world_from_camera": POSE, "visible_nodes": ["a"]}],
        "line 2: visible_nodes is not a list of node indices",
    ),
    "unknown id": ([{}, line(0, [3])], "line 2: object id 3 is not in the scene (0…2)"),
    "true": ([{}, line(0, [True])], "line 2: visible is not a list of ids and names"),
    "unknown name": ([{}, line(0, ["squid"])], "line 2: the scene has no object named 'squid'"),
    "unknown box": ([{}, line(0, bounds={"squid": BOX})], "no object named 'squid'"),
    "a wrong field": ([{}, line(0, near="x")], "line 2: near: 'x' is not a number"),
    "a view without a set": (
        [{}, {"frame": 0, "views": VIEWS, "visible": {"left": []}}],
        "line 2: frame 0: view 'right' is missing",
    ),
    "group of nobody": ([{"groups": {"g": [7]}}, line(0)], "groups.g: object id 7 is not in"),
    "group of a name": ([{"groups": {"g": ["x"]}}, line(0)], "groups.g: the scene has no object"),
    "empty group": ([{"groups": {"g": []}}, line(0)], "groups: group 'g' is empty"),
    "groups a list": ([{"groups": [1]}, line(0)], "groups: this is not a JSON object"),
    "units above": ([{"units": "../u.csv"}, line(0)], "line 1: units: units is '../u.csv'"),
    "units of the root": ([{"units": "/etc/passwd"}, line(0)], "units is '/etc/passwd'"),
    "units of Windows": ([{"units": "C:\\u.csv"}, line(0)], "line 1: units: units is 'C:"),
    "units a number": ([{"units": 3}, line(0)], "line 1: units: units is 3"),
    "units that no file can be": ([{"units": "\ud800.csv"}, line(0)], "name a file in the"),
    "infinite far": ([{}, line(0, far=math.inf)], "line 2: far: far is inf; write null"),
    "a time beyond float64": ([{"fps": 5e-324}, line(1)], "line 2: time_s: time_s is inf"),
    "milliseconds beyond float64": (
        [{}, line(0, stats={"ms": {"cull": 10**400}})],
        "line 2: stats",
    ),
    "half a group's object": (
        [{"groups": {"g": [0.5]}}, line(0)],
        "groups: group 'g' is not a list",
    ),
    "no units there": ([{"units": "u.csv"}, line(0)], "u.csv: cannot read the file: No such file"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_recording_is_one_line_with_its_place(name, tmp_path):
    given, expected = WRONG[name]
    lines = [{**HEADER, **given[0]}, *given[1:]] if given else []
    # Dots stand for a field that is not there.
    lines = [{k: v for k, v in one.items() if v is not ...} for one in lines]
    file = write(tmp_path, *lines)
    with pytest.raises(InputError) as caught:
        read_recording(file, SCENE)
    message = str(caught.value)
    assert str(tmp_path) in message
    assert expected in message
    assert "\n" not in message


def test_units_behind_a_link_out_of_the_folder_are_refused(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "u.csv").write_text("unit,object,first_triangle,triangle_count\n")
    (tmp_path / "in" / "u.csv").symlink_to(tmp_path / "u.csv")
    file = write(tmp_path / "in", {**HEADER, "units": "u.csv"}, line(0))
    with pytest.raises(InputError, match=r"units is 'u\.csv'"):
        read_recording(file, SCENE)


def test_units_that_are_a_link_to_itself_are_refused(tmp_path):
    (tmp_path / "u.csv").symlink_to("u.csv")
    file = write(tmp_path, {**HEADER, "units": "u.csv"}, line(0))
    with pytest.raises(InputError):
        read_recording(file, SCENE)


def test_groups_that_expand_without_end_are_refused_before_they_do(tmp_path):
    # Some 20 kB of names stand for 1.6 million members.
    count, everything = 2000, tuple(range(2000))
    scene = Scene.from_objects([(f"o{i}", TRIANGLE, [[0, 1, 2]]) for i in range(count)])
    scene = replace(scene, groups=(Group("all", "all", everything),))
    header = {**HEADER, "groups": {f"g{i}": ["all"] for i in range(800)}}
    file = write(tmp_path, header, line(0, ["g7"]))
    tracemalloc.start()
    with pytest.raises(InputError, match=r"run\.jsonl: groups: its groups up to 'g[0-9]+' would"):
        read_recording(file, scene, max_memory=20 << 20)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40 << 20


def test_boxes_of_names_that_mean_nothing_are_refused_where_they_are_many(tmp_path):
    frames = (line(k, bounds={f"{k}-{i}": BOX for i in range(100)}) for k in range(100))
    file = write(tmp_path, HEADER, *frames)
    with pytest.raises(InputError, match=r"line [0-9]+: .* would need about"):
        read_recording(file, SCENE, max_memory=2 << 20)


def test_a_slice_of_frames_that_are_far_apart_takes_no_time(tmp_path):
    recording = read(tmp_path, HEADER, line(0), line(5), line(2**31 - 1))
    started = time.perf_counter()
    assert picked_frames("1:", recording.path) == [5, 2**31 - 1]
    # Two billion numbers that might be frames take minutes.
    assert time.perf_counter() - started < 10.0
    assert picked_frames("::5", recording.path) == [0, 5]
    assert picked_frames("-1", recording.path) == [2**31 - 1]
    with pytest.raises(InputError, match="picks none of the path's 3 frames"):
        picked_frames("1:5", recording.path)


def test_a_field_that_is_not_known_is_compared_with_those_that_are_once(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(
        path_frame, "did_you_mean", lambda *given: asked.append(given) or "did you mean 'near'?"
    )
    recording = read(tmp_path, HEADER, *(line(k, nead=1) for k in range(50)))
    assert len(asked) == 1
    ((_, text),) = recording.path.remarks
    assert text.endswith("passed over; did you mean 'near'? (50 times, first at line 2)")


def test_many_fields_that_are_not_known_hide_no_other_remark(tmp_path):
    rounded = np.round(POSE, 4)
    rounded[0][0] += 3e-5
    many = {f"field{k}": 0 for k in range(100)}
    recording = read(
        tmp_path, HEADER, line(0, **many), {**line(1), "world_from_camera": rounded.tolist()}
    )
    codes = {code for code, _ in recording.path.remarks}
    assert codes == {Code.FIELD_IGNORED, Code.CAMERA_MADE_RIGID}


def test_a_recording_and_a_path_are_one_too_many(tmp_path, capsys):
    file = write(tmp_path, HEADER, line(0, [0]))
    command = ["check", files_scene(tmp_path), "--recording", str(file), "--path", "p.json"]
    assert main([*command, "--out", str(tmp_path / "out")]) == 2
    assert "leave --path out" in capsys.readouterr().err


def test_memory_grows_with_frames_and_not_with_the_names_in_them(tmp_path):
    # A frame names 4,000 objects in some 30 kB; kept, 200 of them would be 50 MB of numbers.
    scene = Scene.from_objects([(f"o{i}", TRIANGLE, [[0, 1, 2]]) for i in range(4000)])
    every = json.dumps(line(0, [f"o{i}" for i in range(4000)]))
    peaks = []
    for frames in (20, 200):
        with (tmp_path / "run.jsonl").open("w") as file:
            file.write(json.dumps(HEADER) + "\n")
            for frame in range(frames):
                file.write(every.replace('"frame": 0', f'"frame": {frame}') + "\n")
        tracemalloc.start()
        recording = read_recording(tmp_path / "run.jsonl", scene)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert len(recording.sets.sets[frames - 1][""]) == 4000
    # A bit per object and frame, and a frame's camera: less than 5 kB.
    assert peaks[1] - peaks[0] < 180 * 5000


def test_a_mark_of_a_text_editor_and_empty_lines_are_passed_over(tmp_path):
    file = write(tmp_path, "", HEADER, "  ", line(0, [1]), "")
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert drawn(read_recording(file, SCENE), 0) == [1]


def test_whole_numbers_may_be_written_with_a_point(tmp_path):
    recording = read(tmp_path, {**HEADER, "width": 8.0}, line(1.0, [2.0, 0]))
    assert list(recording.path.numbers) == [1]
    assert drawn(recording, 1) == [0, 2]
    with pytest.raises(InputError, match="visible is not a list of ids and names"):
        read(tmp_path, HEADER, line(0, [0.5]))
    header = {**HEADER, "groups": {"pair": [0.0, 2]}}
    stats = {"draw_calls": 3.0}
    recording = read(tmp_path, header, line(0, ["pair"], stats=stats))
    assert drawn(recording, 0) == [0, 2]
    assert recording.sets.stats[0].draw_calls == 3
    with pytest.raises(InputError, match=r"0\.5 is no level"):
        read(tmp_path, HEADER, line(0, levels={"tree": 0.5}))
    assert read(tmp_path, HEADER, line(0, levels={"tree": 1.0})).path.frames[0].levels == {
        "tree": 1
    }


def test_a_name_of_several_objects_is_their_groups_whatever_other_groups_there_are(tmp_path):
    scene = Scene.from_objects([("crate", TRIANGLE, [[0, 1, 2]])] * 3)
    header = {**HEADER, "groups": {"crate": [0, 1, 2], "batch": [2]}}
    recording = read(tmp_path, header, line(0, ["crate"]), line(1, ["batch"]), scene=scene)
    assert drawn(recording, 0) == [0, 1, 2]
    assert drawn(recording, 1) == [2]
    with pytest.raises(InputError, match="ambiguous is 'crate'"):
        read(tmp_path, HEADER, line(0, ["crate"]), scene=scene)


def test_a_views_own_form_brings_back_the_lens_that_its_frames_clip_matrix_made_void(tmp_path):
    clip = Camera(np.array(POSE), 8, 6, near=0.1, far=50.0, yfov=0.5).clip_from_world().tolist()
    views = {"a": {"eye": [0, 0, 3], "target": [0, 0, 0]}, "b": {}}
    frame = {"frame": 0, "clip_from_world": clip, "views": views, "visible": []}
    path = read(tmp_path, HEADER, frame).path
    assert path.views(0)[0].yfov == 1.0
    assert path.views(0)[1].yfov == pytest.approx(0.5)


def test_a_view_may_be_without_its_frames_clip_plane(tmp_path):
    views = {"a": {"clip_plane": None, "world_from_camera": POSE}, "b": {"world_from_camera": POSE}}
    frame = {"frame": 0, "clip_plane": [0, 1, 0, 0], "views": views, "visible": []}
    path = read(tmp_path, HEADER, frame).path
    assert [camera.clip_plane for camera in path.views(0)] == [None, (0.0, 1.0, 0.0, 0.0)]


def test_units_do_not_hang_on_which_group_was_named_first(tmp_path):
    header = {**HEADER, "groups": {"far": [1, 2], "near": [0, 1]}}
    units = [
        read(tmp_path, header, *(line(k, [name]) for k, name in enumerate(order))).sets.units
        for order in (("far", "near"), ("near", "far"))
    ]
    assert units[0].triangles.tolist() == units[1].triangles.tolist()
    assert SCENE.object_of_triangle[units[0].triangles[::2]].tolist() == [0, 1, 1, 2]


def test_what_has_a_box_of_its_own_is_a_unit_beside_its_group(tmp_path):
    header = {**HEADER, "groups": {"pair": [0, 1]}}
    boxed = line(0, ["pair"], bounds={"square1": BOX})
    sets = read(tmp_path, header, boxed).sets
    # The square and the one that is in no group, and then the pair.
    units = [sets.units.gather(np.int32([unit])) for unit in range(sets.units.count)]
    assert [np.unique(SCENE.object_of_triangle[unit]).tolist() for unit in units] == [
        [1],
        [2],
        [0, 1],
    ]
    assert sets.boxes[0][0].tolist() == BOX


@pytest.mark.parametrize("name", ["crates", "yard/crates"])
def test_a_groups_name_is_neither_the_name_nor_the_path_of_one_that_the_scene_has(tmp_path, name):
    scene = replace(SCENE, groups=(Group("crates", "yard/crates", (0, 1)),))
    with pytest.raises(InputError, match=r"the scene has a group '.*' of its own"):
        read(tmp_path, {**HEADER, "groups": {name: [2]}}, line(0), scene=scene)
