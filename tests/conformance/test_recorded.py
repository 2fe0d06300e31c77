"""One-file recordings of the suite: judged by the case's own path, and refused where they are of
another."""

from __future__ import annotations

import copy
import json
import re

import numpy as np
import pytest

from visref.conformance.contest import rows_of_files, run_rows
from visref.conformance.declared import Declared
from visref.conformance.files import UNITS, _expected_of, written_cases
from visref.conformance.recorded import read_recordings
from visref.conformance.suite import Status
from visref.culler import Promise
from visref.errors import InputError

CASES = {case.name: case for case in written_cases()}
EVERYTHING = Declared()
HALVES = "half_of_a_wall_of_two_clusters"


def lines_of(case):
    """What an engine writes that draws what is visible: its header and its frames."""
    path = case.path.to_json()
    header = {k: v for k, v in path.items() if k != "frames"} | {"format": "visref-recording"}
    if case.units is not None:
        header["units"] = f"{case.name}.{UNITS}"
    frames = [{"frame": k, **frame} for k, frame in enumerate(path["frames"])]
    for row in _expected_of(case):
        drawn = [*row["visible"], *row["perhaps"]] if case.units is None else row["visible_units"]
        if "view" in row:
            frames[row["frame"]].setdefault("visible", {})[row["view"]] = drawn
        else:
            frames[row["frame"]]["visible"] = drawn
    return header, frames


def write(folder, case, header, frames):
    if case.units is not None:
        (folder / f"{case.name}.{UNITS}").write_bytes(case.files[UNITS])
    text = "".join(f"{json.dumps(line)}\n" for line in (header, *frames))
    file = folder / f"{case.name}.jsonl"
    file.write_text(text)
    return file


def judged(folder, *names, declared=EVERYTHING, promise=Promise.EXACT):
    cases = [CASES[name] for name in names]
    entrant = read_recordings(folder, cases, declared, promise=promise)
    return list(run_rows(rows_of_files(entrant, cases, declared), declared))


def one_of(folder, name, **more):
    (one,) = judged(folder, name, **more)
    return one.result


def test_recordings_of_what_is_visible_pass_every_case_as_exact(tmp_path):
    for case in CASES.values():
        write(tmp_path, case, *lines_of(case))
    ended = judged(tmp_path, *CASES)
    assert {
        one.row.name: one.first for one in ended if one.result.status is not Status.PASSED
    } == {}
    assert len(ended) == len(CASES)


def test_cameras_and_matrices_rounded_to_float32_are_those_of_the_case(tmp_path):
    def rounded(value):
        if isinstance(value, float):
            return float(np.float32(value))
        if isinstance(value, list):
            return [rounded(one) for one in value]
        if isinstance(value, dict):
            return {name: rounded(one) for name, one in value.items()}
        return value

    for case in CASES.values():
        header, frames = lines_of(case)
        write(tmp_path, case, rounded(header), rounded(frames))
    ended = judged(tmp_path, *CASES)
    assert {one.result.status for one in ended} == {Status.PASSED}


def test_objects_may_be_told_by_their_node_in_the_file(tmp_path):
    """For engines that rename what they load; an instanced node is all its instances."""
    names = ("crowd", "two_eyes", "instances_of_one_draw")
    for name in names:
        case = CASES[name]
        header, frames = lines_of(case)
        of_name = dict(zip(case.scene.names, case.scene.nodes.tolist(), strict=True))
        for frame in frames:
            drawn = frame.pop("visible")
            if isinstance(drawn, dict):
                nodes = {view: [of_name[one] for one in listed] for view, listed in drawn.items()}
            else:
                nodes = sorted({of_name[one] for one in drawn})
            frame["visible_nodes"] = nodes
        write(tmp_path, case, header, frames)
    ended = judged(tmp_path, *names, promise=Promise.CONSERVATIVE)
    assert {one.result.status for one in ended} == {Status.PASSED}
    header, frames = lines_of(CASES["crowd"])
    frames[0].pop("visible")
    frames[0]["visible_nodes"] = []
    write(tmp_path, CASES["crowd"], header, frames)
    ended = judged(tmp_path, *names, promise=Promise.CONSERVATIVE)
    failed = [one.row.name for one in ended if one.result.status is Status.FAILED]
    assert failed == ["crowd"]


