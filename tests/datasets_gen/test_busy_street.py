"""`busy_street`: a valid file by a reading of its own, in which what the documentation says moves,
deterministic, and read by visref as an evaluation from the specification has it."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.support.gltf_baking import Animated, bake
from visref.camera_path import CameraPath
from visref.engines.embree import EmbreeEngine
from visref.errors import InputError
from visref.formats import load_path, load_scene
from visref.timeline import Timeline
from visref.visibility import objects_seen
from visref_datasets_gen.animated import animated_glb_bytes
from visref_datasets_gen.busy_street import busy_street
from visref_datasets_gen.busy_street.figures import JOINTS
from visref_datasets_gen.busy_street.houses import STOREY_M


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The scene file and the path file, at scale 1."""
    return busy_street().write(tmp_path_factory.mktemp("street"))


@pytest.fixture(scope="module")
def street(files) -> Animated:
    return Animated(files[0].read_bytes())


@pytest.fixture(scope="module")
def path(files) -> dict[str, Any]:
    return json.loads(files[1].read_text())


def points_of(street, name, time_s):
    (posed,) = [one for one in street.at(time_s) if one.name == name]
    return np.concatenate(posed.points)


def middle(street, name, time_s):
    points = points_of(street, name, time_s)
    return (points.min(axis=0) + points.max(axis=0)) / 2.0


def accessor_is_within_its_view(document, accessor):
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor["type"]]
    size = width * {5121: 1, 5125: 4, 5126: 4}[accessor["componentType"]]
    view = document["bufferViews"][accessor["bufferView"]]
    end = accessor.get("byteOffset", 0) + size * accessor["count"]
    whole = document["buffers"][view["buffer"]]["byteLength"]
    return end <= view["byteLength"] and view["byteOffset"] + view["byteLength"] <= whole


def test_every_accessor_lies_in_the_file_and_has_the_bounds_it_states(street):
    document = street.json
    assert document["buffers"] == [{"byteLength": len(street.blob)}]
    for number, accessor in enumerate(document["accessors"]):
        assert accessor_is_within_its_view(document, accessor)
        assert document["bufferViews"][accessor["bufferView"]]["byteOffset"] % 4 == 0
        values = street.values(number)
        assert np.isfinite(values).all()
        if "min" in accessor:
            assert values.min(axis=0).tolist() == accessor["min"]
            assert values.max(axis=0).tolist() == accessor["max"]


def test_every_primitive_is_whole(street):
    document = street.json
    for mesh in document["meshes"]:
        assert mesh["primitives"]
        assert len({len(p.get("targets", ())) for p in mesh["primitives"]}) == 1
        for primitive in mesh["primitives"]:
            attributes = primitive["attributes"]
            assert "min" in document["accessors"][attributes["POSITION"]]
            count = document["accessors"][attributes["POSITION"]]["count"]
            others = [*attributes.values(), *(t["POSITION"] for t in primitive.get("targets", ()))]
            assert {document["accessors"][one]["count"] for one in others} == {count}
            indices = street.values(primitive["indices"])
            assert indices.max() < count
            assert len(indices) % 3 == 0


def test_the_nodes_are_one_forest_and_levels_are_nobodys_children(street):
    nodes = street.nodes
    below = [child for node in nodes for child in node.get("children", ())]
    levels = [one for node in nodes
              for one in node.get("extensions", {}).get("MSFT_lod", {}).get("ids", ())]  # fmt: skip
    roots = street.json["scenes"][0]["nodes"]
    assert sorted([*below, *levels, *roots]) == list(range(len(nodes)))
    used = {name for node in nodes for name in node.get("extensions", ())}
    assert {*used, "KHR_animation_pointer"} == set(street.json["extensionsUsed"])


def test_skins_bind_every_vertex_to_joints_that_they_have(street):
    skinned = [node for node in street.nodes if "skin" in node]
    assert len(skinned) >= 10
    for node in skinned:
        skin = street.json["skins"][node["skin"]]
        assert len(set(skin["joints"])) == len(JOINTS)
        assert len(street.values(skin["inverseBindMatrices"])) == len(JOINTS)
        for primitive in street.json["meshes"][node["mesh"]]["primitives"]:
            joints = street.values(primitive["attributes"]["JOINTS_0"])
            weights = street.values(primitive["attributes"]["WEIGHTS_0"])
            assert joints.max() < len(JOINTS)
            assert (weights.sum(axis=1) == 1.0).all()
            assert (joints[weights == 0.0] == 0).all()


def test_animation_keys_ascend_and_turns_are_unit_quaternions(street):
    (clip,) = street.json["animations"]
    targets = [json.dumps(channel["target"], sort_keys=True) for channel in clip["channels"]]
    assert len(set(targets)) == len(targets)
    for channel in clip["channels"]:
        sampler = clip["samplers"][channel["sampler"]]
        times, values = street.values(sampler["input"])[:, 0], street.values(sampler["output"])
        assert (np.diff(times) > 0.0).all()
        assert times[0] >= 0.0
        each = 3 if sampler["interpolation"] == "CUBICSPLINE" else 1
        path = channel["target"]["path"]
        if path == "weights":
            assert len(values) == 2 * each * len(times)
        else:
            assert len(values) == each * len(times)
        if path == "rotation":
            # float32's rounding of four numbers of at most 1.
            assert np.abs(np.linalg.norm(values, axis=1) - 1.0).max() < 2.0**-22
        if path == "pointer":
            assert sampler["interpolation"] == "STEP"


