"""A scene over time: each frame's scene is what a file of that moment would give."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from visref.camera import Camera
from visref.camera_path import CameraPath, Frame
from visref.errors import InputError
from visref.formats import load_scene
from visref.scene import Group, Scene
from visref.timeline import Timeline

CAMERA = Camera(np.eye(4), 16, 12, 0.1, yfov=1.0)
BOX = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
FACES = np.array([(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5)])


def scene() -> Scene:
    """Three objects of eight vertices; the last two are a group."""
    made = Scene.from_objects([(name, BOX + 5.0 * i, FACES) for i, name in enumerate("abc")])
    return replace(made, groups=(Group("bc", "bc", (1, 2)),))


def levels() -> Scene:
    """The same, and the group's two objects are levels of detail."""
    return replace(scene(), groups=(Group("bc", "bc", (1, 2), ((1,), (2,))),))


def timeline(*frames: Frame | Camera, of: Scene | None = None, **more) -> Timeline:
    return Timeline(scene() if of is None else of, CameraPath(frames, "p.json"), **more)


def shift(x: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def corners(made: Scene, index: int) -> np.ndarray:
    part = slice(*made.object_offsets[index : index + 2])
    return made.vertices[made.triangles[part]]


def test_where_nothing_moves_every_frame_is_the_still_scene():
    found = timeline(CAMERA, CAMERA)
    assert not found.moves
    assert found.at(0) is found.at(1) is found.still
    assert found.still.moving is None
    assert found.still.digest == scene().digest


def test_an_object_stands_where_its_matrix_puts_it_and_others_as_they_were():
    turn = np.array([(0, -1, 0, 2), (1, 0, 0, 0), (0, 0, 1, 0.25), (0, 0, 0, 1.0)])
    found = timeline(CAMERA, Frame((CAMERA,), world_from_object={"b": turn}))
    still, posed = found.at(0), found.at(1)
    assert found.still.moving.tolist() == [False, True, False]
    for index in (0, 2):
        np.testing.assert_array_equal(corners(posed, index), corners(still, index))
    # Of a scene without a rig, an object's own space is the world.
    x, y, z = np.moveaxis(corners(still, 1).astype(float), -1, 0)
    np.testing.assert_array_equal(corners(posed, 1), np.stack([2 - y, x, z + 0.25], axis=-1))
    assert found.changed(1).tolist() == [False, True, False]
    assert not found.changed(0).any()


def test_a_group_s_matrix_comes_before_what_each_member_has():
    found = timeline(Frame((CAMERA,), world_from_object={"bc": shift(1.0, 2.0, 3.0)}))
    for index in (1, 2):
        moved = corners(scene(), index) + np.array([1.0, 2.0, 3.0], np.float32)
        np.testing.assert_array_equal(corners(found.at(0), index), moved)
    np.testing.assert_array_equal(corners(found.at(0), 0), corners(scene(), 0))


def test_each_frame_stands_alone_and_equal_frames_are_one_scene():
    moved = Frame((CAMERA,), world_from_object={"a": shift(1.0)})
    found = timeline(moved, moved, CAMERA, moved)
    first = found.at(0)
    assert found.at(1) is first
    assert found.at(2) is not first
    np.testing.assert_array_equal(found.at(2).vertices, scene().vertices)
    np.testing.assert_array_equal(found.at(3).vertices, first.vertices)
    assert [bool(found.changed(i).any()) for i in range(4)] == [False, False, True, True]


def test_what_is_absent_has_no_triangle_and_no_box_and_comes_back_whole():
    found = timeline(Frame((CAMERA,), absent=("a", "group:bc")), Frame((CAMERA,), absent=("b",)))
    gone, back = found.at(0), found.at(1)
    assert gone.absent.tolist() == [True, True, True]
    assert not gone.present.any()
    assert (gone.object_bounds[:, 0] > gone.object_bounds[:, 1]).all()
    assert back.absent.tolist() == [False, True, False]
    np.testing.assert_array_equal(corners(back, 0), corners(scene(), 0))
    np.testing.assert_array_equal(back.object_bounds[2], scene().object_bounds[2])


def test_one_level_is_there():
    frames = (*(Frame((CAMERA,), levels={"bc": level}) for level in (0, 1)), CAMERA)
    found = timeline(*frames, of=levels())
    assert found.at(0).absent.tolist() == [False, False, True]
    assert found.at(1).absent.tolist() == [False, True, False]
    # The finest, where a frame does not say.
    assert found.at(2).absent.tolist() == [False, False, True]


def test_a_pose_that_mirrors_turns_the_winding():
    mirrored = np.diag([-1.0, 1.0, 1.0, 1.0])
    found = timeline(CAMERA, Frame((CAMERA,), world_from_object={"a": mirrored}))

    def normals(made: Scene) -> np.ndarray:
        p, q, r = np.moveaxis(corners(made, 0).astype(float), 1, 0)
        return np.cross(q - p, r - p)

    wanted = normals(found.at(0)) * np.array([-1.0, 1.0, 1.0])
    # A mirror image's front is the mirrored front.
    np.testing.assert_allclose(normals(found.at(1)), wanted)


def test_far_out_a_pose_is_rounded_about_the_scene_s_origin():
    origin = np.array([2.0**40, 0.0, 0.0])
    far = replace(scene(), origin=origin)
    found = timeline(Frame((CAMERA,), world_from_object={"a": shift(2.0**-10)}), of=far)
    moved = corners(scene(), 0).astype(float) + np.array([2.0**-10, 0.0, 0.0])
    np.testing.assert_array_equal(corners(found.at(0), 0), moved.astype(np.float32))


def test_a_read_file_poses_by_its_mesh_and_not_by_its_place(tmp_path):
    """`world_from_object` is an object's place: it replaces the node's own."""
    (tmp_path / "s.obj").write_text("o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    loaded = load_scene(tmp_path / "s.obj")
    assert loaded.rig is not None
    found = timeline(Frame((CAMERA,), world_from_object={"a": shift(0.0, 0.0, 4.0)}), of=loaded)
    assert found.still.rig is None
    assert corners(found.at(0), 0)[0].tolist() == [[0, 0, 4], [1, 0, 4], [0, 1, 4]]


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        (Frame((CAMERA,), absent=("d",)), r"frames\[0\].absent.*no object named 'd'"),
        (Frame((CAMERA,), levels={"a": 0}), r"frames\[0\].levels.a.*no group with levels"),
        (Frame((CAMERA,), levels={"bc": 2}), r"frames\[0\].levels.bc.*level 2 of 'bc'"),
        (
            Frame((CAMERA,), world_from_object={"a": np.diag([1.0, 1.0, 0.0, 1.0])}),
            r"frames\[0\].world_from_object.a.*cannot be inverted",
        ),
        (
            Frame((CAMERA,), world_from_object={"a": np.full((4, 4), np.nan)}),
            r"world_from_object.a.*not finite",
        ),
        (
            Frame((CAMERA,), world_from_object={"a": np.diag([1.0, 1.0, 1.0, 2.0])}),
            r"world_from_object.a.*last row",
        ),
        (
            Frame((CAMERA,), world_from_object={"a": np.diag([1e38, 1e38, 1e38, 1.0]) * 1.0}),
            "",
        ),
        (
            Frame((CAMERA,), world_from_object={"a": shift(1e39)}),
            r"frames\[0\]: object 'a'.*infinite as it is posed",
        ),
    ],
)
def test_what_cannot_be_posed_is_one_line_with_its_place(frame, said):
    if not said:
        timeline(frame).at(0)
        return
    with pytest.raises(InputError, match=said) as refused:
        timeline(frame, of=levels()).at(0)
    assert "\n" not in str(refused.value)


