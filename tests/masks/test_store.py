"""Materials and the arrays that kernels read."""

from __future__ import annotations

import math

import numpy as np
import pytest

from visref.errors import InputError
from visref.masks.materials import MaskMaterial, Sampler, TextureTransform, Wrap
from visref.masks.store import Masks
from visref.masks.textures import AlphaImage


def some_masks(**changes: object) -> Masks:
    random = np.random.default_rng(4)
    parts: dict[str, object] = {
        "row": [-1, 0, 1, -1, 2],
        "material": [0, 1, 1],
        "uv": random.uniform(size=(3, 3, 2)),
        "vertex_alpha": random.uniform(size=(3, 3)),
        "materials": [
            MaskMaterial(0, Sampler(nearest=True)),
            MaskMaterial(1, Sampler(Wrap.CLAMP_TO_EDGE, Wrap.MIRRORED_REPEAT), 0.5, 0.25),
        ],
        "images": [
            AlphaImage(random.integers(0, 256, (5, 3)).astype(np.uint8), 255),
            AlphaImage(random.integers(0, 65536, (1, 6)).astype(np.uint16), 65535),
        ],
    }
    return Masks.build(**(parts | changes))  # type: ignore[arg-type]


def test_pyramid_holds_the_extremes_of_blocks() -> None:
    random = np.random.default_rng(1)
    shapes = [(1, 1), (1, 2), (5, 3), (9, 17), (16, 16), (33, 2)]
    images = [random.integers(0, 65536, shape).astype(np.uint16) for shape in shapes]
    arrays = some_masks(images=[AlphaImage(image, 65535) for image in images]).arrays
    for image, entry in zip(images, arrays.textures, strict=True):
        width, height, scale, first, count = entry.tolist()
        assert (height, width, scale) == (*image.shape, 65535)
        assert 2 ** (count - 1) >= max(image.shape) > 2 ** (count - 1) / 2
        for k in range(count):
            low, high, stride = arrays.levels[first + k].tolist()
            for y in range(-(-height // 2**k)):
                for x in range(-(-width // 2**k)):
                    block = image[y << k : (y + 1) << k, x << k : (x + 1) << k]
                    assert arrays.alpha[low + y * stride + x] == block.min()
                    assert arrays.alpha[high + y * stride + x] == block.max()


def test_image_of_one_alpha_is_one_texel() -> None:
    images = [AlphaImage(np.full((64, 32), 255, np.uint8), 255)] * 2
    textures = some_masks(images=images).arrays.textures
    assert [entry.tolist()[:3] for entry in textures] == [(1, 1, 255)] * 2


def test_arrays_are_read_only() -> None:
    masks = some_masks()
    for array in (masks.row, *masks.arrays):
        assert not array.flags.writeable
        assert not masks.take([0, 1]).row.flags.writeable


def test_digest_follows_everything_that_decides_a_lookup() -> None:
    base = some_masks()
    assert base.digest == some_masks().digest
    assert len(base.digest) == 32
    first, second = MaskMaterial(0, Sampler(nearest=True)), MaskMaterial(1)
    image = AlphaImage(np.arange(6, dtype=np.uint8).reshape(2, 3), 255)
    different = (
        {"row": [-1, 1, 0, -1, 2]},
        {"material": [0, 0, 1]},
        {"uv": np.zeros((3, 3, 2))},
        {"vertex_alpha": np.ones((3, 3))},
        {"materials": [first, second]},
        {"materials": [first, MaskMaterial(1, factor=0.5)]},
        {"materials": [first, MaskMaterial(1, cutoff=0.25)]},
        {"materials": [first, MaskMaterial(1, Sampler(Wrap.CLAMP_TO_EDGE))]},
        {"materials": [first, MaskMaterial(1, unknown="lost")]},
        {"images": [image, image]},
        {"images": [image, AlphaImage(image.alpha.astype(np.uint16), 65535)]},
        {"images": [image, AlphaImage(image.alpha.reshape(3, 2), 255)]},
    )
    digests = [base.digest, *(some_masks(**changes).digest for changes in different)]
    assert len(set(digests)) == len(digests)


def test_taken_triangles_keep_their_masks() -> None:
    masks = some_masks()
    chosen = np.array([4, 0, 1, 4])
    part = masks.take(chosen)
    assert len(part.arrays.triangles) == 2
    for new, old in enumerate(masks.row[chosen]):
        row = part.row[new]
        assert (row < 0) == (old < 0)
        if row >= 0:
            assert part.arrays.triangles[row] == masks.arrays.triangles[old]
    assert np.array_equal(masks.take(np.array([1, 1, 0, 0, 1], bool)).row, [-1, 0, 1])
    none = masks.take(np.zeros(0, int))
    assert len(none.row) == len(none.arrays.triangles) == 0


@pytest.mark.parametrize(
    "changes", [{"row": [3]}, {"row": [-2]}, {"material": [0, 1, 2]}, {"images": []}]
)
def test_index_out_of_range_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="outside"):
        some_masks(**changes)


@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
def test_factor_and_cutoff_are_numbers_from_zero(value: float) -> None:
    with pytest.raises(InputError, match="factor"):
        MaskMaterial(factor=value)
    with pytest.raises(InputError, match="cutoff"):
        MaskMaterial(cutoff=value)


def test_transform_shows_the_quadrant_of_the_specifications_example() -> None:
    # "Only the lower left quadrant of the source image, rotated clockwise 90 degrees."
    transform = TextureTransform((0.0, 1.0), math.pi / 2, (0.5, 0.5))
    corners = transform.apply(np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32))
    # Top left shows what is bottom left in the image, and so on clockwise.
    wanted = [[0, 1], [0, 0.5], [0.5, 0.5], [0.5, 1]]
    assert np.allclose(corners, wanted, rtol=0, atol=1e-15)


def test_transform_scales_before_it_rotates_and_rotates_before_it_moves() -> None:
    random = np.random.default_rng(8)
    for _ in range(20):
        offset, scale = random.uniform(-2, 2, (2, 2))
        angle = float(random.uniform(-7, 7))
        uv = random.uniform(-2, 2, (5, 3, 2))
        # Upwards, as an image is seen, a turn by the angle is counter-clockwise.
        turned = (uv[..., 0] * scale[0] - 1j * uv[..., 1] * scale[1]) * np.exp(1j * angle)
        wanted = np.stack([turned.real + offset[0], -turned.imag + offset[1]], axis=-1)
        found = TextureTransform(tuple(offset), angle, tuple(scale)).apply(uv)
        assert np.allclose(found, wanted, rtol=0, atol=1e-14)


def test_transform_that_says_nothing_changes_nothing() -> None:
    uv = np.array([[0.1, 0.7]], np.float32)
    assert np.array_equal(TextureTransform().apply(uv), uv.astype(np.float64))
