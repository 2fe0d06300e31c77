"""The generators: deterministic, the size they promise, and what loading their files gives."""

from __future__ import annotations

import hashlib
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.engines.exact import ExactEngine
from visref.errors import InputError
from visref.formats import load_scene
from visref.scene import Scene
from visref.visibility import BACKGROUND, FrameTruth, objects_seen
from visref_datasets_gen import Dataset, scene_of, shapes
from visref_datasets_gen.__main__ import main
from visref_datasets_gen.city import city
from visref_datasets_gen.glb import glb_bytes
from visref_datasets_gen.graph import Material, Mesh, Node, Primitive
from visref_datasets_gen.hard import HardCase, hard_cases
from visref_datasets_gen.isosurface import isosurface

PLAIN = Material("plain", (0.5, 0.5, 0.5, 1.0))
ONE_TRIANGLE = Primitive(
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32), np.array([[0, 1, 2]]), PLAIN
)
PATH = CameraPath((Camera(look_at((0, 0, 5), (0, 0, 0)), 8, 8, 0.1, yfov=1.0),))


def document_of(glb: bytes) -> dict[str, Any]:
    (length,) = struct.unpack_from("<I", glb, 12)
    return json.loads(glb[20 : 20 + length])


def signed_volume(soup: shapes.Soup) -> float:
    corners = soup[0][soup[1]]
    return float(np.linalg.det(corners).sum() / 6.0)


def areas(scene: Scene) -> np.ndarray:
    a, b, c = scene.vertices.astype(np.float64)[scene.triangles].transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0