def test_one_cluster_left_out_fails_though_its_object_shows(tmp_path):
    case = CASES[HALVES]
    header, frames = lines_of(case)
    assert [frame["visible"] for frame in frames] == [[1, 2], [0, 2], [0, 1, 2]]
    # In the last frame both halves show a strip; the other one is drawn.
    frames[2]["visible"] = [1, 2]
    write(tmp_path, case, header, frames)
    result = one_of(tmp_path, HALVES)
    assert result.status is Status.FAILED
    lost, owned = map(
        int, re.search(r"lost (\d+) of its (\d+) samples", result.problems[0]).groups()
    )
    assert result.problems[0].startswith("MISSED_OBJECT: frame 2 (64 x 48): 'wall' (object 0)")
    assert 0 < lost < owned


def test_an_engine_may_have_clusters_of_its_own(tmp_path):
    """Single triangles, of which those with a sample are drawn."""
    case = CASES["overlapping_clusters"]
    header, frames = lines_of(case)
    header["units"] = "mine.csv"
    rows = [
        f"{t},{owner},{t - int(case.scene.object_offsets[owner])},1"
        for t, owner in enumerate(case.scene.object_of_triangle.tolist())
    ]
    columns = "unit,object,first_triangle,triangle_count"
    (tmp_path / "mine.csv").write_text("\n".join([columns, *rows]) + "\n")
    for frame, truth in zip(frames, case.truths, strict=True):
        owners = np.union1d(truth.buffer.triangle, truth.ties.triangle)
        frame["visible"] = owners[owners >= 0].tolist()
    write(tmp_path, case, header, frames)
    (tmp_path / f"{case.name}.{UNITS}").unlink()
    assert one_of(tmp_path, case.name).status is Status.PASSED
    frames[0]["visible"].pop(3)
    write(tmp_path, case, header, frames)
    (tmp_path / f"{case.name}.{UNITS}").unlink()
    assert one_of(tmp_path, case.name).status is Status.FAILED


def test_only_units_files_that_are_named_may_stand_there(tmp_path):
    case = CASES[HALVES]
    header, frames = lines_of(case)
    write(tmp_path, case, header, frames)
    del header["units"]
    (tmp_path / f"{case.name}.jsonl").write_text(
        "".join(f"{json.dumps(line)}\n" for line in (header, *frames))
    )
    with pytest.raises(InputError, match=rf"{HALVES}.{UNITS}: it is of no case of the suite"):
        judged(tmp_path, HALVES)


def test_units_files_may_stand_in_a_folder_of_their_own(tmp_path):
    case = CASES[HALVES]
    header, frames = lines_of(case)
    header["units"] = f"units/{HALVES}.csv"
    write(tmp_path, case, header, frames)
    (tmp_path / "units").mkdir()
    (tmp_path / f"{HALVES}.{UNITS}").rename(tmp_path / "units" / f"{HALVES}.csv")
    assert one_of(tmp_path, HALVES).status is Status.PASSED


def test_recording_that_is_cut_off_fails_and_says_so(tmp_path):
    for name in ("crowd", "slivers"):
        write(tmp_path, CASES[name], *lines_of(CASES[name]))
    file = tmp_path / "crowd.jsonl"
    file.write_text(file.read_text()[:-20])
    ended = judged(tmp_path, "crowd", "slivers")
    assert [one.result.status for one in ended] == [Status.FAILED, Status.PASSED]
    assert re.match(r"RECORDING_CUT_OFF: .*crowd.jsonl: line 4 is not whole", ended[0].first)


def test_recording_without_some_frames_fails(tmp_path):
    header, frames = lines_of(CASES["crowd"])
    write(tmp_path, CASES["crowd"], header, [frames[0], frames[2]])
    result = one_of(tmp_path, "crowd")
    assert result.problems == ("its recording has 2 of 3 frames; 1 is missing",)


def test_recording_of_what_the_engine_is_not_made_for_is_not_even_read(tmp_path):
    write(tmp_path, CASES["crowd"], *lines_of(CASES["crowd"]))
    (tmp_path / "two_eyes.jsonl").write_text("nonsense")
    ended = judged(tmp_path, "crowd", "two_eyes", declared=Declared(frozenset()))
    assert [one.result.status for one in ended] == [Status.PASSED, Status.SKIPPED]


def moved(frames):
    frames[1]["world_from_camera"][0][3] += 0.01