def test_trimesh_reads_it(files):
    scene = trimesh.load(files[0], file_type="glb")
    names = set(scene.graph.nodes_geometry)
    assert {"lift/cabin", "house-north-0/door", "drone"} <= names


def test_every_kind_of_motion_is_there(street):
    clip = street.json["animations"][0]
    kinds = {(channel["target"]["path"], clip["samplers"][channel["sampler"]]["interpolation"])
             for channel in clip["channels"]}  # fmt: skip
    assert kinds == {
        *(("translation", "LINEAR"), ("translation", "CUBICSPLINE")),
        *(("rotation", "LINEAR"), ("weights", "LINEAR"), ("pointer", "STEP")),
    }


def test_doors_open_inward_and_close_again(street):
    stands: dict[str, list[Any]] = {}
    for time_s in np.arange(0.0, 10.0, 0.25):
        for one in street.at(time_s):
            if one.name.endswith("/door"):
                stands.setdefault(one.name, []).append(one.points[0])
    assert len(stands) == 10
    for places in map(np.array, stands.values()):
        reach = np.abs(places - places[0]).max(axis=(1, 2))
        assert reach[0] == 0.0
        assert reach.max() > 0.9
        # Into the house: away from the street, which is at z = 0.
        wide = places[reach.argmax()]
        assert np.abs(wide[:, 2]).max() > np.abs(places[0][:, 2]).max() + 0.9


def test_the_lift_stands_at_its_storeys_with_its_doors_open_and_its_rider_in_it(street):
    start = middle(street, "lift/cabin", 0.0)
    for time_s, storey in ((0.5, 0), (4.5, 2), (8.75, 1)):
        up = middle(street, "lift/cabin", time_s) - start
        assert up == pytest.approx([0.0, storey * STOREY_M, 0.0], abs=1e-6)
        rider = middle(street, "rider", time_s) - middle(street, "rider", 0.0)
        assert rider[1] == pytest.approx(storey * STOREY_M, abs=0.01)
    left, right = (middle(street, f"lift/leaf-{side}", 4.5)[0] for side in ("left", "right"))
    shut = [middle(street, f"lift/leaf-{side}", 3.0)[0] for side in ("left", "right")]
    assert right - left == pytest.approx(shut[1] - shut[0] + 2 * 0.76, abs=1e-5)


def test_cars_drive_brake_and_turn(street):
    through = [middle(street, "car-0/body", t)[0] for t in (0.0, 5.0, 10.0)]
    assert np.diff(through) == pytest.approx([50.0, 50.0], abs=0.01)
    braking = [middle(street, "car-2/body", t)[0] for t in np.arange(0.0, 10.1, 0.5)]
    speeds = np.diff(braking) / 0.5
    assert speeds[0] > 6.0
    assert np.abs(speeds[8:12]).max() < 1e-6  # it stands from 4 s to 6 s
    assert speeds[-1] > 6.0
    along = {}
    for time_s in (2.0, 8.0):
        size = np.ptp(points_of(street, "car-3/body", time_s), axis=0)
        along[time_s] = "x" if size[0] > size[2] else "z"
    assert along == {2.0: "z", 8.0: "x"}


def test_figures_walk_with_feet_that_swing(street):
    start, end = middle(street, "walker-0", 0.0), middle(street, "walker-0", 10.0)
    assert np.linalg.norm(end - start) == pytest.approx(14.0, abs=0.5)
    # Feet against the body: the lowest fifth of its vertices, over a cycle.
    swing = []
    for time_s in np.arange(2.0, 3.0, 0.125):
        points = points_of(street, "walker-0", time_s)
        feet = points[points[:, 1] < points[:, 1].min() + 0.15]
        swing.append(feet[:, 0].max() - points[:, 0].mean())
    assert np.ptp(swing) > 0.1


def test_the_wind_bends_crowns_and_leaves_the_foot_of_the_trunk(street):
    there = [points_of(street, "tree-0", t) for t in (0.0, 1.0, 2.0, 3.0)]
    foot = there[0][:, 1] < there[0][:, 1].min() + 0.01
    moved = np.ptp(there, axis=0).max(axis=1)
    assert moved[foot].max() == 0.0
    assert moved.max() > 0.3


def there(street, path, frame):
    return {posed.name for posed, here in bake(street, path, frame) if here}


