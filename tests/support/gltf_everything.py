"""A glTF file that uses each feature that is read."""

from __future__ import annotations

import DracoPy
import numpy as np

from tests.support.gltf_files import SQUARE, TWO, Gltf


def everything() -> Gltf:
    """Objects, masks, glass, skins, morphs, instances, Draco, cameras and animations."""
    gltf = Gltf()
    plain = gltf.primitive(SQUARE, TWO, material=0)
    plain["attributes"] |= {
        "COLOR_0": gltf.accessor(np.ones((4, 4), "f4")),
        "JOINTS_0": gltf.accessor(np.zeros((4, 4), "u1")),
        "WEIGHTS_0": gltf.accessor(np.ones((4, 4), "f4")),
    }
    plain["targets"] = [{"POSITION": gltf.accessor(np.ones((4, 3), "f4"))}]
    packed = gltf.primitive(SQUARE, TWO)
    data = DracoPy.encode(SQUARE, TWO.reshape(-1, 3).astype("u4"))
    extension = {"bufferView": gltf.view(data), "attributes": {"POSITION": 0}}
    packed["extensions"] = {"KHR_draco_mesh_compression": extension}
    gltf.json["accessors"][0]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": gltf.view(b"\1"), "componentType": 5121},
        "values": {"bufferView": gltf.view(np.ones(3, "f4").tobytes())},
    }
    gltf.entry("materials", alphaMode="MASK", alphaCutoff=0.5, doubleSided=True)
    gltf.json["materials"][0]["pbrMetallicRoughness"] = {"baseColorFactor": [1, 1, 1, 1]}
    joint = gltf.node(translation=[1, 2, 3], rotation=[0, 0, 0, 1], scale=[1, 1, 1])
    bind = gltf.accessor(np.eye(4, dtype="f4").reshape(1, 16))
    gltf.entry("skins", joints=[joint], inverseBindMatrices=bind)
    gltf.node(mesh=gltf.mesh(plain, weights=[0.5], name="m"), skin=0, name="a", weights=[1])
    places = {
        "TRANSLATION": gltf.accessor(np.ones((2, 3), "f4")),
        "ROTATION": gltf.accessor(np.ones((2, 4), "f4")),
    }
    instancing = {"EXT_mesh_gpu_instancing": {"attributes": places}}
    child = gltf.node(mesh=gltf.mesh(packed), root=False, extensions=instancing)
    visible = {"KHR_node_visibility": {"visible": True}}
    gltf.node(children=[child], matrix=np.eye(4).reshape(-1).tolist(), extensions=visible)
    gltf.entry("cameras", type="perspective", perspective={"yfov": 1.0, "znear": 0.1, "zfar": 10})
    camera = gltf.node(camera=0, translation=[0, 0, 0])
    times = gltf.accessor(np.array([0, 1], "f4"))
    spline = gltf.accessor(np.zeros((6, 3), "f4"))
    turn = gltf.accessor(np.ones((2, 4), "f4"))
    gltf.entry(
        "animations",
        samplers=[
            {"input": times, "output": spline, "interpolation": "CUBICSPLINE"},
            {"input": times, "output": turn},
        ],
        channels=[
            {"sampler": 0, "target": {"node": camera, "path": "translation"}},
            {"sampler": 1, "target": {"node": camera, "path": "rotation"}},
        ],
    )
    gltf.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    gltf.json["buffers"] = [{"byteLength": len(gltf.blob)}]
    return gltf
