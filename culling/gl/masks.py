"""Alpha masks on the GPU: the textures, and triangles whose vertices carry what a mask needs."""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.masks.lookup import SOLID, mask_states
from visref.masks.store import CLAMP, REPEAT, Masks
from visref.scene import Alpha, Scene
from visref_culling.gl.device import Device, set_uniform

# A corner as `masked.vert` takes it: position, texture coordinates, vertex alpha, and the least
# and the greatest vertex alpha of the triangle.
CORNER = np.dtype(
    [("world", "f4", 3), ("uv", "f4", 2), ("vertex_alpha", "f4"), ("alpha_range", "f4", 2)]
)
CORNER_LAYOUT = "3f 2f 1f 2f"
CORNER_NAMES = ("vertex_world", "vertex_uv", "vertex_alpha", "alpha_range")


def certainly_solid(scene: Scene) -> NDArray[np.bool_]:
    """(t,) bool, True where a MASK triangle's mask is solid wherever it is looked up.

    The lookup takes the least alpha of the whole texture and of the three vertices. No footprint
    holds a lesser one, so the truth is SOLID at every sample of such a triangle.
    """
    result = np.zeros(scene.triangle_count, np.bool_)
    if scene.masks is not None:
        masked = np.flatnonzero((scene.alpha == Alpha.MASK) & (scene.masks.row >= 0))
        row = scene.masks.row[masked]
        alpha = scene.masks.arrays.triangles["vertex_alpha"][row]
        everywhere = np.zeros((len(row), 6))
        everywhere[:, 2:4] = np.inf
        states = mask_states(scene.masks, row, everywhere, alpha.min(axis=1), alpha.max(axis=1))
        result[masked] = states == SOLID
    return result


def with_known_mask(scene: Scene) -> NDArray[np.bool_]:
    """(t,) bool, True where a MASK triangle's mask can be looked up."""
    result: NDArray[np.bool_] = scene.alpha == Alpha.MASK
    if scene.masks is None:
        return np.zeros_like(result)
    row = scene.masks.row
    materials = scene.masks.arrays.triangles["material"]
    known = ~scene.masks.arrays.materials["unknown"][materials]
    result &= row >= 0
    result[result] = known[row[result]]
    return result


def corners(scene: Scene, masks: Masks, triangles: NDArray[np.int32]) -> NDArray[np.void]:
    """(k, 3) of CORNER, of k triangles with masks."""
    of = masks.arrays.triangles[masks.row[triangles]]
    material = masks.arrays.materials[of["material"]]
    uv = of["uv"].copy()
    # Two periods more or less are nothing to a repeated texture, mirrored or not, and float32
    # resolves small coordinates better.
    for axis, name in enumerate(("wrap_s", "wrap_t")):
        whole = 2.0 * np.floor(uv[:, :, axis].min(axis=1) / 2.0)
        uv[:, :, axis] -= np.where(material[name] != CLAMP, whole, 0.0)[:, None]
    result = np.zeros((len(triangles), 3), CORNER)
    result["world"] = scene.vertices[scene.triangles[triangles]]
    result["uv"] = uv
    result["vertex_alpha"] = of["vertex_alpha"]
    result["alpha_range"][..., 0] = of["vertex_alpha"].min(axis=1)[:, None]
    result["alpha_range"][..., 1] = of["vertex_alpha"].max(axis=1)[:, None]
    return result


class MaskTextures:
    """A scene's mask textures on the GPU, each once and when first asked for."""

    def __init__(self, gl: Device, masks: Masks) -> None:
        self.device = gl
        self.masks = masks
        self._made: dict[int, moderngl.Texture] = {}

    def bind(self, program: moderngl.Program, material: int) -> None:
        """Let `masked.frag` read a material."""
        of = self.masks.arrays.materials[material]
        texture = int(of["texture"])
        self._texture(texture).use(0)
        scale = self.masks.arrays.textures[texture]["scale"] if texture >= 0 else 1
        wraps = (of["wrap_s"], of["wrap_t"]) if texture >= 0 else (REPEAT, REPEAT)
        set_uniform(program, "texels", np.int32(0).tobytes())
        set_uniform(program, "wrap", np.array(wraps, np.int32).tobytes())
        set_uniform(program, "nearest", np.int32(of["nearest"]).tobytes())
        numbers = np.array([scale, of["factor"], of["cutoff"]], np.float64)
        set_uniform(program, "scale_factor_cutoff", numbers.tobytes())

    def _texture(self, index: int) -> moderngl.Texture:
        if index not in self._made:
            if index < 0:
                size, texels = (1, 1), np.ones(1, np.uint16)
            else:
                arrays = self.masks.arrays
                size = (int(arrays.textures[index]["width"]), int(arrays.textures[index]["height"]))
                start = int(arrays.levels[arrays.textures[index]["level"]]["least"])
                texels = arrays.alpha[start : start + size[0] * size[1]]
            made = self.device.context.texture(size, 1, texels.tobytes(), alignment=1, dtype="u2")
            made.filter = (moderngl.NEAREST, moderngl.NEAREST)
            self._made[index] = made
        return self._made[index]

    def release(self) -> None:
        for texture in self._made.values():
            texture.release()
