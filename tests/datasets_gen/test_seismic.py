"""`seismic`: deterministic, of the size it promises, in layers that hide each other."""

from __future__ import annotations

import numpy as np
import pytest

from visref.engines.embree import EmbreeEngine
from visref.errors import InputError
from visref.scene import Alpha
from visref.visibility import objects_seen
from visref_datasets_gen import scene_of
from visref_datasets_gen.glb import glb_bytes
from visref_datasets_gen.seismic import HORIZONS, TILES, VOLUME_SLICES, seismic

pytestmark = pytest.mark.slow


def tiles(scene):
    return np.array([name.startswith("horizon") for name in scene.names])


def test_scale_1_is_about_a_million_triangles_in_240_tiles_faults_and_slices():
    scene = scene_of(seismic(frames=1))
    assert scene.triangle_count == pytest.approx(1_000_000, rel=0.05)
    assert tiles(scene).sum() == HORIZONS * TILES[0] * TILES[1] == 240
    sizes = np.diff(scene.object_offsets)
    # High resolution, lower resolution, few polygons.
    assert sizes[tiles(scene)].min() > 2_500
    kind = [name.rpartition("-")[0] for name in scene.names]
    assert {size for k, size in zip(kind, sizes, strict=True) if k == "fault"} == {252}
    assert {size for k, size in zip(kind, sizes, strict=True) if "slice" in k} == {2}
    a, b, c = scene.vertices.astype(np.float64)[scene.triangles].transpose(1, 0, 2)
    assert (np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0.0).all()


@pytest.mark.parametrize("seed", range(6))
def test_no_tile_is_torn_away_whole_however_coarse(seed):
    scene = scene_of(seismic(seed=seed, scale=0.001, frames=1))
    assert np.diff(scene.object_offsets).min() >= 2


def test_it_grows_with_its_scale():
    small, large = (scene_of(seismic(scale=scale, frames=1)) for scale in (0.1, 0.4))
    assert 3.0 < large.triangle_count / small.triangle_count < 5.0


def test_same_seed_same_bytes_and_another_seed_others():
    made = [seismic(seed=seed, scale=0.02, frames=5) for seed in (5, 5, 6)]
    files = [glb_bytes(dataset.nodes) for dataset in made]
    assert files[0] == files[1] != files[2]
    assert made[0].path.to_json() == made[1].path.to_json()


def test_horizons_are_height_fields_in_layers():
    """Seen from above every triangle is turned the same way, and no layer crosses the next."""
    scene = scene_of(seismic(scale=0.05, frames=1))
    horizon = tiles(scene)[scene.object_of_triangle]
    a, b, c = scene.vertices.astype(np.float64)[scene.triangles[horizon]].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 1] > 0.0).all()
    heights: dict[tuple[str, str], dict[int, float]] = {}
    for name, bounds in zip(scene.names, scene.object_bounds, strict=True):
        if name.startswith("horizon"):
            _, number, _, i, j = name.split("-")
            heights.setdefault((i, j), {})[int(number)] = bounds[:, 1].mean()
    for column in heights.values():
        assert [column[k] for k in range(HORIZONS)] == sorted(column.values(), reverse=True)


def test_only_the_volume_is_transparent():
    scene = scene_of(seismic(scale=0.01, frames=1))
    blended = np.unique(scene.object_of_triangle[scene.alpha == Alpha.BLEND])
    assert len(blended) == VOLUME_SLICES
    assert all(scene.names[k].startswith("volume") for k in blended)


def test_path_dives_between_the_layers_and_sees_few_tiles_of_those_in_view():
    dataset = seismic(scale=0.05, frames=20)
    scene = scene_of(dataset)
    engine = EmbreeEngine(scene)
    shares, eyes = [], []
    for camera in dataset.path.resized(128, 96):
        seen = objects_seen(engine.frame(camera), scene).visible[tiles(scene)]
        shares.append(seen.mean())
        eyes.append(camera.eye[1])
    assert np.mean(shares) < 0.15
    assert max(shares) > 0.25
    assert eyes[0] > 0.0 > eyes[10] > eyes[14] > eyes[19]
    assert [k for k, camera in enumerate(dataset.path) if camera.cut] == [12, 16]


@pytest.mark.parametrize(
    ("settings", "line"), [({"scale": 0.0}, "scale"), ({"frames": 0}, "frames")]
)
def test_nothing_to_make_is_one_clear_line(settings, line):
    with pytest.raises(InputError, match=line):
        seismic(**settings)
