"""The same job as a script would do it with other libraries: rays, one cast, counts by object.

Each takes the scene once and answers `counts(camera)`, (n,) int64 samples per object. All are as
plain as their documentation suggests, in float32: none knows near, far or masks, and none settles a
close call.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.measuring import Skipped
from visref.camera import Camera
from visref.scene import Scene


def pinhole_rays(camera: Camera) -> NDArray[np.float32]:
    """(height, width, 6) float32, origins and directions, by the samples' definition."""
    step_x = (camera.column_a[:, None] * camera.right_step).astype(np.float32)
    step_y = (camera.row_b[:, None] * camera.up_step + camera.forward).astype(np.float32)
    rays = np.empty((camera.height, camera.width, 6), np.float32)
    rays[..., :3] = camera.eye
    np.add(step_x[None], step_y[:, None], out=rays[..., 3:])
    return rays


class Peer:
    """What the peers share: from primitive ids to counts."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    def counted(self, primitive: NDArray[Any], hit: NDArray[np.bool_]) -> NDArray[np.int64]:
        owners = self.scene.object_of_triangle[primitive[hit]]
        return np.bincount(owners, minlength=self.scene.object_count)


class PlainOpen3D(Peer):
    """Open3D's ray casting scene; `own_rays`: its `create_rays_pinhole` makes the rays."""

    def __init__(self, scene: Scene, *, own_rays: bool = False) -> None:
        import open3d

        super().__init__(scene)
        self.core, self.own_rays = open3d.core, own_rays
        self.caster = open3d.t.geometry.RaycastingScene()
        tensor = open3d.core.Tensor.from_numpy
        self.caster.add_triangles(
            tensor(scene.vertices.copy()), tensor(scene.triangles.astype(np.uint32))
        )

    def counts(self, camera: Camera) -> NDArray[np.int64]:
        if self.own_rays:
            rays = self._pinhole(camera)
        else:
            rays = self.core.Tensor.from_numpy(pinhole_rays(camera))
        primitive = self.caster.cast_rays(rays)["primitive_ids"].numpy().ravel()
        return self.counted(primitive, primitive != self.caster.INVALID_ID)

    def _pinhole(self, camera: Camera) -> Any:
        focal = 0.5 / float(np.linalg.norm(camera.right_step))
        intrinsic = np.array(
            [[focal, 0.0, camera.width / 2], [0.0, focal, camera.height / 2], [0.0, 0.0, 1.0]]
        )
        # Open3D's camera looks along +Z with y down.
        extrinsic = np.diag([1.0, -1.0, -1.0, 1.0]) @ camera.camera_from_world
        return self.caster.create_rays_pinhole(
            self.core.Tensor(intrinsic),
            self.core.Tensor(np.ascontiguousarray(extrinsic)),
            camera.width,
            camera.height,
        )


class PlainEmbreex(Peer):
    """embreex alone: single rays, robust, on one core, as trimesh casts them."""

    def __init__(self, scene: Scene) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        super().__init__(scene)
        self.caster = EmbreeScene(robust=True)
        self.mesh = TriangleMesh(self.caster, scene.vertices, scene.triangles)

    def counts(self, camera: Camera) -> NDArray[np.int64]:
        rays = pinhole_rays(camera).reshape(-1, 6)
        primitive = self.caster.run(rays[:, :3].copy(), rays[:, 3:].copy())
        return self.counted(primitive, primitive >= 0)


class PlainMitsuba(Peer):
    """Mitsuba 3 in its LLVM mode, over Embree: coherent packets, robust intersections."""

    def __init__(self, scene: Scene) -> None:
        import mitsuba

        super().__init__(scene)
        mitsuba.set_variant("llvm_ad_rgb")
        self.mitsuba = mitsuba
        mesh = mitsuba.Mesh("all", len(scene.vertices), scene.triangle_count)
        parameters = mitsuba.traverse(mesh)
        parameters["vertex_positions"] = scene.vertices.ravel()
        parameters["faces"] = scene.triangles.ravel().astype(np.uint32)
        parameters.update()
        self.caster = mitsuba.load_dict(
            {"type": "scene", "embree_use_robust_intersections": True, "mesh": mesh}
        )

    def counts(self, camera: Camera) -> NDArray[np.int64]:
        import drjit

        mitsuba = self.mitsuba
        pixel = drjit.arange(mitsuba.UInt32, camera.samples)
        x = mitsuba.Float(pixel % camera.width)
        y = mitsuba.Float(pixel // camera.width)
        a, b = 2.0 * x + float(camera.column_a[0]), float(camera.row_b[0]) - 2.0 * y
        direction = [
            float(camera.forward[axis])
            + float(camera.right_step[axis]) * a
            + float(camera.up_step[axis]) * b
            for axis in range(3)
        ]
        ray = mitsuba.Ray3f(mitsuba.Point3f(*map(float, camera.eye)), mitsuba.Vector3f(*direction))
        found = self.caster.ray_intersect_preliminary(ray, coherent=True)
        hit = found.is_valid()
        drjit.eval(found.prim_index, hit)
        return self.counted(np.asarray(found.prim_index), np.asarray(hit))


PEERS = {
    "Open3D, NumPy's rays": ("open3d", PlainOpen3D),
    "Open3D, its own rays": ("open3d", lambda scene: PlainOpen3D(scene, own_rays=True)),
    "embreex alone, one core": ("embreex", PlainEmbreex),
    "Mitsuba, LLVM": ("mitsuba", PlainMitsuba),
}


def peers_of(scene: Scene) -> dict[str, Any]:
    """Each peer, ready to cast, or `Skipped` with the reason."""
    result: dict[str, Any] = {}
    for name, (module, make) in PEERS.items():
        if find_spec(module) is None:
            result[name] = Skipped(f"{module} is not installed")
            continue
        try:
            result[name] = make(scene)
        except ImportError as error:  # a library of the system's that is missing
            result[name] = Skipped(f"{module} does not start: {str(error)[:200]}")
    return result
