"""Alpha masks drawn by shader, against the exact engine and against lookups one by one."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from tests.support.culling_scenes import QUAD_FACES, ortho, perspective, quad
from visref.camera import Camera, look_at
from visref.culler import QueryStats
from visref.engines.exact import ExactEngine
from visref.masks.lookup import BETWEEN, HOLE, SOLID
from visref.masks.materials import MaskMaterial, Sampler, Wrap
from visref.masks.store import Masks
from visref.masks.textures import AlphaImage
from visref.scene import Alpha, Scene
from visref.visibility import BACKGROUND, mask_states
from visref_culling.gl.device import State, device
from visref_culling.gl.geometry import Geometry, occluders
from visref_culling.gl.item_buffer import GLRaster
from visref_culling.gl.layers import Layers
from visref_culling.gl.solid_masks import least_bytes
from visref_culling.gl.view import View
from visref_culling.item_buffer_engine import ItemBufferEngine

pytestmark = [pytest.mark.gl, pytest.mark.slow]

WRAPS = (Wrap.REPEAT, Wrap.MIRRORED_REPEAT, Wrap.CLAMP_TO_EDGE)
CORNER_UV = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])


def texture(*rows: list[int], times: int = 16, scale: int = 255) -> AlphaImage:
    """Each number a block of `times` by `times` texels."""
    blocks = np.array(rows, np.uint8 if scale == 255 else np.uint16)
    return AlphaImage(np.kron(blocks, np.ones((times, times), blocks.dtype)), scale)


PICTURES = {
    "solid": texture([255]),
    "hole": texture([0]),
    "halves": texture([255, 0]),
    "corner": texture([0, 0, 0], [0, 255, 0]),
    "16 bits": texture([65535, 0], [0, 40000], scale=65535),
}


def masked(
    scene: Scene,
    image: AlphaImage,
    uv: np.ndarray,
    *,
    vertex_alpha: float | np.ndarray = 1.0,
    unknown: str = "",
    **sampler,
) -> Scene:
    """The scene with this mask on its MASK triangles; `uv` (k, 3, 2) of these."""
    which = np.flatnonzero(scene.alpha == Alpha.MASK)
    row = np.full(scene.triangle_count, -1)
    row[which] = np.arange(len(which))
    alpha = np.broadcast_to(vertex_alpha, (len(which), 3))
    material = MaskMaterial(0, Sampler(**sampler), unknown=unknown)
    return replace(
        scene, masks=Masks.build(row, np.zeros(len(which)), uv, alpha, [material], [image])
    )


def card_before_wall(
    image: AlphaImage,
    *,
    stretch: tuple[float, float] = (1.0, 1.0),
    shift: tuple[float, float] = (0.0, 0.0),
    **options,
) -> Scene:
    """In 40 x 32 pixels of a world unit each a card of 32 x 24, glass before it and behind it,
    and a wall with a poster before it."""
    scene = Scene.from_objects(
        [
            ("card", *quad((-16, -12), (16, 12), -4.0)),
            ("wall", *quad((-19, -15), (19, 15), -8.0)),
            ("poster", *quad((-8, -8), (0, 8), -7.0)),
            ("glass before", *quad((-6, -6), (18, 6), -3.0)),
            ("glass behind", *quad((-6, -14), (18, 14), -5.0)),
        ]
    )
    kinds = [Alpha.MASK, Alpha.OPAQUE, Alpha.OPAQUE, Alpha.BLEND, Alpha.BLEND]
    scene = replace(scene, alpha=np.repeat(np.array(kinds, np.uint8), 2))
    uv = (CORNER_UV * stretch + shift)[np.array(QUAD_FACES)]
    return masked(scene, image, uv, **options)


def view() -> Camera:
    return Camera(np.eye(4), 40, 32, near=1.0, far=100.0, ymag=16.0)


def objects(scene: Scene, ids: np.ndarray) -> np.ndarray:
    return np.where(ids == BACKGROUND, -1, scene.object_of_triangle[ids])


def exact_frame(scene: Scene, camera: Camera):
    engine = ExactEngine(scene)
    frame = engine.frame(camera).copy()
    engine.close()
    return frame


def gl_frame(scene: Scene, camera: Camera):
    engine = ItemBufferEngine(scene)
    frame = engine.frame(camera).copy()
    engine.close()
    return frame


def assert_picture_is_the_truth(scene: Scene, camera: Camera) -> np.ndarray:
    """At decided samples. Returns which are owned by a masked triangle, and the doubt."""
    frame = exact_frame(scene, camera)
    raster = GLRaster(scene)
    found = objects(scene, raster.item_buffer(camera)).reshape(-1)
    raster.close()
    owner = objects(scene, frame.buffer.triangle).reshape(-1)
    assert np.array_equal(found[frame.decided], owner[frame.decided])
    return np.stack([owner == 0, ~frame.decided])


@pytest.mark.parametrize("picture", PICTURES)
@pytest.mark.parametrize("nearest", [False, True])
def test_item_buffer_has_the_exact_owner_at_decided_samples(picture, nearest):
    scene = card_before_wall(PICTURES[picture], nearest=nearest)
    own, open_ = assert_picture_is_the_truth(scene, view())
    shares = {"solid": 1.0, "hole": 0.0, "halves": 1 / 2, "corner": 1 / 6, "16 bits": 1 / 2}
    # Undecided ones lie along the borders of blocks and, as the texture repeats, of the card.
    assert abs(own.sum() / (32 * 24) - shares[picture]) <= open_.sum() / (32 * 24)
    assert (open_.sum() == 0) == (picture in ("solid", "hole"))


@pytest.mark.parametrize(("wrap_s", "wrap_t"), list(product(WRAPS, WRAPS)))
def test_item_buffer_wraps_as_the_sampler_says(wrap_s, wrap_t):
    picture = texture([255, 0, 0], [0, 0, 255])
    scene = card_before_wall(
        picture, stretch=(3.0, -2.4), shift=(-1.3, 1.7), wrap_s=wrap_s, wrap_t=wrap_t
    )
    own, open_ = assert_picture_is_the_truth(scene, view())
    assert own.sum() > 20
    assert (~own & ~open_).sum() > 100


def test_item_buffer_takes_vertex_alpha_into_account():
    fading = np.array([1.0, 0.0, 0.0, 1.0])[np.array(QUAD_FACES)]
    scene = card_before_wall(PICTURES["solid"], vertex_alpha=fading)
    own, open_ = assert_picture_is_the_truth(scene, view())
    assert 0.4 * 32 * 24 < own.sum() < 0.5 * 32 * 24
    assert open_.any()


@pytest.mark.parametrize("turned", [False, True])
def test_one_sided_masks_show_their_front_alone(turned):
    scene = card_before_wall(PICTURES["halves"])
    sided = np.zeros(scene.triangle_count, bool)
    sided[:2] = True
    triangles = scene.triangles.copy()
    masks = scene.masks
    if turned:
        triangles[:2] = triangles[:2, ::-1]
        uv = masks.arrays.triangles["uv"][:, ::-1]
        scene = masked(replace(scene, triangles=triangles), PICTURES["halves"], uv)
    scene = replace(scene, one_sided=sided)
    own, _ = assert_picture_is_the_truth(scene, view())
    assert own.any() != turned


@pytest.mark.parametrize("picture", [*PICTURES, "not known"])
@pytest.mark.parametrize("vertex_alpha", [1.0, 0.55])
def test_engine_says_what_the_exact_one_says(picture, vertex_alpha):
    scene = card_before_wall(
        PICTURES.get(picture, PICTURES["solid"]),
        vertex_alpha=vertex_alpha,
        unknown="no decoder" if picture == "not known" else "",
    )
    exact, found = exact_frame(scene, view()), gl_frame(scene, view())
    owners = [objects(scene, frame.buffer.triangle) for frame in (found, exact)]
    assert np.array_equal(*owners)
    assert np.allclose(found.buffer.depth, exact.buffer.depth, rtol=1e-5)
    assert found.undecided.tolist() == exact.undecided.tolist()
    assert found.doubt.offsets.tolist() == exact.doubt.offsets.tolist()
    assert found.blend.object.tolist() == exact.blend.object.tolist()
    assert found.blend.sample.tolist() == exact.blend.sample.tolist()


def leaf_cloud(seed: int, count: int = 80) -> Scene:
    """Cards at random before the camera, with any texture coordinates, wraps and sides."""
    rng = np.random.default_rng(seed)
    made, uv = [], []
    for number in range(count):
        middle = rng.uniform((-4, -3, -30), (4, 3, -3))
        points = middle + rng.uniform(-1.0, 1.0, (4, 3)) * rng.uniform(0.3, 3.0)
        points[2] = points[1] + points[3] - points[0]
        made.append((f"card {number}", points, np.array(QUAD_FACES)))
        corners = CORNER_UV * rng.choice([0.3, 1.0, 4.0], 2) * rng.choice([-1, 1], 2)
        uv.append((corners + rng.uniform(-5.0, 5.0, 2))[np.array(QUAD_FACES)])
    scene = Scene.from_objects(made)
    scene = replace(
        scene,
        alpha=np.full(scene.triangle_count, Alpha.MASK, np.uint8),
        one_sided=rng.random(scene.triangle_count) < 0.3,
    )
    images = [
        AlphaImage((rng.random((h, w)) < 0.7).astype(np.uint8) * np.uint8(255), 255)
        for h, w in ((7, 5), (3, 20))
    ]
    images += [texture([255, 0], [255, 255], times=30), texture([40000, 0], times=9, scale=65535)]
    materials = [
        MaskMaterial(int(rng.integers(4)), Sampler(*rng.permutation(WRAPS)[:2], nearest=near))
        for near in (False, True) * 6
    ]
    total = scene.triangle_count
    masks = Masks.build(
        np.arange(total),
        np.arange(total) // 2 % len(materials),
        np.concatenate(uv),
        rng.uniform(0.8, 1.0, (total, 3)),
        materials,
        images,
    )
    return replace(scene, masks=masks)


def cameras() -> dict[str, Camera]:
    tilted = look_at((0.3, -0.2, 1.0), (0.0, 0.5, -9.0))
    return {
        "perspective": Camera(tilted, 64, 48, near=0.5, far=100.0, yfov=1.0),
        "orthographic": Camera(tilted, 64, 48, near=0.5, far=100.0, ymag=4.0),
        "shifted": Camera(
            tilted, 50, 40, near=0.5, far=100.0, yfov=0.6, shift_x_px=7.25, shift_y_px=-3.5
        ),
    }


def depth_of_masks(scene: Scene, camera: Camera, unit: int) -> np.ndarray:
    gl = device()
    geometry = Geometry(gl, scene, scene.object_units(), occluders(scene))
    target = gl.target(camera.width, camera.height, 32, "f1")
    gl.clear(State(target.framebuffer, geometry.program))
    seen = View.of(camera, scene, gl.subpixel_bits)
    geometry.draw_depth(seen, target, np.array([unit]), QueryStats())
    geometry.release()
    return target.read_depth()


@pytest.mark.parametrize("kind", ["perspective", "orthographic", "shifted"])
@pytest.mark.parametrize("seed", range(3))
def test_masks_hide_only_where_they_are_solid_for_certain(kind, seed):
    camera = cameras()[kind]
    scene = leaf_cloud(seed)
    gl = device()
    vertices = gl.context.buffer(scene.vertices.tobytes())
    one, total = np.zeros(scene.triangle_count, bool), {HOLE: 0, SOLID: 0, BETWEEN: 0}
    written = 0
    seen = View.of(camera, scene, gl.subpixel_bits)
    for unit in range(scene.object_count):
        one[:] = scene.object_of_triangle == unit
        depth = depth_of_masks(scene, camera, unit).reshape(-1)
        layers = Layers(gl, scene, vertices, one)
        target = gl.target(camera.width, camera.height, 32, "i4")
        gl.clear(State(target.framebuffer, layers.program))
        hits = layers.before(seen, target)
        layers.release()
        states = mask_states(scene, camera, hits.sample, hits.triangle)
        solid = np.zeros(camera.samples, bool)
        solid[hits.sample[states == SOLID]] = True
        assert not ((depth < 1.0) & ~solid).any()
        for state in total:
            total[state] += int(np.count_nonzero(states == state))
        written += int(np.count_nonzero(depth < 1.0))
    vertices.release()
    assert min(total.values()) > 20
    # The rest is lost by thin triangles, and by looking up 24 blocks at most, against 256 there.
    assert written > 0.5 * total[SOLID]


def test_a_mask_hides_with_the_depth_of_its_triangle():
    scene = card_before_wall(PICTURES["halves"])
    depth = depth_of_masks(scene, view(), 0)
    exact = exact_frame(scene, view())
    owned = (exact.buffer.triangle >= 0) & (scene.alpha[exact.buffer.triangle] == Alpha.MASK)
    assert np.array_equal(depth < 1.0, owned)
    whole = replace(scene, alpha=np.zeros(scene.triangle_count, np.uint8), masks=None)
    assert np.array_equal(depth[owned], depth_of_masks(whole, view(), 0)[owned])


def test_what_is_solid_everywhere_occludes_as_if_opaque():
    for picture, vertex_alpha, expected in (
        ("solid", 1.0, True),
        ("solid", 0.4, False),
        ("halves", 1.0, False),
        ("hole", 1.0, False),
    ):
        scene = card_before_wall(PICTURES[picture], vertex_alpha=vertex_alpha)
        assert occluders(scene)[:2].all() == expected
        assert occluders(scene).sum() == 4 + 2 * expected
    unknown = card_before_wall(PICTURES["solid"], unknown="no decoder")
    assert occluders(unknown).sum() == 4


def test_masks_without_room_in_a_storage_block_hide_nothing():
    scene = leaf_cloud(0)
    sizes = [a * b for a, b in ((7, 5), (3, 20))]
    data, textures, _, kept = least_bytes(scene.masks, 10_000)
    assert kept.all()
    assert textures[:, :2].tolist() == [[5, 7], [20, 3], [60, 60], [18, 9]]
    data, _, _, kept = least_bytes(scene.masks, 2 * sum(sizes))
    assert kept.tolist() == [True, True, False, False]
    assert sum(sizes) < len(data) <= 2 * sum(sizes)


def test_masks_are_drawn_once_into_the_image_and_count_once():
    scene = card_before_wall(PICTURES["halves"])
    gl = device()
    target = gl.target(40, 32, 24)
    seen = View.of(view(), scene, gl.subpixel_bits)
    counts = []
    for made in (scene, replace(scene, masks=None)):
        geometry = Geometry(gl, made, made.object_units(), occluders(made))
        gl.clear(State(target.framebuffer, geometry.program))
        stats = QueryStats()
        geometry.draw(seen, target, np.arange(5), stats)
        image = np.frombuffer(target.framebuffer.read(components=1), np.uint8).copy()
        fragments = geometry.fragments(seen, target, np.arange(5))
        geometry.release()
        counts.append((stats.triangles_drawn, stats.units_drawn, fragments, image.tobytes()))
    assert counts[0] == counts[1]
    assert counts[0][:2] == (10, 5)


def test_hits_are_the_same_through_a_small_buffer():
    camera = perspective(64, 48)
    scene = leaf_cloud(1)
    gl = device()
    vertices = gl.context.buffer(scene.vertices.tobytes())
    layers = Layers(gl, scene, vertices, np.ones(scene.triangle_count, bool))
    target = gl.target(64, 48, 32, "i4")
    gl.clear(State(target.framebuffer, layers.program))
    seen = View.of(camera, scene, gl.subpixel_bits)
    whole = layers.before(seen, target)
    layers.release()
    layers = Layers(gl, scene, vertices, np.ones(scene.triangle_count, bool))
    layers.most = int(np.bincount(whole.triangle).max())
    assert layers.most < len(whole.sample) / 4
    parts = layers.before(seen, target)
    layers.release()
    vertices.release()
    for a, b in zip(whole, parts, strict=True):
        assert np.array_equal(a, b)


def test_the_picture_shows_through_holes_and_loses_what_is_left_out():
    scene = card_before_wall(PICTURES["halves"])
    raster = GLRaster(scene)
    whole = raster.image(view(), np.ones(scene.triangle_count, bool))
    # A wall without its poster is another picture only since a hole shows the poster.
    left, right = whole[4:28, 4:20], whole[4:28, 20:36]
    assert np.isin(objects(scene, left), (0, 3)).all()
    assert not np.isin(objects(scene, right[:, 1:-1]), 0).any()
    for name, same in (("card", False), ("poster", True), ("wall", False)):
        kept = scene.object_of_triangle != scene.id_of_name[name]
        assert np.array_equal(raster.image(view(), kept), whole) is same
    raster.close()


def test_an_orthographic_engine_agrees_with_a_perspective_one_on_a_flat_card():
    scene = card_before_wall(PICTURES["corner"])
    found = gl_frame(scene, ortho(40, 32))
    assert np.array_equal(found.undecided, exact_frame(scene, ortho(40, 32)).undecided)
