"""Alpha masks: solid is owned, a hole is nothing, in between is doubt, in every engine."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from tests.exact.test_exact_brute_force import assert_equal
from tests.support.exact_brute import hits, truth
from tests.support.exact_scenes import random_case
from tests.support.hand_made import judged, square
from tests.support.shares import share
from visref.camera import Camera, look_at
from visref.engines import make_engine
from visref.exact import ExactScene
from visref.masks.hits import states_at
from visref.masks.lookup import BETWEEN, HOLE, SOLID
from visref.masks.materials import MaskMaterial, Sampler
from visref.masks.store import Masks
from visref.masks.textures import AlphaImage
from visref.scene import Alpha, Scene

pytestmark = pytest.mark.slow

ENGINES = ["exact", "embree", "open3d"]


def engine_of(name: str, scene: Scene):
    if name == "open3d":
        pytest.importorskip("open3d")
    return make_engine(name, scene)


def image(*rows: list[int]) -> AlphaImage:
    return AlphaImage(np.array(rows, np.uint8), 255)


FULL, EMPTY = image([255]), image([0])
# Left half solid, right half nothing, 64 texels wide.
HALVES = image([255] * 32 + [0] * 32)


def masked(scene: Scene, texture: AlphaImage, *, nearest: bool = False) -> Scene:
    """The scene's masked triangles with a texture spread once over x and y of each object."""
    which = np.flatnonzero(scene.alpha == Alpha.MASK)
    row = np.full(scene.triangle_count, -1)
    row[which] = np.arange(len(which))
    corners = scene.vertices[scene.triangles[which], :2].astype(float)
    bounds = scene.object_bounds[scene.object_of_triangle[which]].astype(float)
    low, high = bounds[:, 0, None, :2], bounds[:, 1, None, :2]
    masks = Masks.build(
        row,
        np.zeros(len(which), int),
        (corners - low) / (high - low),
        np.ones((len(which), 3)),
        [MaskMaterial(0, Sampler(nearest=nearest))],
        [texture],
    )
    return replace(scene, masks=masks)


def leaf_before_wall() -> tuple[Scene, Camera]:
    """A leaf 16 pixels wide, 8 high, in the middle of 32 x 16; behind it glass, then a wall."""
    scene = Scene.from_objects(
        [
            ("leaf", square(-8.0, -4.0, 0.0, 1.0)[0] * (16, 8, 1) + (120, 28, 0), FACES),
            ("wall", *square(-40.0, -40.0, -5.0, 80.0)),
            ("glass", *square(-40.0, -40.0, -2.0, 80.0)),
            ("glass before", *square(-40.0, -40.0, 2.0, 80.0)),
        ]
    )
    kinds = np.array([Alpha.MASK, Alpha.OPAQUE, Alpha.BLEND, Alpha.BLEND], np.uint8)
    view = Camera(look_at((0, 0, 10.0), (0, 0, 0)), 32, 16, near=1.0, far=100.0, ymag=8.0)
    return replace(scene, alpha=np.repeat(kinds, 2)), view


FACES = square(0.0, 0.0, 0.0)[1]
BLOCK = np.zeros((16, 32), bool)
BLOCK[4:12, 8:24] = True
LEFT, RIGHT = BLOCK.copy(), BLOCK.copy()
LEFT[:, 16:] = RIGHT[:, :16] = False


def where(scene: Scene, truth_, obj: int) -> np.ndarray:
    result = np.zeros(BLOCK.size, bool)
    result[truth_.blend.sample[truth_.blend.object == obj]] = True
    return result.reshape(BLOCK.shape)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("kind", ["solid", "hole", "not known"])
def test_a_leaf_of_one_alpha_is_a_wall_or_nothing_or_unknown(engine, kind):
    scene, view = leaf_before_wall()
    if kind != "not known":
        scene = masked(scene, FULL if kind == "solid" else EMPTY)
    found = engine_of(engine, scene).frame(view)
    owner = scene.object_of_triangle[found.buffer.triangle]
    leaf = BLOCK if kind == "solid" else np.zeros_like(BLOCK)
    doubt = BLOCK if kind == "not known" else np.zeros_like(BLOCK)
    assert np.array_equal(owner, np.where(leaf, 0, 1))
    assert np.array_equal(found.buffer.depth, np.where(leaf, 10.0, 15.0))
    assert found.undecided.tolist() == np.flatnonzero(doubt).tolist()
    assert np.array_equal(where(scene, found, 2), ~(leaf | doubt))
    assert where(scene, found, 3).all()


