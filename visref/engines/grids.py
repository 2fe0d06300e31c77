"""A camera's samples, as the compiled loops of the ray engines read them."""

from __future__ import annotations

import numpy as np

from visref.camera import Camera
from visref.engines.ray_kernels import SampleGrid
from visref.scene import Float64


def sample_grid(camera: Camera) -> SampleGrid:
    """The camera's samples as the compiled loops read them."""
    basis = np.stack([camera.forward, camera.right_step, camera.up_step])
    axes = np.concatenate([camera.eye[None], basis, np.linalg.inv(basis.T)])
    return SampleGrid(
        np.ascontiguousarray(axes),
        camera.is_perspective,
        float(camera.near),
        float(camera.far),
        camera.column_a,
        camera.row_b,
        clips=camera.clip_plane is not None,
        clip=_clip(camera),
    )


def _clip(camera: Camera) -> Float64:
    """(6,) float64, the clip plane as `SampleGrid.clip` has it; zeros without one."""
    result = np.zeros(6)
    if camera.clip_plane is not None:
        normal, offset = np.array(camera.clip_plane[:3]), camera.clip_plane[3]
        result[0], result[3] = normal @ camera.eye + offset, normal @ camera.forward
        aside = normal @ camera.right_step, normal @ camera.up_step
        result[4:6] = aside if camera.is_perspective else 0.0
        result[1:3] = 0.0 if camera.is_perspective else aside
    return result
