"""The rasteriser's view of a camera: closed ranges, errors as declared."""

import math

import numpy as np
import pytest

from tests.support.culling_scenes import ortho, perspective
from visref.camera import Camera
from visref.scene import Scene
from visref_culling.gl.device import device
from visref_culling.gl.item_buffer import GLRaster
from visref_culling.gl.view import View

EMPTY = Scene.from_objects([])


def test_infinite_orthographic_range_is_closed_behind_the_scene():
    scene = Scene.from_objects([("a", [(0, 0, -5), (1, 0, -50), (0, 1, -7)], [(0, 1, 2)])])
    view = View.of(ortho(8, 8, near=-3.0, far=math.inf), scene, 8)
    assert 50.0 < view.far < 51.0
    assert View.of(ortho(8, 8, near=60.0, far=math.inf), scene, 8).far > 60.0


@pytest.mark.gl
@pytest.mark.parametrize("make", [ortho, perspective])
def test_renderer_moves_an_edge_no_farther_than_declared(make):
    """An edge is put at known distances beside a pixel centre; beyond the declared snap the
    centre's owner must be the exact one, and within half of it snapping must show at all."""
    camera = make(32, 32)
    pixel = 1.0 if make is ortho else 2.0 / 32 * 5.0
    wrong_beyond = snapped = 0
    for step in range(-40, 41):
        offset_px = step / 4096.0
        x = (0.5 + offset_px) * pixel  # the centre of column 16 is half a pixel right of 0
        scene = Scene.from_objects([("a", [(x, -99, -5), (99, -99, -5), (x, 99, -5)], [(0, 1, 2)])])
        raster = GLRaster(scene)
        covered = raster.item_buffer(camera)[16, 16] == 0
        x_px = float(scene.vertices[0, 0]) / pixel - 0.5
        if covered != (x_px <= 0.0):
            snapped += 1
            wrong_beyond += abs(x_px) > raster.tolerance.snap_px
        raster.close()
    assert wrong_beyond == 0
    assert snapped > 0


@pytest.mark.gl
def test_tolerance_is_the_widest_of_the_cameras_seen():
    raster = GLRaster(EMPTY)
    raster.see(perspective(64, 64))
    wide = raster.tolerance.snap_px
    raster.see(Camera(np.eye(4), 1024, 1024, 0.1, yfov=math.radians(1.0)))
    narrow = raster.tolerance.snap_px
    raster.see(perspective(64, 64))
    assert 2.0 ** -(device().subpixel_bits + 1) < wide < narrow == raster.tolerance.snap_px
