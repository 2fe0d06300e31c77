"""A truth engine of one's own, outside the tree: every triangle against every ray, in NumPy.

In Python it needs no registration: `Referee(scene, lambda: NumPyEngine(scene))`. To be found as
`--engine numpy`, the package that holds it names it in its `pyproject.toml`:

    [project.entry-points."visref.engines"]
    numpy = "own_engine:NumPyEngine"
"""

import numpy as np

from visref import FrameTruth, InputError, TruthEngine, VisibilityBuffer


class NumPyEngine(TruthEngine):
    name = "numpy"
    summary = "every triangle against every ray, in float64"

    def __init__(self, scene, *, threads=None):
        super().__init__(scene, threads=threads)
        if scene.has_blend or scene.has_mask or scene.one_sided.any():
            raise InputError("the numpy engine knows opaque, two-sided triangles only")
        self.corners = scene.vertices[scene.triangles].astype(np.float64)

    def frame(self, camera):
        """Who owns which samples. t of a ray is view depth, as `Camera.ray` says."""
        origins, rays = rays_of(camera)
        owner = np.full(camera.samples, -1, np.int32)
        nearest = np.full(camera.samples, np.inf)
        for triangle, corners in enumerate(self.corners):
            depth = hits(origins, rays, corners)
            closer = (camera.near <= depth) & (depth <= camera.far) & (depth < nearest)
            owner[closer], nearest[closer] = triangle, depth[closer]
        shape = (camera.height, camera.width)
        buffer = VisibilityBuffer(owner.reshape(shape), nearest.reshape(shape))
        return FrameTruth(camera, self.name, buffer)


def rays_of(camera):
    """Origins and directions of all samples' rays, (samples, 3) each, row by row."""
    b, a = np.meshgrid(camera.row_b, camera.column_a, indexing="ij")
    offset = a.reshape(-1, 1) * camera.right_step + b.reshape(-1, 1) * camera.up_step
    if camera.is_perspective:
        return np.broadcast_to(camera.eye, offset.shape), camera.forward + offset
    return camera.eye + offset, np.broadcast_to(camera.forward, offset.shape)


def hits(origins, rays, corners):
    """(samples,) the depth at which each ray meets the triangle, inf where it does not.

    The volumes that a ray spans with the three edges have one sign inside. An edge shared by two
    triangles gives both the same number but for its sign, so no ray slips between them.
    """
    p, q, r = (corner - origins for corner in corners)
    edges = ((p, q), (q, r), (r, p))
    volumes = np.stack([np.sum(rays * np.cross(*edge), axis=1) for edge in edges])
    inside = (volumes >= 0.0).all(axis=0) | (volumes <= 0.0).all(axis=0)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    towards = rays @ normal
    inside &= (towards != 0.0) & volumes.any(axis=0)
    depth = np.full(len(rays), np.inf)
    depth[inside] = (p[inside] @ normal) / towards[inside]
    return depth