@pytest.mark.parametrize(
    ("soup", "volume"),
    [
        (shapes.box([0, 0, 0], [2, 3, 4]), 24.0),
        (shapes.lathe([(1.0, 0.0), (1.0, 2.0)], 4), 4.0),
        (shapes.loft([[(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 0, 1), (1, 0, 1), (0, 1, 1)]]), 0.5),
        (shapes.turned(shapes.box([0, 0, 0], [2, 3, 4]), 3), 24.0),
    ],
)
def test_solid_is_closed_and_faces_outward(soup: shapes.Soup, volume: float) -> None:
    assert signed_volume(soup) == pytest.approx(volume)
    _, index = np.unique(np.round(soup[0], 9), axis=0, return_inverse=True)
    edges = index.reshape(-1)[soup[1]][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    assert sorted(map(tuple, edges)) == sorted(map(tuple, edges[:, ::-1]))


def test_icosphere_has_twenty_times_four_to_the_n_outward_faces() -> None:
    for subdivisions in range(3):
        sphere = shapes.icosphere(subdivisions)
        assert len(sphere[1]) == 20 * 4**subdivisions
        assert 2.5 < signed_volume(sphere) < 4.0 * np.pi / 3.0


@pytest.mark.slow
def test_city_at_scale_1_is_about_768k_triangles_in_4000_objects() -> None:
    scene = scene_of(city())
    assert scene.triangle_count == pytest.approx(768_000, rel=0.04)
    assert scene.object_count == pytest.approx(4_000, rel=0.02)
    assert (areas(scene) > 0.0).all()


@pytest.mark.slow
def test_city_grows_with_its_scale_and_is_stored_as_instances() -> None:
    small, large = city(scale=0.1), city(scale=0.4)
    ratio = scene_of(large).triangle_count / scene_of(small).triangle_count
    assert 3.0 < ratio < 5.0
    document = document_of(glb_bytes(large.nodes))
    shown = sum("mesh" in node for node in document["nodes"])
    assert shown > 2 * len(document["meshes"]) > 2 * len(document["accessors"]) / 8


def test_city_path_cuts_once_and_turns_twice() -> None:
    frames = city(scale=0.02, frames=60).path.cameras
    assert len(frames) == 60
    assert [camera.cut for camera in frames].count(True) == 1
    assert not frames[0].cut
    step = np.linalg.norm(np.diff([camera.eye for camera in frames], axis=0), axis=1)
    (cut,) = [k for k, camera in enumerate(frames) if camera.cut]
    assert step[cut - 1] > 10.0 * np.delete(step, cut - 1).max()
    for first, last in ((frames[0], frames[cut - 1]), (frames[cut], frames[-1])):
        assert abs(float(first.forward @ last.forward)) < 0.5
    assert {(camera.width, camera.height) for camera in frames} == {(1280, 960)}


@pytest.mark.slow
def test_walker_meets_nothing_closer_than_the_near_plane() -> None:
    dataset = city(scale=0.2, frames=240)
    boxes = scene_of(dataset).object_bounds
    for camera in dataset.path:
        gap = np.maximum(np.maximum(boxes[:, 0] - camera.eye, camera.eye - boxes[:, 1]), 0.0)
        assert np.linalg.norm(gap, axis=1).min() > 0.25


def edge_counts(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """How many triangles use each directed edge, and its reverse, by position: (e, 2)."""
    _, index = np.unique(vertices, axis=0, return_inverse=True)
    directed = index.reshape(-1)[triangles][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    forward = directed[:, 0] < directed[:, 1]
    _, edge = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True)
    counts = np.zeros((edge.max() + 1, 2), np.int64)
    np.add.at(counts, (edge.reshape(-1), forward.astype(int)), 1)
    return counts


def test_isosurface_of_a_ball_is_closed_and_has_its_volume() -> None:
    grid = np.stack(np.meshgrid(*3 * [np.arange(24.0) - 11.3], indexing="ij"))
    vertices, triangles = isosurface((8.0 - np.linalg.norm(grid, axis=0)).astype(np.float32))
    assert (edge_counts(vertices, triangles) == 1).all()
    assert signed_volume((vertices, triangles)) == pytest.approx(4 / 3 * np.pi * 8**3, rel=0.02)


@pytest.mark.slow
def test_same_seed_gives_the_same_bytes_and_another_seed_others(tmp_path: Path) -> None:
    digests = []
    for run, seed in enumerate((7, 7, 8)):
        out = tmp_path / str(run)
        assert main(["city", "--out", str(out), "--scale", "0.02", "--seed", str(seed)]) == 0
        files = sorted(out.iterdir())
        assert [file.name for file in files] == ["city.glb", "city.path.json"]
        digests.append([hashlib.sha256(file.read_bytes()).hexdigest() for file in files])
    assert digests[0] == digests[1]
    assert digests[0][0] != digests[2][0]


def test_written_path_reads_back_equal(tmp_path: Path) -> None:
    dataset = city(scale=0.02, frames=5)
    _, path_file = dataset.write(tmp_path)
    for ours, theirs in zip(dataset.path, CameraPath.load(path_file), strict=True):
        assert ours.definition() == theirs.definition()
        assert ours.cut == theirs.cut


def test_size_options_set_the_path(tmp_path: Path) -> None:
    arguments = ["city", "--out", str(tmp_path), "--scale", "0.02", "--frames", "3"]
    assert main([*arguments, "--width", "64", "--height", "48"]) == 0
    cameras = CameraPath.load(tmp_path / "city.path.json").cameras
    assert [(camera.width, camera.height) for camera in cameras] == [(64, 48)] * 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["nothing"], "no data set is called 'nothing'"),
        (["city", "--scale", "0"], "scale is 0.0"),
        (["city", "--scale", "nan"], "scale is nan"),
        (["city", "--seed", "-1"], "the seed is -1"),
        (["city", "--frames", "0"], "0 frames"),
        (["city", "--width", "5"], "belong together"),
        (["angio", "--scale", "0"], "scale is 0.0"),
        (["angio", "--frames", "0"], "0 frames"),
        (["hard", "--scale", "2"], "have no scale"),
        (["hard", "--frames", "2"], "have no frames"),
        (["hard", "--width", "8", "--height", "8"], "its own image size"),
    ],
)
def test_bad_command_line_is_one_clear_line(
    arguments: list[str], problem: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert problem in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_unwritable_output_is_one_clear_line_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("in the way")
    assert main(["city", "--scale", "0.02", "--out", str(tmp_path / "file")]) == 2
    assert "cannot write" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


def test_names_take_the_node_then_the_mesh_then_object() -> None:
    mesh, unnamed = Mesh("mesh", (ONE_TRIANGLE,)), Mesh("", (ONE_TRIANGLE,))
    nodes = (Node("node", mesh), Node("", mesh), Node("", unnamed), Node("node", mesh))
    assert scene_of(Dataset("d", nodes, PATH)).names == ("node", "mesh", "object", "node#2")


def assert_same_scene(ours: Scene, theirs: Scene) -> None:
    assert ours.names == theirs.names
    for field in ("vertices", "triangles", "object_offsets", "one_sided", "alpha"):
        np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field), err_msg=field)


@pytest.mark.slow
@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_scene_in_memory_equals_the_file_loaded(cull_backfaces: bool, tmp_path: Path) -> None:
    dataset = city(scale=0.06)
    scene_file, _ = dataset.write(tmp_path)
    ours = scene_of(dataset, cull_backfaces=cull_backfaces)
    assert ours.one_sided.any() == cull_backfaces
    assert_same_scene(ours, load_scene(scene_file, cull_backfaces=cull_backfaces))


def test_mirroring_transform_flips_the_winding() -> None:
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    scene = scene_of(Dataset("d", (Node("n", Mesh("m", (ONE_TRIANGLE,)), mirror),), PATH))
    a, b, c = scene.vertices[scene.triangles[0]]
    assert np.cross(b - a, c - a)[2] > 0.0


def test_vertex_that_is_not_finite_is_refused_by_name() -> None:
    bad = Primitive(ONE_TRIANGLE.vertices * np.float32("nan"), ONE_TRIANGLE.triangles, PLAIN)
    with pytest.raises(InputError, match="object 'broken'"):
        scene_of(Dataset("d", (Node("broken", Mesh("m", (bad,))),), PATH))


