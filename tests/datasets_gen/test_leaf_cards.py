"""The forest of leaf cards: what its file holds, how near its cards come, how much is in doubt."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from visref.camera import Camera
from visref.engines import make_engine
from visref.errors import InputError
from visref.exact import ExactScene
from visref.formats.loading import load_scene
from visref.judging.holders import DrawList
from visref.judging.settle import settle
from visref.masks.hits import states_at
from visref.masks.lookup import BETWEEN, HOLE, SOLID
from visref.scene import Alpha, Scene, Units
from visref_datasets_gen.dataset import Dataset, scene_of
from visref_datasets_gen.glb import glb_bytes
from visref_datasets_gen.graph import AlphaTexture, Material, Mesh, Node, Primitive
from visref_datasets_gen.leaf_cards import NEAREST_M, leaf_picture, leaves
from visref_datasets_gen.png import png_bytes

pytestmark = pytest.mark.slow

# Every so many samples of the full image, to each side: enough for a share, few for NumPy.
STEP = 32


@pytest.fixture(scope="module")
def whole() -> Dataset:
    return leaves()


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (200, 300)])
def test_written_picture_is_read_back_by_others(shape: tuple[int, int]) -> None:
    alpha = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
    with Image.open(io.BytesIO(png_bytes(alpha))) as image:
        assert image.mode == "LA"
        assert np.array_equal(np.asarray(image.getchannel("A")), alpha)
        assert np.asarray(image.getchannel("L")).min() == 255


def test_leaves_end_before_the_edge_of_their_picture() -> None:
    rng = np.random.Generator(np.random.PCG64(3))
    for _ in range(4):
        picture = leaf_picture(rng)
        assert picture.shape == (256, 256)
        assert 0.3 < (picture >= 128).mean() < 0.7
        rim = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
        assert not rim.any()


def test_same_seed_same_bytes_and_another_seed_others() -> None:
    made = [leaves(seed=seed, scale=0.1, frames=3) for seed in (5, 5, 6)]
    files = [glb_bytes(dataset.nodes) for dataset in made]
    assert files[0] == files[1] != files[2]
    assert made[0].path.to_json() == made[1].path.to_json()


@pytest.mark.parametrize(
    ("settings", "line"), [({"scale": 0.0}, "the scale is 0.0"), ({"frames": 0}, "0 frames")]
)
def test_nothing_to_make_is_one_clear_line(settings: dict[str, Any], line: str) -> None:
    with pytest.raises(InputError, match=line):
        leaves(**settings)


def test_scene_in_memory_equals_the_file_loaded(tmp_path: Path) -> None:
    dataset = leaves(scale=0.05, frames=2)
    scene_file, _ = dataset.write(tmp_path)
    loaded = load_scene(scene_file)
    assert loaded.notes == ()
    assert loaded.masks is not None
    assert scene_of(dataset).digest == loaded.digest


def test_mirrored_cards_in_memory_equal_the_file_loaded(tmp_path: Path) -> None:
    picture = AlphaTexture(np.arange(12, dtype=np.uint8).reshape(3, 4))
    textured = Material("leaf", (1.0, 1.0, 1.0, 0.75), alpha=Alpha.MASK, texture=picture)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    faces = np.array([[0, 1, 2]])
    card = Primitive(corners, faces, textured, corners[:, :2] * np.float32(0.5))
    plain = Primitive(corners, faces, Material("plain", (1.0, 1.0, 1.0, 1.0)))
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    first, second = Mesh("first", (plain, card)), Mesh("second", (card,))
    nodes = (Node("a", first), Node("b", second, mirror), Node("c", first, mirror))
    dataset = Dataset("d", (*nodes, Node("d", first)), leaves(scale=0.01, frames=1).path)
    scene_file, _ = dataset.write(tmp_path)
    assert scene_of(dataset).digest == load_scene(scene_file).digest


def test_each_mesh_is_stored_once_and_each_crown_is_an_object(whole: Dataset) -> None:
    scene = scene_of(whole)
    assert scene.masks is not None
    assert len(scene.masks.arrays.textures) == 4
    crowns = [name for name in scene.names if name.endswith("/crown")]
    assert len(crowns) > 400
    masked = scene.masks.row >= 0
    assert np.array_equal(masked, scene.alpha == Alpha.MASK)
    assert masked.sum() > 50 * len(scene.masks.arrays.triangles)


def test_cards_are_from_one_to_fifty_metres_away(whole: Dataset) -> None:
    scene = scene_of(whole)
    cards = scene.vertices[scene.triangles[scene.alpha == Alpha.MASK]].astype(np.float64)
    # Finely enough that a point of a card is within 0.2 m of one of these.
    grid = np.array([(i, j, 16 - i - j) for i in range(17) for j in range(17 - i)]) / 16.0
    nearest, farthest = np.inf, 0.0
    for camera in whole.path.cameras[::6]:
        near = cards[np.linalg.norm(cards - camera.eye, axis=2).min(axis=1) < 8.0]
        points = np.einsum("gk,tkx->tgx", grid, near)
        nearest = min(nearest, float(np.linalg.norm(points - camera.eye, axis=2).min()))
        farthest = max(farthest, float(np.linalg.norm(cards - camera.eye, axis=2).max()))
    assert NEAREST_M <= nearest < 2.0
    assert farthest > 50.0


def met(scene: Scene, camera: Camera) -> list[tuple[int, NDArray[np.float64]]]:
    """For some of the samples: all triangles along the ray, and a and b of the sample."""
    corners = scene.vertices.astype(np.float64)[scene.triangles]
    p = corners[:, 0] - camera.eye
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    n = np.cross(e1, e2)
    above, across1, across2 = (n * p).sum(1), np.cross(e2, p), np.cross(p, e1)
    found = []
    for b in camera.row_b[STEP // 2 :: STEP]:
        for a in camera.column_a[STEP // 2 :: STEP]:
            way = camera.forward + a * camera.right_step + b * camera.up_step
            below = n @ way
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = above / below
                w1, w2 = across1 @ way / below, across2 @ way / below
                hit = (depth >= camera.near) & (w1 >= 0.0) & (w2 >= 0.0) & (w1 + w2 <= 1.0)
            along = np.flatnonzero(hit)
            found.append((along[np.argsort(depth[along])], np.array([a, b])))
    return found


def looked_up(scene: Scene, camera: Camera) -> list[tuple[NDArray[Any], NDArray[np.uint8]]]:
    """For some of the samples: all triangles along the ray, and what each is there."""
    assert scene.masks is not None
    found = met(scene, camera)
    along = np.concatenate([triangles for triangles, _ in found])
    samples = np.repeat([at for _, at in found], [len(one) for one, _ in found], axis=0)
    axes = np.stack([camera.eye, camera.forward, camera.right_step, camera.up_step])
    corners = scene.vertices.astype(np.float64)[scene.triangles]
    states = np.full(len(along), SOLID, np.uint8)
    masked = np.flatnonzero(scene.masks.row[along] >= 0)
    rows, places = scene.masks.row[along[masked]], corners[along[masked]]
    states[masked] = states_at(scene.masks, rows, axes, samples[masked], True, places)
    ends = np.cumsum([len(one) for one, _ in found])
    return list(zip(np.split(along, ends[:-1]), np.split(states, ends[:-1]), strict=True))


@pytest.mark.parametrize("frame", [0, 30, 59])
def test_at_most_a_fifth_of_the_owned_samples_is_in_doubt(whole: Dataset, frame: int) -> None:
    scene, camera = scene_of(whole), whole.path.cameras[frame]
    assert scene.masks is not None
    assert (camera.width, camera.height) == (1280, 960)
    owned = doubted = leaf = through = 0
    for along, states in looked_up(scene, camera):
        there = np.flatnonzero(states != HOLE)
        if not len(there):
            continue
        owned += 1
        first = there[0]
        # A doubt about any of the triangles before the first that is certain.
        doubted += bool(states[first] == BETWEEN)
        leaf += bool(states[first] == SOLID and scene.masks.row[along[first]] >= 0)
        through += bool(states[first] == SOLID and first > 0)
    assert doubted <= 0.2 * owned
    # And the scene is about leaves, and about what is seen through their holes.
    assert owned > 0.6 * len(camera.row_b[::STEP]) * len(camera.column_a[::STEP])
    assert leaf > 0.25 * owned
    assert through > 0.1 * owned


@pytest.fixture(scope="module")
def truths(whole: Dataset) -> dict[str, Any]:
    """The frame in the middle by two engines, at full size, and one judged drawn set each."""
    scene, camera = scene_of(whole), whole.path.cameras[30]
    found: dict[str, Any] = {}
    for name in ("exact", "embree"):
        engine = make_engine(name, scene)
        found[name] = engine.frame(camera).copy()
        engine.close()
    return found


@pytest.mark.parametrize("engine", ["exact", "embree"])
def test_whole_frame_of_an_engine_has_at_most_a_fifth_of_the_owned_samples_in_doubt(
    whole: Dataset, truths: dict[str, Any], engine: str
) -> None:
    truth = truths[engine]
    doubted = len(truth.undecided)
    owned = np.count_nonzero(truth.buffer.triangle.reshape(-1)[truth.decided] >= 0)
    assert 0.05 * (owned + doubted) < doubted <= 0.2 * (owned + doubted)


@pytest.mark.parametrize("engine", ["exact", "embree"])
def test_verdict_equals_the_brute_force_at_decided_samples(
    whole: Dataset, truths: dict[str, Any], engine: str
) -> None:
    """Owners along the brute force's rays, and whether each sample is lost with a third of the
    triangles left out."""
    scene, camera, truth = scene_of(whole), whole.path.cameras[30], truths[engine]
    assert scene.masks is not None
    units = Units(
        np.arange(scene.triangle_count + 1), np.arange(scene.triangle_count, dtype=np.int32), "each"
    )
    drawn = np.flatnonzero(np.arange(scene.triangle_count) % 3 > 0).astype(np.int32)
    exact = ExactScene(scene)
    settled = settle(scene, truth, DrawList.of_units(scene, units, drawn), exact=lambda: exact)
    lost, shown = set(settled.walk.lost_samples.tolist()), set(drawn.tolist())
    owner, open_ = truth.buffer.triangle.reshape(-1), set(truth.undecided.tolist())
    flat = np.arange(camera.samples).reshape(camera.height, camera.width)
    places = flat[STEP // 2 :: STEP, STEP // 2 :: STEP].reshape(-1).tolist()
    checked = losses = 0
    for sample, (along, states) in zip(places, looked_up(scene, camera), strict=True):
        there = np.flatnonzero(states != HOLE)
        in_doubt = len(there) > 0 and states[there[0]] == BETWEEN
        assert (sample in open_) == in_doubt
        if in_doubt:
            continue
        expected = along[there[0]] if len(there) else -1
        assert owner[sample] == expected
        checked += 1
        assert (sample in lost) == (expected >= 0 and expected not in shown)
        losses += sample in lost
    assert checked > 700
    assert losses > 100
