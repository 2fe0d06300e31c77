"""A case as its user would bring it: a GLB, a camera path, and recorded visible sets."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from tests.fuzz_verdicts.case import Case, Mask, Matrix, Part
from tests.support.gltf_files import Gltf

NEAREST, LINEAR = 9728, 9729


def write(case: Case, folder: Path) -> tuple[Path, Path, Path]:
    """The scene, the camera path, and, of objects, the recorded visible sets."""
    scene, path, sets = folder / "scene.glb", folder / "path.json", folder / "sets.jsonl"
    scene.write_bytes(glb_of(case))
    path.write_text(json.dumps({"format": "visref-path", "version": 1, "frames": case.frames}))
    if case.units is None:
        lines = []
        for frame, ids in enumerate(case.drawn):
            named = [case.objects[i][0] if (i + frame) % 2 else i for i in ids]
            lines.append(json.dumps({"frame": frame, "visible": named}))
        sets.write_text("\n".join(lines[::-1]))
    return scene, path, sets


def glb_of(case: Case) -> bytes:
    """One root over a node for each object."""
    gltf = Gltf()
    children = [
        gltf.node(
            root=False,
            name=name,
            mesh=gltf.mesh(*(primitive(gltf, part) for part in parts)),
            matrix=columns(matrix),
        )
        for name, matrix, parts in case.objects
    ]
    gltf.node(name="root", matrix=columns(case.root), children=children)
    return gltf.glb()


def columns(matrix: Matrix) -> list[float]:
    return [float(matrix[i][j]) for j in range(4) for i in range(4)]


def primitive(gltf: Gltf, part: Part) -> dict[str, Any]:
    faces = np.array(part.faces, "u2").reshape(-1)
    entry = gltf.primitive(np.array(part.positions, "f4"), faces)
    material: dict[str, Any] = {"doubleSided": part.double_sided}
    if part.kind == "blend" and part.transmission:
        material["extensions"] = {"KHR_materials_transmission": {"transmissionFactor": 0.5}}
        gltf.json.setdefault("extensionsUsed", [])
        gltf.json["extensionsUsed"] = sorted(
            {*gltf.json["extensionsUsed"], "KHR_materials_transmission"}
        )
    elif part.kind == "blend":
        material["alphaMode"] = "BLEND"
    if part.mask is not None:
        mask = part.mask
        look: dict[str, Any] = {"baseColorFactor": [1.0, 1.0, 1.0, mask.factor]}
        material |= {"alphaMode": "MASK", "alphaCutoff": mask.cutoff}
        if mask.textured:
            look["baseColorTexture"] = texture(gltf, part, mask)
            entry["attributes"]["TEXCOORD_0"] = gltf.accessor(np.array(part.uv, "f4"))
        material["pbrMetallicRoughness"] = look
        if part.vertex_alpha:
            rgba = [(1.0, 1.0, 1.0, x) for x in part.vertex_alpha]
            entry["attributes"]["COLOR_0"] = gltf.accessor(np.array(rgba, "f4"))
    entry["material"] = gltf.entry("materials", **material)
    return entry


def texture(gltf: Gltf, part: Part, mask: Mask) -> dict[str, Any]:
    alpha = np.array(mask.texels, np.uint8)
    data = io.BytesIO()
    Image.fromarray(np.stack([alpha * 0, alpha], axis=-1), "LA").save(data, "PNG")
    image = gltf.entry("images", bufferView=gltf.view(data.getvalue()), mimeType="image/png")
    kind = NEAREST if mask.nearest else LINEAR
    sampler = gltf.entry(
        "samplers", wrapS=mask.wrap[0], wrapT=mask.wrap[1], magFilter=kind, minFilter=kind
    )
    info: dict[str, Any] = {"index": gltf.entry("textures", source=image, sampler=sampler)}
    if part.stretch != (1.0, 1.0, 0.0, 0.0):
        su, sv, ou, ov = part.stretch
        info["extensions"] = {"KHR_texture_transform": {"scale": [su, sv], "offset": [ou, ov]}}
        gltf.json["extensionsUsed"] = sorted(
            {*gltf.json.get("extensionsUsed", []), "KHR_texture_transform"}
        )
    return info
