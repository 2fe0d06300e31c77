"""The item buffer follows a scene from moment to moment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.motion import moments
from tests.support.truth_scenes import random_soup
from visref.camera import Camera, look_at
from visref.conformance.suite import built_case
from visref.scene import Scene
from visref.visibility import FrameTruth
from visref_culling.gl.item_buffer import GLRaster
from visref_culling.item_buffer_engine import ItemBufferEngine

CAMERA = Camera(look_at((0, 0, 3), (0, 0, -5)), 64, 48, 0.5, 40.0, yfov=1.2)


def contents(truth: FrameTruth) -> list[bytes]:
    arrays = [truth.buffer.triangle, truth.buffer.depth]
    arrays += [getattr(truth.doubt, n) for n in ("sample", "offsets", "triangle")]
    arrays += [getattr(truth.blend, n) for n in ("object", "sample", "triangle", "depth")]
    return [array.tobytes() for array in (*arrays, truth.veiled)]


def mixed(seed: int) -> Scene:
    soup = random_soup(seed, triangles=120)
    rng = np.random.default_rng(seed)
    return replace(
        soup,
        one_sided=rng.random(120) < 0.3,
        alpha=rng.choice(np.array([0, 0, 0, 1, 2], np.uint8), 120),
    )


@pytest.mark.parametrize("share", [0.2, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_posed_gl_engine_is_one_made_of_the_pose(seed: int, share: float) -> None:
    scenes = moments(mixed(seed), seed, 4, share=share)
    engine = ItemBufferEngine(scenes[0])
    seen = set()
    for scene in [*scenes[1:], scenes[0]]:
        engine.pose(scene)
        fresh = ItemBufferEngine(scene)
        found = contents(engine.frame(CAMERA))
        assert found == contents(fresh.frame(CAMERA))
        fresh.close()
        seen.add(tuple(found))
    assert len(seen) == 4
    engine.close()


@pytest.mark.parametrize("name", ["through_the_holes_of_a_mask", "glass", "one_sided_walls"])
def test_masks_and_glass_move_in_gl_too(name: str) -> None:
    built, _ = built_case(name, 0)
    scenes = moments(built.scene, 1, 4, share=0.7, size=0.3)
    engine, raster = ItemBufferEngine(scenes[0]), GLRaster(scenes[0])
    raster.item_buffer(built.path.cameras[0])
    for scene in scenes[1:]:
        engine.pose(scene)
        raster.pose(scene)
        fresh, other = ItemBufferEngine(scene), GLRaster(scene)
        drawn = np.arange(scene.triangle_count) % 3 > 0
        for camera in built.path:
            assert contents(engine.frame(camera)) == contents(fresh.frame(camera))
            np.testing.assert_array_equal(raster.item_buffer(camera), other.item_buffer(camera))
            np.testing.assert_array_equal(raster.image(camera, drawn), other.image(camera, drawn))
            np.testing.assert_array_equal(
                engine.items.whole_image(camera), fresh.items.whole_image(camera)
            )
        fresh.close()
        other.close()
    engine.close()
    raster.close()


def test_other_objects_than_at_first_cannot_be_posed() -> None:
    soup = random_soup(1)
    some = np.arange(soup.object_count) < 2
    engine = ItemBufferEngine(replace(soup, moving=some))
    with pytest.raises(ValueError, match="other objects move"):
        engine.pose(replace(soup, moving=~some))
    engine.close()
