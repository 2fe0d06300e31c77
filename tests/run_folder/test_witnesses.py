"""A witness carries every triangle that its ray meets, and little else."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.support.hand_made import camera, scene_of_squares
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.culler import Promise, QueryStats
from visref.exact import ExactScene
from visref.judging.judge import Counts, FrameVerdict, Miss, MissKind
from visref.judging.misses import Misses
from visref.judging.outcome import CullerRecord, FrameRecord
from visref.run_folder import along
from visref.run_folder.witnesses import triangles_along, write_witnesses
from visref.scene import Scene
from visref.timeline import Timeline


def random_scene(seed: int, offset: float = 0.0) -> Scene:
    rng = np.random.default_rng(seed)
    corners = rng.integers(-8, 9, (60, 3, 3)).astype(np.float32) + np.float32(offset)
    return Scene.from_objects([(f"t{i}", c, [[0, 1, 2]]) for i, c in enumerate(corners)])


@pytest.mark.parametrize("offset", [0.0, 4096.0, 2.0**20])
@pytest.mark.parametrize("ortho", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_no_owner_is_left_out_of_its_samples_witness(seed, ortho, offset):
    scene = random_scene(seed, offset)
    target = np.full(3, offset)
    view = Camera(
        look_at(target + np.array((3.0, 5.0, 20.0)), target),
        16,
        12,
        near=0.5,
        **({"ymag": 9.0} if ortho else {"yfov": 0.9}),
    )
    samples = np.arange(view.samples)
    owners = ExactScene(scene).decide(view, samples)
    along = triangles_along(scene, view, samples.tolist())
    for sample in samples:
        low, high = owners.offsets[sample : sample + 2]
        assert set(owners.triangles[low:high].tolist()) <= set(along[sample].tolist())
    # It is a witness, not the scene: a ray meets a few of sixty scattered triangles.
    assert np.mean([len(found) for found in along]) < 30


def test_everything_along_the_ray_is_listed_in_front_and_behind():
    scene = scene_of_squares(0.0, -3.0, -6.0)
    (found,) = triangles_along(scene, camera(), [0])
    assert set(scene.object_of_triangle[found].tolist()) == {0, 1, 2}


def test_what_lies_behind_the_camera_is_not_listed():
    scene = scene_of_squares(0.0, 30.0)
    near = replace(camera(), near=1.0)
    (found,) = triangles_along(scene, near, [0])
    assert set(scene.object_of_triangle[found].tolist()) == {0}


@pytest.mark.parametrize("offset", [0.0, 2.0**20])
@pytest.mark.parametrize("ortho", [False, True])
def test_triangles_passed_by_in_blocks_are_none_that_own_a_sample(ortho, offset):
    rng = np.random.default_rng(5)
    # Small triangles in the order of their place, so that whole blocks lie beside a ray.
    places = np.sort(rng.integers(-64, 65, (1000, 3)), axis=0)
    corners = (places[:, None] + rng.integers(-9, 10, (1000, 3, 3))) / 8.0 + offset
    scene = Scene.from_objects([("all", corners.reshape(-1, 3), np.arange(3000).reshape(-1, 3))])
    target = np.full(3, offset)
    view = Camera(
        look_at(target + np.array((3.0, 5.0, 20.0)), target),
        32,
        24,
        near=0.5,
        **({"ymag": 9.0} if ortho else {"yfov": 0.9}),
    )
    samples = np.arange(view.samples)
    owners = ExactScene(scene).decide(view, samples)
    assert len(owners.triangles) > 50
    along = triangles_along(scene, view, samples.tolist())
    for sample in samples:
        low, high = owners.offsets[sample : sample + 2]
        assert set(owners.triangles[low:high].tolist()) <= set(along[sample].tolist())


def of_object(number: int, pixels: int, kind: MissKind = MissKind.CONFIRMED) -> Miss:
    return Miss(number, kind, pixels, pixels, 0, 2 * number, 10.0, width=camera().width)


def written(tmp_path, scene, *frames: list[Miss]) -> list[tuple[int, int]]:
    """(frame, object) of each witness on file."""
    path = CameraPath((camera(),) * len(frames))
    rows = [
        FrameRecord(
            i,
            "",
            4,
            FrameVerdict(Counts(), Misses.of(found), np.zeros(0, np.int32)),
            QueryStats(),
            0,
        )
        for i, found in enumerate(frames)
    ]
    record = CullerRecord("draws", Promise.CONSERVATIVE, frames=rows)
    nothing = np.zeros(scene.triangle_count, np.bool_)
    timeline = Timeline(scene, path)
    write_witnesses(tmp_path / "w.jsonl", timeline, path, record, lambda frame, view: nothing)
    lines = [json.loads(line) for line in (tmp_path / "w.jsonl").read_text().splitlines()]
    return [(line["frame"], line["object"]) for line in lines]


def test_every_convicted_object_has_its_worst_witness_beyond_the_cap(tmp_path, monkeypatch):
    monkeypatch.setattr("visref.run_folder.witnesses.WITNESSES_PER_CULLER", 3)
    scene = scene_of_squares(0.0, -1.0, -2.0, -3.0)
    tie, late = MissKind.TIE, MissKind.LATE
    frames = [
        [of_object(0, 90), of_object(1, 3), of_object(2, 0, tie), of_object(3, 1, late)],
        [of_object(0, 80), of_object(1, 5), of_object(2, 0, tie)],
        [of_object(0, 70), of_object(1, 5), of_object(3, 1)],
    ]
    # The three worst are object 0's. Of object 1 the first of its worst, of 3 its confirmed one;
    # nobody is convicted of object 2.
    assert written(tmp_path, scene, *frames) == [(0, 0), (1, 0), (1, 1), (2, 0), (2, 3)]


def test_a_witness_within_the_cap_is_written_once(tmp_path):
    scene = scene_of_squares(0.0, -1.0)
    frames = [[of_object(0, 9), of_object(1, 0, MissKind.TIE)], [of_object(0, 9)]]
    assert written(tmp_path, scene, *frames) == [(0, 0), (0, 1), (1, 0)]


@pytest.mark.parametrize("camera_fields", [{"yfov": 1.2}, {"ymag": 8.0}], ids=["eye", "parallel"])
@pytest.mark.parametrize("shape", ["small", "large", "at the eye's height", "slivers"])
def test_rays_of_many_witnesses_find_what_each_finds_by_itself(monkeypatch, camera_fields, shape):
    rng = np.random.default_rng(3)
    found = 0
    for eye in ((0.0, 0.0, 0.0), (0.0, 0.0, 14.0)):
        corners = rng.uniform(-10.0, 10.0, (400, 1, 3))
        corners = corners + rng.normal(0.0, 4.0 if shape == "large" else 1.0, (400, 3, 3))
        if shape == "at the eye's height":
            corners[::3, :, 1] = 0.0
        if shape == "slivers":
            corners[::2, 2] = corners[::2, 0] + rng.normal(0.0, 1e-6, (200, 3))
            corners[1::4, 2] = corners[1::4, 1]
        scene = Scene.from_objects(
            [("soup", corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3))]
        )
        view = Camera(look_at(eye, (0.3, 0.0, eye[2] - 1.0)), 64, 48, near=0.1, far=100.0,
                      **camera_fields)  # fmt: skip
        samples = rng.choice(64 * 48, 500, replace=False).tolist()
        monkeypatch.setattr(along, "_FEW", len(samples))
        alone = triangles_along(scene, view, samples)
        monkeypatch.setattr(along, "_FEW", 0)
        together = triangles_along(scene, view, samples)
        for one, other in zip(alone, together, strict=True):
            assert one.tolist() == other.tolist()
        found += sum(map(len, alone))
    assert found > 100