def test_objects_that_share_vertices_cannot_be_posed_alone():
    made = Scene(
        np.eye(3, dtype=np.float32),
        np.array([(0, 1, 2), (0, 2, 1)], np.int32),
        np.array([0, 1, 2]),
        ("a", "b"),
    )
    with pytest.raises(InputError, match="shares vertices"):
        timeline(Frame((CAMERA,), world_from_object={"a": shift(1.0)}), of=made).at(0)


class Rises:
    """A file's motion: object 0 rises by the time, object 1 is switched off from second 2 on."""

    clips = ("rise", "rest")
    digest = "rises"
    skinned = np.zeros(3, np.bool_)

    def affected(self, clip):
        return np.array([True, True, False]) if clip == 0 else np.zeros(3, np.bool_)

    def at(self, clip, time_s):
        from visref.rig import Moment

        if clip == 1:
            return Moment(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
        worlds = np.stack([shift(0.0, time_s), np.eye(4)])
        hidden = np.array([False, time_s >= 2.0, False])
        return Moment(np.array([0, 1]), worlds, {}, hidden)


def animated() -> Scene:
    from visref.timeline import _rig_of

    return replace(scene(), rig=replace(_rig_of(scene()), motion=Rises()), motion="rises")


def test_an_animation_poses_at_the_frame_s_time():
    frames = [Frame((CAMERA,), time_s=t) for t in (0.0, 1.5, 2.0)]
    found = timeline(*frames, of=animated())
    assert found.still.moving.tolist() == [True, True, False]
    lifted = corners(scene(), 0) + np.array([0.0, 1.5, 0.0], np.float32)
    np.testing.assert_array_equal(corners(found.at(1), 0), lifted)
    assert found.at(1).absent.tolist() == [False, False, False]
    assert found.at(2).absent.tolist() == [False, True, False]
    assert found.still.digest != scene().digest


def test_an_animation_without_time_is_refused_with_both_fixes_and_rest_is_a_choice():
    with pytest.raises(InputError, match=r"p.json: frames\[0\].*'fps'.*--rest-pose"):
        timeline(CAMERA, of=animated())
    rested = timeline(CAMERA, of=animated(), rest_pose=True)
    assert not rested.moves
    timeline(Frame((CAMERA,), time_s=0.0), of=animated())


def test_a_clip_is_named_and_one_that_is_not_there_is_refused():
    still = timeline(Frame((CAMERA,), time_s=1.0, clip="rest"), of=animated())
    assert not still.moves
    with pytest.raises(InputError, match=r"no animation 'fall'"):
        timeline(Frame((CAMERA,), time_s=1.0, clip="fall"), of=animated())


def test_a_path_s_fps_gives_each_frame_its_absolute_time(tmp_path):
    view = {"width": 8, "height": 8, "near": 0.1, "yfov": 1.0}
    frames = [{"world_from_camera": np.eye(4).tolist()} for _ in range(3)]
    frames[2]["time_s"] = 0.125
    about = {"format": "visref-path", "version": 1, **view, "fps": 4, "frames": frames}
    (tmp_path / "p.json").write_text(json.dumps(about))
    read = CameraPath.load(tmp_path / "p.json")
    assert [frame.time_s for frame in read.frames] == [0.0, 0.25, 0.125]
    assert CameraPath.from_json(read.to_json()).frames[1].time_s == 0.25
