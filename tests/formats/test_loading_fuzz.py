"""A spoilt file is read or refused: no place in it leads to any other kind of failure."""

from __future__ import annotations

import copy
import json
import random
from typing import Any

import numpy as np
import pytest

from tests.support.gltf_files import SQUARE, TWO, Gltf
from visref.errors import InputError
from visref.formats import load_path, load_scene

VALUES: list[Any] = [
    *(None, True, -1, 0, 1, 2, 3, 7, 0.5, 1e300, -1e300, float("nan"), 10**30, 10**400),
    *("", "x", [], {}, [0], [1, 2, 3], {"a": 1}, 2**31, 2**53 + 1, 5121, 5126),
    *("VEC3", "MASK", "CUBICSPLINE"),
]
REMOVE = object()


def everything() -> Gltf:
    """A file that uses each feature that is read."""
    draco = pytest.importorskip("DracoPy")
    gltf = Gltf()
    plain = gltf.primitive(SQUARE, TWO, material=0)
    plain["attributes"] |= {
        "COLOR_0": gltf.accessor(np.ones((4, 4), "f4")),
        "JOINTS_0": gltf.accessor(np.zeros((4, 4), "u1")),
        "WEIGHTS_0": gltf.accessor(np.ones((4, 4), "f4")),
    }
    plain["targets"] = [{"POSITION": gltf.accessor(np.ones((4, 3), "f4"))}]
    packed = gltf.primitive(SQUARE, TWO)
    data = draco.encode(SQUARE, TWO.reshape(-1, 3).astype("u4"))
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


def places(value: Any, above: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The path to every value in a document."""
    members: Any = ()
    if isinstance(value, dict):
        members = value.items()
    elif isinstance(value, list):
        members = enumerate(value)
    found = []
    for key, member in members:
        found += [(*above, key), *places(member, (*above, key))]
    return found


def spoilt(gltf: Gltf, rng: random.Random) -> bytes:
    """The file with one or two values exchanged or removed, or a few bytes changed."""
    kept = copy.deepcopy(gltf.json)
    for _ in range(rng.choice([1, 2])):
        place = rng.choice(places(gltf.json))
        owner: Any = gltf.json
        for step in place[:-1]:
            owner = owner[step]
        value = rng.choice([*VALUES, *[REMOVE] * 4])
        if value is REMOVE:
            del owner[place[-1]]
        else:
            owner[place[-1]] = copy.deepcopy(value)
    gltf.json.setdefault("buffers", [{"byteLength": len(gltf.blob)}])
    data = bytearray(gltf.glb())
    gltf.json = kept
    if rng.random() < 0.2:
        for _ in range(3):
            data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


def test_file_with_every_feature_is_good(tmp_path):
    file = everything().write(tmp_path / "good.glb")
    assert load_scene(file).object_count == 3
    assert len(load_path(file)) == 2


@pytest.mark.slow
def test_spoilt_gltf_is_read_or_refused_in_one_line(tmp_path):
    gltf, file = everything(), tmp_path / "spoilt.glb"
    wanted = json.dumps(gltf.json)
    read, lines = 0, []
    for seed in range(250):
        file.write_bytes(spoilt(gltf, random.Random(seed)))
        for load in (load_scene, load_path):
            try:
                load(file)
                read += 1
            except InputError as error:
                lines.append(str(error))
    assert all(line.startswith(str(file)) and "\n" not in line for line in lines)
    assert json.dumps(gltf.json) == wanted
    assert min(read, len(lines)) > 100