@pytest.mark.parametrize("engine", ENGINES)
def test_a_leaf_of_two_halves_owns_one_lacks_the_other_and_doubts_the_seam(engine):
    scene, view = leaf_before_wall()
    scene = masked(scene, HALVES)
    found = engine_of(engine, scene).frame(view)
    owner = scene.object_of_triangle[found.buffer.triangle]
    doubt = np.zeros_like(BLOCK)
    doubt.reshape(-1)[found.undecided] = True
    # A pixel is four texels; the doubled footprint of the pixels beside the seam reaches it.
    # (The texture repeats, so the leaf's outer columns meet the other half, too.)
    seam = np.isin(np.arange(32), (8, 15, 16, 23))
    assert np.array_equal(doubt, BLOCK & seam)
    assert np.array_equal(owner == 0, LEFT & ~seam)
    assert np.array_equal(where(scene, found, 2), ~(LEFT & ~seam) & ~doubt)
    assert where(scene, found, 3).all()
    # What the leaf loses is lost for certain; its hole shows the wall; the seam is open.
    everything = np.arange(4)
    decided = judged(scene, found, scene.object_units(), everything[1:]).counts
    certain = int((LEFT & ~seam).sum())
    assert (decided.missed, decided.missed_pixels) == (1, certain)
    assert decided.undecided_samples == doubt.sum()
    bare = judged(scene, found, scene.object_units(), [0, 2, 3]).counts
    assert bare.missed_pixels == 32 * 16 - certain - doubt.sum()
    assert judged(scene, found, scene.object_units(), everything).counts.undecided_samples == 0
    # Neither leaf nor wall: the seam is lost too, since its last candidate is certain.
    assert judged(scene, found, scene.object_units(), [2, 3]).counts.missed_pixels == 32 * 16


@pytest.mark.parametrize("engine", ENGINES)
def test_a_solid_leaf_level_with_the_wall_ties_with_it(engine):
    scene, view = leaf_before_wall()
    vertices = scene.vertices.copy()
    vertices[:4, 2] = -5.0
    scene = masked(replace(scene, vertices=vertices), FULL)
    found = engine_of(engine, scene).frame(view)
    assert not len(found.undecided)
    assert (found.buffer.depth == 15.0).all()
    if engine == "exact":
        owner = scene.object_of_triangle[found.buffer.triangle]
        assert np.array_equal(owner == 0, BLOCK)
        with_wall = found.ties.sample[scene.object_of_triangle[found.ties.triangle] == 1]
        # Elsewhere the wall's two triangles may tie.
        assert set(np.flatnonzero(BLOCK)) <= set(with_wall.tolist())


def random_masks(rng: np.random.Generator, scene: Scene) -> Scene:
    """More masks than `random_case` has, some unknown, with textures of few texels."""
    count = scene.triangle_count
    alpha = rng.choice(np.array([0, 1, 1, 1, 2], np.uint8), count)
    which = np.flatnonzero(alpha == Alpha.MASK)
    row = np.full(count, -1)
    row[which] = np.arange(len(which))
    row[which[rng.random(len(which)) < 0.1]] = -1
    textures = [FULL, EMPTY, HALVES, AlphaImage(rng.integers(0, 2, (4, 4)).astype(np.uint8), 1)]
    masks = Masks.build(
        row,
        rng.integers(0, 4, len(which)),
        rng.uniform(-1.0, 1.0, (len(which), 3, 2)) * rng.choice([0.01, 0.1, 1.0]),
        np.ones((len(which), 3)),
        [MaskMaterial(i, Sampler(nearest=bool(i % 2))) for i in range(4)],
        textures,
    )
    return replace(scene, alpha=alpha, masks=masks)