def test_things_appear_vanish_and_change_their_level(street, path):
    first, later, last = (there(street, path, frame) for frame in (0, 60, 119))
    assert "lorry" in first - later
    assert "stall" in later - first - last
    assert "parcels" in last - first
    assert "shelter" in first & last - later
    for name in ("statue", "tower-east", "tower-west"):
        names = [name, *(f"{name}-{k}" for k in (1, 2)), f"{name}-block"]
        found = [len({*names} & there(street, path, frame)) for frame in range(0, 120, 10)]
        assert found == [1] * 12
    assert {"statue-2"} & first
    assert {"statue-1", "statue"} & last


def test_the_path_is_120_frames_with_two_cuts(path, files):
    assert len(path["frames"]) == 120
    assert path["fps"] == 12.0
    assert [k for k, frame in enumerate(path["frames"]) if frame.get("cut")] == [40, 80]
    assert isinstance(load_path(files[1]), CameraPath)


def test_visref_poses_it_as_the_evaluation_does(street, path, files):
    scene = load_scene(files[0])
    timeline = Timeline(scene, load_path(files[1]))
    for frame in (0, 31, 60, 119):
        moment = timeline.at(frame)
        posed = bake(street, path, frame)
        assert [one.name for one, _ in posed] == list(moment.names)
        wanted = np.array([not here for _, here in posed])
        absent = np.zeros_like(wanted) if moment.absent is None else moment.absent
        assert (absent == wanted).all()
        for index, (one, here) in enumerate(posed):
            if not here:
                continue
            part = slice(*moment.object_offsets[index : index + 2])
            ours = moment.vertices[moment.triangles[part]].astype(float)
            mesh = street.json["meshes"][street.nodes[one.node]["mesh"]]
            theirs = np.concatenate(
                [points[street.values(primitive["indices"])[:, 0]]
                 for points, primitive in zip(one.points, mesh["primitives"], strict=True)]
            ).reshape(-1, 3, 3)  # fmt: skip
            # Both round once to float32; before it, float64 errs by far less than its last bit
            # of numbers up to 2^8: 2^-53 * 2^8 times some hundred operations.
            last = np.spacing(np.abs(theirs).astype(np.float32)) + 2.0**-38
            assert (np.abs(ours - theirs) <= last).all(), one.name


@pytest.mark.slow
def test_most_of_it_is_hidden_in_every_shot(files):
    path = load_path(files[1])
    timeline = Timeline(load_scene(files[0]), path)
    engine = EmbreeEngine(timeline.still)
    try:
        for frame in (20, 60, 100):
            moment = timeline.at(frame)
            engine.pose(moment)
            truth = engine.frame(path.resized(320, 240).cameras[frame])
            seen = np.flatnonzero(objects_seen(truth, moment).samples)
            present = moment.object_count - int(np.count_nonzero(moment.absent))
            assert 5 < len(seen) < 0.4 * present
    finally:
        engine.close()


def test_same_seed_same_bytes_another_seed_another_street():
    first, again, other = (busy_street(seed=seed, scale=0.4, frames=3) for seed in (1, 1, 2))
    assert animated_glb_bytes(first.nodes, "a") == animated_glb_bytes(again.nodes, "a")
    assert first.path == again.path
    assert animated_glb_bytes(first.nodes, "a") != animated_glb_bytes(other.nodes, "a")


def test_stereo_eyes_are_64_mm_apart_and_look_alike():
    mono = busy_street(scale=0.4, frames=4).path["frames"]
    for one, two in zip(mono, busy_street(scale=0.4, frames=4, views="stereo").path["frames"],
                        strict=True):  # fmt: skip
        eyes = [np.array(two["views"][name]["world_from_camera"]) for name in ("left", "right")]
        middle_eye = np.array(one["world_from_camera"])
        assert (eyes[0][:3, :3] == middle_eye[:3, :3]).all()
        assert (eyes[1][:3, :3] == middle_eye[:3, :3]).all()
        apart = (eyes[1] - eyes[0])[:3, 3]
        assert apart == pytest.approx(0.064 * middle_eye[:3, 0], abs=1e-12)


def test_a_cube_maps_six_views_look_all_ways_from_one_eye():
    path = busy_street(scale=0.4, frames=2, views="cube").path
    assert path["width"] == path["height"]
    assert path["yfov"] == pytest.approx(np.pi / 2)
    for frame in path["frames"]:
        poses = [np.array(one["world_from_camera"]) for one in frame["views"].values()]
        assert len(poses) == 6
        assert len({tuple(pose[:3, 3]) for pose in poses}) == 1
        ways = np.array([-pose[:3, 2] for pose in poses])
        assert np.abs(ways.sum(axis=0)).max() < 1e-12
        assert np.linalg.matrix_rank(ways) == 3
        for pose in poses:
            assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    assert CameraPath.from_json(path).views(0)[0].view == "front"


@pytest.mark.parametrize(
    ("options", "place"),
    [({"scale": 0.0}, "scale"), ({"frames": 0}, "frames"), ({"views": "trio"}, "views")],
)
def test_options_that_make_no_street_are_refused(options, place):
    with pytest.raises(InputError, match=place):
        busy_street(**options)
