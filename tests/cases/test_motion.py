"""Recordings of what moves, or has levels of detail, on scenes that public bug reports are like.

A pixel is a tenth of a unit, so that what a rectangle covers is a product of two numbers.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.cases.files import add_rectangle, check_rows, rectangle, write_path
from tests.formats.test_gltf_animation import animate
from tests.support.gltf_files import TWO, Gltf

pytestmark = pytest.mark.slow

VIEW = 96 * 72


@pytest.fixture(params=["embree", "exact"])
def engine(request):
    return request.param


def drawn(*frames):
    """The rows of a recording: the names that are drawn in each frame."""
    return [{"visible": list(names)} for names in frames]


# A figure of two joints that walks out of its bind pose's box and grows: 10 to the right and half
# a unit taller per second. The camera follows it for three frames, and then looks back.

BIND_BOX = [[-0.4, -1.0, -5.0], [0.4, 1.0, -5.0]]
AT_REST, AFTER_1_S, AFTER_2_S = 8 * 20, 8 * 25, 8 * 30
CAMERA_X = (0.0, 10.0, 20.0, 0.0)
BOTH, HILL = ("figure", "hill"), ("hill",)
WALKING = drawn(BOTH, BOTH, BOTH, HILL)
BY_THE_BIND_BOX = drawn(BOTH, HILL, HILL, HILL)


def walk(folder, **path):
    gltf = Gltf()
    head = gltf.node(root=False, name="head", translation=[0, 1, 0])
    hip = gltf.node(name="hip", children=[head])
    bind = np.stack([np.eye(4, dtype="f4")] * 2)
    bind[1, 1, 3] = -1.0
    matrices = gltf.accessor(bind.transpose(0, 2, 1).reshape(-1, 16))
    skin = gltf.entry("skins", joints=[hip, head], inverseBindMatrices=matrices)
    body = gltf.primitive(rectangle(-0.4, -1.0, 0.4, 1.0, -5.0), TWO)
    # The lower corners hang on the hip, the upper ones on the head.
    joints, weights = np.zeros((4, 4), "u1"), np.zeros((4, 4), "f4")
    joints[2:, 0], weights[:, 0] = 1, 1.0
    body["attributes"] |= {"JOINTS_0": gltf.accessor(joints), "WEIGHTS_0": gltf.accessor(weights)}
    gltf.node(mesh=gltf.mesh(body), skin=skin, name="figure")
    animate(gltf, hip, "translation", [0, 2], [[0, 0, 0], [20.0, 0, 0]])
    animate(gltf, head, "translation", [0, 2], [[0, 1, 0], [0, 2.0, 0]])
    add_rectangle(gltf, "hill", -10.0, -5.0, 30.0, 5.0, -8.0)
    poses = np.stack([np.eye(4)] * len(CAMERA_X))
    poses[:, 0, 3] = CAMERA_X
    write_path(folder, *poses, **path)
    return gltf.write(folder / "scene.glb")


def test_skinned_figure_that_left_its_bind_box_is_visible_where_it_stands(tmp_path, engine):
    judged = check_rows(walk(tmp_path, fps=1), *WALKING, engine=engine)
    assert (judged.status, judged.lost) == (0, (0, 0, 0, 0))
    assert (judged.sums["visible"], judged.sums["superfluous"]) == (7, 0)
    assert judged.sums["owned_samples"] == 4 * VIEW


def test_figure_culled_by_its_bind_box_is_missed_where_it_stands(tmp_path, engine):
    judged = check_rows(walk(tmp_path, fps=1), *BY_THE_BIND_BOX, engine=engine)
    assert judged.status == 1
    assert judged.lost == (0, AFTER_1_S, AFTER_2_S, 0)
    worst = judged.sums["worst"]
    assert (worst["object_name"], worst["frame"], worst["pixels"]) == ("figure", 2, AFTER_2_S)
    assert ("MISSED_OBJECT", "figure", 2) in judged.findings


def test_bind_box_in_a_recording_is_found_too_small_though_nothing_is_missed(tmp_path, engine):
    scene = walk(tmp_path, fps=1)
    rows = [{**row, "bounds": {"figure": BIND_BOX}} for row in WALKING]
    judged = check_rows(scene, *rows, engine=engine)
    assert (judged.status, judged.lost) == (0, (0, 0, 0, 0))
    found = [one for one in judged.findings if one[0] == "BOUNDS_TOO_SMALL"]
    assert found == [("BOUNDS_TOO_SMALL", "figure", 2)]
    moved = [[(10.0 * s, 0, 0), (10.0 * s, 0.5 * s, 0)] for s in (0, 1, 2, 2)]
    rows = [
        {**row, "bounds": {"figure": (np.array(BIND_BOX) + by).tolist()}}
        for row, by in zip(WALKING, moved, strict=True)
    ]
    judged = check_rows(scene, *rows, engine=engine)
    assert judged.status == 0
    assert not [one for one in judged.findings if one[0] == "BOUNDS_TOO_SMALL"]


def test_path_without_time_is_refused_in_one_line_that_names_both_ways_out(
    tmp_path, engine, capsys
):
    assert check_rows(walk(tmp_path), *WALKING, engine=engine).status == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "'fps'" in line
    assert "--rest-pose" in line
    assert not list(tmp_path.glob("run*/verdict.json"))


@pytest.mark.parametrize("path", [{}, {"fps": 1}])
def test_rest_pose_judges_the_figure_where_it_was_bound(tmp_path, engine, path):
    scene = walk(tmp_path, **path)
    at_rest = drawn(BOTH, HILL, HILL, BOTH)
    judged = check_rows(scene, *at_rest, engine=engine, more=["--rest-pose"])
    assert (judged.status, judged.sums["visible"]) == (0, 6)
    judged = check_rows(scene, *WALKING, engine=engine, more=["--rest-pose"])
    assert (judged.status, judged.lost) == (1, (0, 0, 0, AT_REST))
    assert judged.sums["superfluous"] == 2


# A door turns on its hinge towards the eye, by a sixth of a turn per second. Its image is half as
# wide after one second; after two it lies before the wall beside the doorway.

LAMP = 12 * 10
OPENING = ("left", "right", "door")


def doorway(folder):
    gltf = Gltf()
    add_rectangle(gltf, "left", -4.8, -3.6, -1.0, 3.6, -4.0)
    add_rectangle(gltf, "right", 1.0, -3.6, 4.8, 3.6, -4.0)
    door = add_rectangle(gltf, "door", 0.0, -3.6, 2.0, 3.6, 0.0)
    gltf.json["nodes"][door]["translation"] = [-1, 0, -4]
    angle = np.pi / 3  # half of the turn to the last key
    open_wide = [0, -np.sin(angle), 0, np.cos(angle)]
    animate(gltf, door, "rotation", [0, 2], [[0, 0, 0, 1.0], open_wide])
    add_rectangle(gltf, "lamp", -0.6, -0.5, 0.6, 0.5, -8.0)
    write_path(folder, *[np.eye(4)] * 3, fps=1)
    return gltf.write(folder / "scene.glb")


def test_lamp_behind_a_door_is_hidden_until_the_door_opens(tmp_path, engine):
    open_door = (*OPENING, "lamp")
    judged = check_rows(doorway(tmp_path), *drawn(OPENING, open_door, open_door), engine=engine)
    assert (judged.status, judged.lost) == (0, (0, 0, 0))
    assert (judged.sums["visible"], judged.sums["superfluous"]) == (11, 0)
    # All of the image; then half of the doorway and half of the lamp; then the walls and the lamp.
    walls = 2 * 38 * 72
    assert judged.sums["owned_samples"] == VIEW + walls + 10 * 72 + LAMP // 2 + walls + LAMP


def test_lamp_kept_hidden_behind_the_doors_old_place_loses_what_the_door_uncovers(tmp_path, engine):
    judged = check_rows(doorway(tmp_path), *drawn(*[OPENING] * 3), engine=engine)
    assert (judged.status, judged.lost) == (1, (0, LAMP // 2, LAMP))
    worst = judged.sums["worst"]
    assert (worst["object_name"], worst["frame"]) == ("lamp", 2)
    assert judged.sums["missed"] == 2


# An oak near and far, before the sky. The far one is smaller, so the samples tell which is there.

NEAR, FAR = 20 * 40, 16 * 30
NEAR_SIDES, FAR_SIDES = (-1.0, -2.0, 1.0, 2.0, -5.0), (-0.8, -1.5, 0.8, 1.5, -5.0)


def levelled(folder):
    """Levels by MSFT_lod: the far one in the first frame, the near one in the second."""
    gltf = Gltf()
    far = gltf.node(
        root=False, mesh=gltf.mesh(gltf.primitive(rectangle(*FAR_SIDES), TWO)), name="oak far"
    )
    oak = add_rectangle(gltf, "oak", *NEAR_SIDES)
    gltf.json["nodes"][oak]["extensions"] = {"MSFT_lod": {"ids": [far]}}
    gltf.json["extensionsUsed"] = ["MSFT_lod"]
    add_rectangle(gltf, "sky", -4.8, -3.6, 4.8, 3.6, -9.0)
    write_path(folder, each=[{"levels": {"oak": 1}}, {"levels": {"oak": 0}}])
    return gltf.write(folder / "scene.glb")


def test_levels_own_name_and_its_groups_name_draw_the_level_that_is_there(tmp_path, engine):
    scene = levelled(tmp_path)
    for first in ("oak far", "oak", "group:oak"):
        judged = check_rows(scene, *drawn((first, "sky"), ("oak", "sky")), engine=engine)
        assert (judged.status, judged.lost) == (0, (0, 0))
        assert (judged.sums["visible"], judged.sums["superfluous"]) == (4, 0)
        assert judged.sums["owned_samples"] == 2 * VIEW
        assert not [one for one in judged.findings if one[0] == "ABSENT_NAMED"]


def test_oak_left_out_loses_the_samples_of_the_level_that_is_there(tmp_path, engine):
    judged = check_rows(levelled(tmp_path), *drawn(("sky",), ("sky",)), engine=engine)
    assert (judged.status, judged.lost) == (1, (FAR, NEAR))


def test_level_that_is_not_there_named_alone_draws_nothing(tmp_path, engine):
    judged = check_rows(
        levelled(tmp_path), *drawn(("oak far", "sky"), ("oak far", "sky")), engine=engine
    )
    assert (judged.status, judged.lost) == (1, (0, NEAR))
    worst = judged.sums["worst"]
    assert (worst["object_name"], worst["frame"]) == ("oak", 1)
    assert ("ABSENT_NAMED", "oak far", 1) in judged.findings
    assert (judged.sums["drawn"], judged.sums["superfluous"]) == (3, 0)


def siblings(folder):
    """The same as siblings without an extension; the path says which is absent."""
    gltf = Gltf()
    add_rectangle(gltf, "oak near", *NEAR_SIDES)
    add_rectangle(gltf, "oak far", *FAR_SIDES)
    add_rectangle(gltf, "sky", -4.8, -3.6, 4.8, 3.6, -9.0)
    children = gltf.json["scenes"][0]["nodes"][:2]
    oak = gltf.node(name="oak", children=children)
    gltf.json["scenes"][0]["nodes"] = [oak, 2]
    write_path(folder, each=[{"absent": ["oak near"]}, {"absent": ["oak far"]}])
    return gltf.write(folder / "scene.glb")


def test_sibling_that_the_path_has_absent_neither_hides_nor_is_missed(tmp_path, engine):
    scene = siblings(tmp_path)
    judged = check_rows(scene, *drawn(("oak far", "sky"), ("oak near", "sky")), engine=engine)
    assert (judged.status, judged.lost, judged.sums["superfluous"]) == (0, (0, 0), 0)
    assert (judged.sums["visible"], judged.sums["owned_samples"]) == (4, 2 * VIEW)


def test_absent_sibling_named_alone_is_ignored_and_the_one_that_is_there_is_missed(
    tmp_path, engine
):
    scene = siblings(tmp_path)
    judged = check_rows(scene, *drawn(("oak near", "sky"), ("oak near", "sky")), engine=engine)
    assert (judged.status, judged.lost) == (1, (FAR, 0))
    assert judged.sums["worst"]["object_name"] == "oak far"
    assert ("ABSENT_NAMED", "oak near", 0) in judged.findings
    both = drawn(*[("oak near", "oak far", "sky")] * 2)
    judged = check_rows(scene, *both, engine=engine)
    assert (judged.status, judged.sums["drawn"], judged.sums["superfluous"]) == (0, 4, 0)