def states_of(scene: Scene, camera: Camera) -> dict[tuple[int, int], int]:
    """What visref.masks says of every hit of a masked triangle."""
    pairs = [
        (sample, i)
        for sample, here in enumerate(hits(scene, camera))
        for _, i in here
        if scene.alpha[i] == Alpha.MASK
    ]
    states = dict.fromkeys(pairs, BETWEEN)
    known = [(s, i) for s, i in pairs if scene.masks.row[i] >= 0]
    sample, triangle = (np.array([p[k] for p in known], int) for k in (0, 1))
    y, x = np.divmod(sample, camera.width)
    found = states_at(
        scene.masks,
        scene.masks.row[triangle],
        np.stack([camera.eye, camera.forward, camera.right_step, camera.up_step]),
        np.stack([camera.column_a[x], camera.row_b[y]], axis=1),
        camera.is_perspective,
        scene.vertices[scene.triangles[triangle]].astype(float),
    )
    return states | dict(zip(known, found.tolist(), strict=True))


@pytest.mark.parametrize("chunk", share(range(4), 1, of=2))
def test_random_masked_scenes_equal_the_brute_force(chunk):
    seen: Counter[str] = Counter()
    for index in range(100):
        scene, camera = random_case(60 + chunk, index)
        scene = random_masks(np.random.default_rng([60 + chunk, index]), scene)
        states = states_of(scene, camera)
        expectation = truth(scene, camera, states)
        exact = ExactScene(scene, threads=1)
        rng = np.random.default_rng(index)
        some = np.flatnonzero(rng.random(camera.samples) < 0.3)
        try:
            frame = exact.certify(camera)
            seen += assert_equal(scene, camera, frame, expectation)
            part = exact.certify(camera, some)
        except AssertionError as error:
            raise AssertionError(f"case ({60 + chunk}, {index}): {error}") from error
        for name in ("triangle", "depth"):
            whole, few = getattr(frame.buffer, name), getattr(part.buffer, name)
            assert np.array_equal(whole.reshape(-1)[some], few.reshape(-1)[some])
        for name, key in (("ties", "sample"), ("blend", "sample")):
            whole, few = getattr(frame, name), getattr(part, name)
            kept, there = np.isin(getattr(whole, key), some), np.isin(getattr(few, key), some)
            assert getattr(whole, key)[kept].tolist() == getattr(few, key)[there].tolist()
            assert whole.triangle[kept].tolist() == few.triangle[there].tolist()
        kept, there = np.isin(frame.doubt.at(), some), np.isin(part.doubt.at(), some)
        assert frame.doubt.triangle[kept].tolist() == part.doubt.triangle[there].tolist()
        seen.update({SOLID: "states solid", HOLE: "states hole", BETWEEN: "states between"}[s]
                    for s in states.values())  # fmt: skip
    wanted = ("tied", "solid", "undecided", "doubted twice", "blended")
    assert min(seen[kind] for kind in wanted) > 15
    assert min(seen[f"states {kind}"] for kind in ("solid", "hole", "between")) > 200


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("engine", ["embree", "open3d"])
def test_rays_and_exact_agree_on_scattered_masked_triangles(engine, seed):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(60, 1, 3)) * 3 + rng.normal(size=(60, 3, 3))
    scene = Scene.from_objects(
        [
            (f"t{i}", corners[3 * i : 3 * i + 3].reshape(-1, 3), np.arange(9).reshape(3, 3))
            for i in range(20)
        ]
    )
    scene = random_masks(rng, scene)
    view = Camera(look_at((0, 2, 12), (0, 0, 0)), 64, 48, 0.5, 30.0, yfov=0.9)
    exact = make_engine("exact", scene).frame(view)
    rays = engine_of(engine, scene).frame(view)
    assert np.array_equal(exact.buffer.triangle, rays.buffer.triangle)
    assert np.allclose(exact.buffer.depth, rays.buffer.depth, rtol=1e-12)
    assert np.array_equal(exact.doubt.offsets, rays.doubt.offsets)
    assert np.array_equal(exact.doubt.triangle, rays.doubt.triangle)
    for name in ("object", "sample", "triangle"):
        assert np.array_equal(getattr(exact.blend, name), getattr(rays.blend, name))
    solid = scene.alpha[exact.buffer.triangle[exact.buffer.triangle >= 0]] == Alpha.MASK
    assert min(np.count_nonzero(solid), len(exact.doubt), len(exact.blend.object)) > 20