def turned(frames):
    matrix = np.array(frames[1]["world_from_camera"])
    c, s = np.cos(1e-3), np.sin(1e-3)
    matrix[:3, :3] = matrix[:3, :3] @ [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
    frames[1]["world_from_camera"] = matrix.tolist()


OTHERS = {
    "the image's size": ("crowd", lambda f: f[0].update(width=65), "frame 0: .* the image's size"),
    "the projection": ("crowd", lambda f: f[1].update(ymag=3.0), "frame 1: .* the projection of"),
    "the position": ("crowd", moved, "frame 1: .* the position of the camera is another"),
    "the direction": ("crowd", turned, "frame 1: .* the direction of the camera is another"),
    "the field of view": (
        "crowd",
        lambda f: f[2].update(yfov=1.01),
        "frame 2: .*the field of view",
    ),
    "the height": (
        "close_by_in_an_orthographic_view",
        lambda f: f[0].update(ymag=9.1),
        "frame 0: .*the field of view",
    ),
    "the lens shift": (
        "lens_shift_and_zoom",
        lambda f: f[0].update(shift_x_px=7.5),
        "frame 0: .*the lens shift of the camera is another",
    ),
    "a view's name": (
        "two_eyes",
        lambda f: (
            f[1]["views"].update(middle=f[1]["views"].pop("left"))
            or f[1]["visible"].update(middle=f[1]["visible"].pop("left"))
        ),
        "frame 1: .* its views are 'right', 'middle', and the path's 'left', 'right'",
    ),
    "views exchanged": (
        "two_eyes",
        lambda f: f[1]["views"].update(left=f[1]["views"]["right"], right=f[1]["views"]["left"]),
        "frame 1: .*the position of the camera of view 'left' is another",
    ),
    "a frame more": (
        "crowd",
        lambda f: f.append(copy.deepcopy(f[2]) | {"frame": 3}),
        "frame 3: .* the path has frames 0…2",
    ),
    "another absence": (
        "appearing_and_vanishing",
        lambda f: f[0].update(absent=["blind 0", "ground"]),
        "frame 0: .* 'ground' is absent",
    ),
    "another place": (
        "sliding_door",
        lambda f: f[3]["world_from_object"]["door"][0].__setitem__(3, 2.3),
        "frame 3: .* 'door' stands elsewhere",
    ),
    "another time": (
        "bending_reeds",
        lambda f: f[2].update(time_s=2.5),
        "frame 2: .* time is 2.5 s",
    ),
}


@pytest.mark.parametrize("what", OTHERS)
def test_recording_of_another_case_is_refused(tmp_path, what):
    name, change, told = OTHERS[what]
    header, frames = copy.deepcopy(lines_of(CASES[name]))
    for frame in frames:
        # Each frame says all of its camera.
        for key in ("width", "yfov", "ymag"):
            if key in header:
                frame.setdefault(key, header[key])
    write(tmp_path, CASES[name], header, frames)
    assert one_of(tmp_path, name).status is Status.PASSED
    change(frames)
    if what == "the projection":
        del frames[1]["yfov"]
    write(tmp_path, CASES[name], header, frames)
    with pytest.raises(InputError, match=told) as raised:
        judged(tmp_path, name)
    assert "it was not recorded along the path" in str(raised.value)
    assert str(tmp_path / f"{name}.jsonl") in str(raised.value)


def test_a_recording_that_says_less_of_poses_is_judged_by_the_case(tmp_path):
    """An engine that moved the door need not say so again."""
    case = CASES["sliding_door"]
    header, frames = lines_of(case)
    for frame in frames:
        del frame["world_from_object"]
    write(tmp_path, case, header, frames)
    assert one_of(tmp_path, case.name).status is Status.PASSED


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"format": "visref-recording", "version": 1, "wid', "the header is not whole"),
        ('{"format": "visref-recording", "version": 2}\n', "version 2 is not known"),
        ('{"format": "visref-recording", "version": 1}\n{"frame": 0}\n', "line 2"),
        (
            '{"format": "visref-recording", "version": 1, "units": "../x.csv"}\n',
            "units is '../x.csv'",
        ),
        ('{"format": "visref-recording", "version": 1, "units": 3}\n', "units is 3"),
    ],
)
def test_what_is_no_recording_is_refused(tmp_path, text, told):
    (tmp_path / "crowd.jsonl").write_text(text)
    with pytest.raises(InputError, match=told) as raised:
        judged(tmp_path, "crowd")
    assert "crowd.jsonl" in str(raised.value)