def disagreements(case: HardCase, truth: FrameTruth, scene: Scene, frame: int) -> list[str]:
    """Where a truth with complete ties differs from the case's picture."""
    triangle = truth.buffer.triangle.reshape(-1)
    object_id = np.append(scene.object_of_triangle, BACKGROUND)[triangle]
    tied: dict[int, set[int]] = {}
    ties = zip(truth.ties.sample.tolist(), truth.ties.triangle.tolist(), strict=True)
    for sample, other in ties:
        tied.setdefault(sample, {int(object_id[sample])}).add(int(scene.object_of_triangle[other]))
    shared = np.zeros(len(triangle), np.bool_)
    shared[[sample for sample, objects in tied.items() if len(objects) > 1]] = True
    sets, which = case.picture(frame)
    which = which.reshape(-1)
    wanted = [{scene.id_of_name[name] for name in owners} or {BACKGROUND} for owners in sets]
    several = np.array([len(objects) > 1 for objects in wanted])
    one_of = np.array([min(objects) for objects in wanted])
    wrong = (several[which] != shared) | (~shared & (object_id != one_of[which]))
    for sample in np.flatnonzero(shared & ~wrong).tolist():
        wrong[sample] = tied[sample] != wanted[which[sample]]
    return [f"sample {s}: not {sets[which[s]]}" for s in np.flatnonzero(wrong).tolist()]


CASES = {case.name: case for case in hard_cases()}
SOUND = [name for name, case in CASES.items() if not case.error]


@pytest.mark.slow
def test_hard_cases_have_unique_names_and_speak_of_objects_they_have() -> None:
    assert len(CASES) == len(hard_cases()) >= 60
    for name in SOUND:
        case = CASES[name]
        names = set(case.scene.names)
        assert len(case.pictures) == len(case.path)
        assert set(case.between) <= names
        for frame in case.expected["frames"]:
            assert names == set(frame["visible"]) | set(frame["hidden"])
            assert not set(frame["visible"]) & set(frame["hidden"])
            assert set(frame["tied"]) <= set(frame["visible"])
            assert {owner for patch in frame["owners"] for owner in patch["owners"]} <= names


@pytest.mark.slow
@pytest.mark.parametrize("name", SOUND)
def test_exact_engine_sees_each_hard_case_as_its_construction_says(name: str) -> None:
    case = CASES[name]
    scene = case.scene
    engine = ExactEngine(scene)
    for frame, camera in enumerate(case.path):
        truth = engine.frame(camera)
        assert truth.ties_complete
        assert disagreements(case, truth, scene, frame) == []
        seen = objects_seen(truth, scene)
        expected = case.expected["frames"][frame]
        assert [scene.names[i] for i in np.flatnonzero(seen.visible)] == expected["visible"]
        tied = np.flatnonzero(seen.visible & (seen.alone == 0))
        assert [scene.names[i] for i in tied] == expected["tied"]


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in SOUND if name != "empty-scene"])
def test_hard_case_notices_when_a_visible_object_is_gone(name: str) -> None:
    case = CASES[name]
    scene = case.scene
    frame = case.expected["frames"][0]
    gone = scene.id_of_name[frame["visible"][0]]
    first, last = scene.object_offsets[gone : gone + 2]
    kept = np.delete(np.arange(scene.triangle_count), np.s_[first:last])
    offsets = scene.object_offsets.copy()
    offsets[gone + 1 :] -= last - first
    lacking = Scene(
        scene.vertices, scene.triangles[kept], offsets, scene.names, scene.one_sided[kept]
    )
    truth = ExactEngine(lacking).frame(case.path.cameras[0])
    assert disagreements(case, truth, lacking, 0)


@pytest.mark.slow
def test_hard_case_files_load_to_the_same_scenes_and_verdicts(tmp_path: Path) -> None:
    assert main(["hard", "--out", str(tmp_path)]) == 0
    assert len(list(tmp_path.iterdir())) == 3 * len(CASES)
    for name, case in CASES.items():
        expected = json.loads((tmp_path / f"{name}.expected.json").read_text())
        assert expected == case.expected
        if case.error:
            with pytest.raises(InputError) as in_memory:
                _ = case.scene
            with pytest.raises(InputError) as from_file:
                load_scene(tmp_path / f"{name}.glb")
            for caught in (in_memory, from_file):
                assert all(part in str(caught.value) for part in expected["error"])
            continue
        loaded = load_scene(tmp_path / f"{name}.glb", cull_backfaces=expected["cull_backfaces"])
        assert_same_scene(case.scene, loaded)
        for ours, theirs in zip(
            case.path, CameraPath.load(tmp_path / f"{name}.path.json"), strict=True
        ):
            assert (ours.definition(), ours.cut) == (theirs.definition(), theirs.cut)


def test_objects_between_samples_are_visible_to_a_finer_image() -> None:
    for name in ("sliver-between-samples", "sub-pixel-between-samples"):
        case = CASES[name]
        finer = case.path.resized(8 * 128, 8 * 128).cameras[0]
        scene = case.scene
        seen = objects_seen(ExactEngine(scene).frame(finer), scene).visible
        assert [scene.names[i] for i in np.flatnonzero(seen)] == ["wall", *case.between]
