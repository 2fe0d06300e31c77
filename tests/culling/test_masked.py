"""The masked depth buffer against a depth for each pixel, and the culler that uses it."""

from __future__ import annotations

import numpy as np
import pytest

from visref.camera import Camera
from visref.conformance import case
from visref.conformance.scenes import camera as camera_at
from visref.conformance.scenes import pixel_panel
from visref.registry import make_culler
from visref.scene import Scene
from visref_culling.gl.view import View
from visref_culling.masked.buffer import MaskedBuffer, decide
from visref_culling.queries.software_depth import SoftwareBuffer, mesh_of, rays_of

pytestmark = pytest.mark.gl


def test_an_empty_buffer_hides_nothing_and_knows_its_rim():
    buffer = MaskedBuffer.of(13, 6)
    assert buffer.mask.shape == (2, 2)
    assert np.isinf(buffer.bounds(13, 6)).all()
    pixels = [bin(int(full)).count("1") for full in buffer.full.ravel()]
    assert pixels == [32, 5 * 4, 8 * 2, 5 * 2]


def rasterised(scene: Scene, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """What the masked buffer says of each pixel when all of a scene's objects are in it, and the
    depth of each pixel alone: by the same samples, joined in another way."""
    view = View.of(camera, scene, 8)
    units = scene.object_units()
    occludes = np.ones(scene.triangle_count, np.bool_)
    masked = MaskedBuffer.of(camera.width, camera.height)
    count = units.count
    decide(
        mesh_of(scene, occludes), rays_of(view), units.offsets, units.triangles,
        np.arange(count), np.zeros((count, 4), np.int32), np.zeros(count),
        np.ones(count, np.bool_), 0, masked, np.zeros(count, np.bool_),
    )  # fmt: skip
    each = SoftwareBuffer(scene, units, occludes, marks_only=False)
    each.view = view
    each.depth = np.full((camera.height, camera.width), np.inf, np.float32)
    each.drawn(np.arange(count))
    return masked.bounds(camera.width, camera.height), each.depth


@pytest.mark.parametrize("seed", range(8))
def test_no_pixels_bound_is_nearer_than_its_nearest_occluder(seed):
    rng = np.random.default_rng(seed)
    view = camera_at(width=61, height=47) if seed % 2 else camera_at()
    if seed % 4 == 3:
        view = camera_at(ymag=4.0)
    objects = []
    for k in range(60):
        x, y = rng.uniform(-8.0, 60.0), rng.uniform(-8.0, 45.0)
        wide, high = rng.uniform(2.0, 40.0, 2)
        mesh = pixel_panel(view, (x, x + wide), (y, y + high), float(rng.uniform(3.0, 60.0)))
        objects.append((f"{k}", *mesh))
    bounds, nearest = rasterised(Scene.from_objects(objects), view)
    assert (bounds >= nearest).all()
    # Coarser than a depth for each pixel, and of use: it bounds most of what that does.
    assert np.isfinite(bounds).sum() > 0.8 * np.isfinite(nearest).sum()
    assert (bounds == nearest).any()


def test_in_a_city_it_hides_a_quarter_of_what_is_in_view_and_more():
    scene, path = case("walk_through_a_city")
    drawn = []
    for spec in ("masked-occlusion", "frustum"):
        culler = make_culler(spec)
        culler.prepare(scene)
        drawn.append(sum(len(culler.cull(camera).unit_ids) for camera in path.cameras))
        culler.close()
    assert drawn[0] < 0.75 * drawn[1]


def test_what_is_small_hides_nothing_where_only_the_large_are_rasterised():
    view = camera_at()
    scene = Scene.from_objects(
        [
            ("small", *pixel_panel(view, (9.5, 21.5), (9.5, 21.5), 5.0)),
            ("large", *pixel_panel(view, (29.5, 61.5), (1.5, 45.5), 5.0)),
            ("behind the small", *pixel_panel(view, (12.0, 18.0), (12.0, 18.0), 30.0)),
            ("behind the large", *pixel_panel(view, (40.0, 50.0), (12.0, 18.0), 30.0)),
        ]
    )
    for least, drawn in ((0, [0, 1]), (1000, [0, 1, 2]), (10_000, [0, 1, 2, 3])):
        culler = make_culler(f"masked-occlusion:least={least}")
        culler.prepare(scene)
        assert sorted(culler.cull(view).unit_ids.tolist()) == drawn
        culler.close()
