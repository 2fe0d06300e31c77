"""Alpha masks of glTF files: whose texture, at which corner, and why none."""

from __future__ import annotations

import base64
import io
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests.support.gltf_files import SQUARE, TRIANGLE, TWO, Gltf
from visref.errors import InputError
from visref.formats.loading import load_scene
from visref.masks.hits import states_at
from visref.masks.lookup import BETWEEN, HOLE, SOLID
from visref.masks.store import CLAMP, MIRROR, REPEAT, Masks
from visref.scene import Alpha, Scene

ALPHA = np.random.default_rng(1).integers(0, 256, (5, 7)).astype(np.uint8)


def image(alpha: NDArray[np.uint8] = ALPHA, kind: str = "PNG") -> bytes:
    pixels = np.full((*alpha.shape, 4), 200, np.uint8)
    pixels[..., 3] = alpha
    file = io.BytesIO()
    if kind == "JPEG":
        Image.fromarray(pixels[..., :3]).save(file, kind)
    else:
        Image.fromarray(pixels).save(file, kind, lossless=True, exact=True)
    return file.getvalue()


def uv_of(points: NDArray[Any]) -> NDArray[np.float64]:
    """Texture coordinates as a function of a mesh's own places: a corner that got another's
    is found out. Sixteenths, so that every type holds them and sums are exact."""
    x, y = points[..., 0].astype(np.float64), points[..., 1].astype(np.float64)
    return np.stack([0.0625 + 0.5 * x + 0.25 * y, 0.125 + 0.0625 * x + 0.5 * y], axis=-1)


def add_image(gltf: Gltf, data: bytes, mime: str = "image/png") -> int:
    return gltf.entry("images", bufferView=gltf.view(data), mimeType=mime)


def add_material(gltf: Gltf, info: dict[str, Any] | None, **more: Any) -> int:
    factor = {"baseColorFactor": [1, 1, 1, more.pop("factor", 1.0)]}
    textured = {"baseColorTexture": info} if info is not None else {}
    return gltf.entry(
        "materials", alphaMode="MASK", pbrMetallicRoughness={**factor, **textured}, **more
    )


def leaf(
    points: NDArray[Any] = SQUARE,
    indices: NDArray[Any] | None = TWO,
    *,
    data: bytes | None = None,
    info: dict[str, Any] | None = None,
    texture: dict[str, Any] | None = None,
    material: dict[str, Any] | None = None,
    attributes: dict[str, NDArray[Any]] | None = None,
    **primitive: Any,
) -> Gltf:
    """A file with one masked mesh, no node yet: mesh 0, material 0, texture 0, image 0."""
    gltf = Gltf()
    add_image(gltf, image() if data is None else data)
    gltf.entry("textures", **({"source": 0} if texture is None else texture))
    add_material(gltf, {"index": 0, **(info or {})}, **(material or {}))
    made = gltf.primitive(points, indices, material=0, **primitive)
    if attributes is None:
        attributes = {"TEXCOORD_0": uv_of(points).astype("f4")}
    for name, values in attributes.items():
        made["attributes"][name] = gltf.accessor(values)
    gltf.mesh(made)
    return gltf


def load(gltf: Gltf, folder: Path, **more: Any) -> Scene:
    return load_scene(gltf.write(folder / "scene.glb"), **more)


def loaded(gltf: Gltf, folder: Path, **more: Any) -> tuple[Scene, Masks]:
    if not gltf.json["nodes"]:
        gltf.node(mesh=0, name="leaf")
    scene = load(gltf, folder, **more)
    assert scene.masks is not None
    return scene, scene.masks


def texels(masks: Masks, texture: int = 0) -> NDArray[np.uint16]:
    """The image of a texture, out of its pyramid."""
    entry = masks.arrays.textures[texture]
    start = masks.arrays.levels[entry["level"]]["least"]
    count = entry["width"] * entry["height"]
    return masks.arrays.alpha[start : start + count].reshape(entry["height"], entry["width"])


def corners(scene: Scene) -> NDArray[np.float64]:
    return scene.vertices[scene.triangles].astype(np.float64)


def uv(masks: Masks) -> NDArray[np.float64]:
    """(t, 3, 2), where each triangle has a mask."""
    assert (masks.row >= 0).all()
    return masks.arrays.triangles["uv"][masks.row]


def only_material(masks: Masks) -> Any:
    (entry,) = masks.arrays.materials
    return entry


@pytest.mark.parametrize("where", ["view", "data", "file"])
@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_image_is_read_from_wherever_it_stands(tmp_path: Path, kind: str, where: str) -> None:
    data = image(kind=kind)
    texture: dict[str, Any] = {"source": 0}
    if kind == "WEBP":
        texture = {"extensions": {"EXT_texture_webp": {"source": 0}}}
    gltf = leaf(data=data, texture=texture)
    mime = f"image/{kind.lower()}"
    if where == "view":
        gltf.json["images"][0]["mimeType"] = mime
    elif where == "data":
        text = f"data:{mime};base64," + base64.b64encode(data).decode()
        gltf.json["images"][0] = {"uri": text}
    else:
        gltf.json["images"][0] = {"uri": "a%20leaf"}
        (tmp_path / "a leaf").write_bytes(data)
    gltf.node(mesh=0)
    scene = load(gltf, tmp_path)
    assert scene.notes == ()
    if kind == "JPEG":
        # It has no alpha, so it has no holes.
        assert scene.alpha.tolist() == [Alpha.OPAQUE] * 2
        assert scene.masks is None
        return
    assert scene.masks is not None
    assert scene.alpha.tolist() == [Alpha.MASK] * 2
    assert np.array_equal(texels(scene.masks), ALPHA)
    assert scene.masks.arrays.textures[0]["scale"] == 255
    assert np.array_equal(uv(scene.masks), uv_of(corners(scene)))


def test_text_file_with_its_buffer_beside_it_is_read_alike(tmp_path: Path) -> None:
    gltf = leaf()
    gltf.node(mesh=0)
    (tmp_path / "bytes.bin").write_bytes(gltf.blob)
    scene = load_scene(gltf.write_gltf(tmp_path / "scene.gltf", "bytes.bin"))
    assert scene.digest == load(gltf, tmp_path).digest


def test_substitute_is_read_where_the_compressed_texture_has_one(tmp_path: Path) -> None:
    basis = {"extensions": {"KHR_texture_basisu": {"source": 1}}}
    gltf = leaf(texture={"source": 0, **basis})
    add_image(gltf, b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(80), "image/ktx2")
    _, masks = loaded(gltf, tmp_path)
    assert np.array_equal(texels(masks), ALPHA)


def test_a_compressed_texture_without_a_substitute_leaves_the_mask_open_and_says_so_once(
    tmp_path: Path,
) -> None:
    """No decoder of Basis Universal is kept well enough; each sample there stays in between."""
    gltf = leaf(texture={"extensions": {"KHR_texture_basisu": {"source": 1}}})
    add_image(gltf, b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(80), "image/ktx2")
    gltf.json["extensionsRequired"] = ["KHR_texture_basisu"]
    gltf.node(mesh=0, name="leaf")
    gltf.node(mesh=0, name="leaf")
    scene, masks = loaded(gltf, tmp_path)
    assert scene.alpha.tolist() == [Alpha.MASK] * 4
    assert only_material(masks)["unknown"]
    ((code, text),) = scene.notes
    assert code == "PARTLY_READ"
    assert text == "an alpha mask cannot be looked up, first materials[0]: no decoder for KTX2"


def test_webp_is_preferred_to_its_substitute(tmp_path: Path) -> None:
    gltf = leaf(texture={"source": 0, "extensions": {"EXT_texture_webp": {"source": 1}}})
    add_image(gltf, image(255 - ALPHA, "WEBP"), "image/webp")
    _, masks = loaded(gltf, tmp_path)
    assert np.array_equal(texels(masks), 255 - ALPHA)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"images": [{"uri": "absent.png"}]}, "images[0].uri: file 'absent.png'"),
        ({"images": [{"uri": "data:image/png;base64,iVBORw0KGgo="}]}, "damaged PNG"),
        ({"images": [{"uri": "data:image/png,plain"}]}, "not base64"),
        ({"images": [{}]}, "'uri' is missing"),
        ({"textures": []}, "textures[0] is named, but the file has 0"),
        ({"textures": [{}]}, "names no image"),
        ({"textures": [{"source": 4}]}, "images[4] is named"),
        ({"textures": [{"source": 0, "sampler": 0}]}, "samplers[0] is named"),
        (
            {"textures": [{"source": 0, "sampler": 0}], "samplers": [{"wrapS": 10496}]},
            "wrap mode is 10496",
        ),
    ],
)
def test_texture_that_cannot_be_had_makes_the_mask_unknown_and_says_why(
    tmp_path: Path, change: dict[str, Any], reason: str
) -> None:
    gltf = leaf()
    gltf.json |= change
    scene, masks = loaded(gltf, tmp_path)
    assert scene.alpha.tolist() == [Alpha.MASK] * 2
    assert only_material(masks)["unknown"]
    ((code, text),) = scene.notes
    assert code == "PARTLY_READ"
    assert text.startswith("an alpha mask cannot be looked up, first materials[0]: ")
    assert reason in text
    assert len(masks.reasons) == 1
    assert masks.reasons[0] in text


def test_each_reason_is_told_once_with_a_count(tmp_path: Path) -> None:
    gltf = leaf(data=b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(80))
    gltf.entry("images", uri="absent-1.png")
    gltf.entry("images", uri="absent-2.png")
    gltf.json["textures"] = [{"source": k} for k in (0, 0, 1, 2)]
    used = [gltf.json["meshes"][0]["primitives"][0]]
    for texture in (1, 2, 3, 3):
        used.append({**used[0], "material": add_material(gltf, {"index": texture})})
    gltf.json["meshes"][0]["primitives"] = used
    scene, masks = loaded(gltf, tmp_path)
    assert [text.partition(":")[0] for _, text in scene.notes] == [
        "2 alpha masks cannot be looked up, first materials[0]",
        "3 alpha masks cannot be looked up, first materials[2]",
    ]
    assert "no decoder for KTX2" in scene.notes[0][1]
    assert "absent-1.png" in scene.notes[1][1]
    assert len(masks.reasons) == 2


def test_unknown_texture_can_only_lower_the_factor(tmp_path: Path) -> None:
    gltf = leaf(data=b"no image", material={"factor": 0.25})
    gltf.node(mesh=0)
    scene = load(gltf, tmp_path)
    assert scene.triangle_count == 0
    assert scene.notes[0][0] == "NO_TRIANGLES"


def test_missing_texture_coordinates_make_the_mask_unknown(tmp_path: Path) -> None:
    scene, masks = loaded(leaf(info={"texCoord": 2}), tmp_path)
    assert only_material(masks)["unknown"]
    assert "a primitive has no TEXCOORD_2" in scene.notes[0][1]


def test_set_of_texture_coordinates_is_the_one_that_is_named(tmp_path: Path) -> None:
    sets = {f"TEXCOORD_{k}": (uv_of(SQUARE) + k).astype("f4") for k in range(3)}
    moved = {"extensions": {"KHR_texture_transform": {"texCoord": 0}}}
    for number, info in ((0, {}), (1, {"texCoord": 1}), (0, {"texCoord": 1, **moved})):
        scene, masks = loaded(leaf(info=info, attributes=sets), tmp_path)
        assert np.array_equal(uv(masks), uv_of(corners(scene)) + number)


@pytest.mark.parametrize(
    ("dtype", "scale", "normalized"),
    [("u1", 255, True), ("u2", 65535, True), ("i2", 32767, True), ("i1", 16, False)],
)
def test_quantised_coordinates_are_decoded(
    tmp_path: Path, dtype: str, scale: int, normalized: bool
) -> None:
    stored = np.round(uv_of(SQUARE) * scale).astype(dtype)
    if not normalized:
        stored = stored + np.arange(8, dtype=dtype).reshape(4, 2)
    gltf = leaf(attributes={"TEXCOORD_0": stored})
    if normalized:
        gltf.json["accessors"][-1]["normalized"] = True
    scene, masks = loaded(gltf, tmp_path)
    by_place = {
        tuple(place): value / (scale if normalized else 1)
        for place, value in zip(SQUARE.tolist(), stored.astype(np.float64), strict=True)
    }
    wanted = [[by_place[tuple(place)] for place in triangle] for triangle in corners(scene)]
    assert np.array_equal(uv(masks), wanted)


def test_transform_scales_then_turns_then_moves(tmp_path: Path) -> None:
    extension = {"offset": [0.5, -0.25], "rotation": math.pi / 2, "scale": [2.0, 3.0]}
    gltf = leaf(info={"extensions": {"KHR_texture_transform": extension}})
    scene, masks = loaded(gltf, tmp_path)
    u, v = np.moveaxis(uv_of(corners(scene)), -1, 0)
    # A quarter turn, v down the image: u takes the scaled v, v the scaled u with its sign changed.
    wanted = np.stack([0.5 + 3.0 * v, -0.25 - 2.0 * u], axis=-1)
    assert np.allclose(uv(masks), wanted, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(("code", "wrap"), [(10497, REPEAT), (33071, CLAMP), (33648, MIRROR)])
@pytest.mark.parametrize(
    ("filters", "nearest"),
    [
        ({}, False),
        ({"magFilter": 9728}, False),
        ({"magFilter": 9728, "minFilter": 9728}, True),
        ({"magFilter": 9728, "minFilter": 9984}, False),
        ({"magFilter": 9729, "minFilter": 9728}, False),
    ],
)
def test_sampler_says_wrap_modes_and_filters(
    tmp_path: Path, code: int, wrap: int, filters: dict[str, int], nearest: bool
) -> None:
    gltf = leaf(texture={"source": 0, "sampler": 0})
    gltf.entry("samplers", wrapS=code, **filters)
    entry = only_material(loaded(gltf, tmp_path)[1])
    assert (entry["wrap_s"], entry["wrap_t"], entry["nearest"]) == (wrap, REPEAT, nearest)
    gltf.json["samplers"][0] = {"wrapT": code}
    entry = only_material(loaded(gltf, tmp_path)[1])
    assert (entry["wrap_s"], entry["wrap_t"], entry["nearest"]) == (REPEAT, wrap, False)


def test_factor_and_cutoff_are_the_materials(tmp_path: Path) -> None:
    entry = only_material(loaded(leaf(), tmp_path)[1])
    assert (entry["factor"], entry["cutoff"], entry["texture"]) == (1.0, 0.5, 0)
    gltf = leaf(material={"factor": 0.75, "alphaCutoff": 0.125})
    entry = only_material(loaded(gltf, tmp_path)[1])
    assert (entry["factor"], entry["cutoff"]) == (0.75, 0.125)


def test_specular_glossiness_has_a_texture_of_its_own(tmp_path: Path) -> None:
    gltf = leaf()
    gltf.json["materials"][0] = {
        "alphaMode": "MASK",
        "extensions": {
            "KHR_materials_pbrSpecularGlossiness": {
                "diffuseFactor": [1, 1, 1, 0.875],
                "diffuseTexture": {"index": 0},
            }
        },
    }
    _, masks = loaded(gltf, tmp_path)
    assert only_material(masks)["factor"] == 0.875
    assert np.array_equal(texels(masks), ALPHA)


def test_cutoff_of_zero_is_met_everywhere(tmp_path: Path) -> None:
    gltf = leaf(material={"alphaCutoff": 0, "factor": 0.0})
    gltf.node(mesh=0)
    scene = load(gltf, tmp_path)
    assert scene.alpha.tolist() == [Alpha.OPAQUE] * 2
    assert scene.masks is None


@pytest.mark.parametrize(
    ("level", "alphas"), [(255, [Alpha.OPAQUE] * 2), (128, [Alpha.OPAQUE] * 2), (127, [])]
)
def test_image_of_one_alpha_decides_the_whole_triangle(
    tmp_path: Path, level: int, alphas: list[Alpha]
) -> None:
    gltf = leaf(data=image(np.full((4, 3), level, np.uint8)))
    gltf.node(mesh=0)
    scene = load(gltf, tmp_path)
    assert scene.alpha.tolist() == alphas
    assert scene.masks is None


def test_vertex_alpha_is_kept_at_its_corners(tmp_path: Path) -> None:
    color = np.ones((4, 4), "f4")
    color[:, 3] = [0.25, 0.5, 0.75, 1.5]
    by_place = dict(zip(map(tuple, SQUARE.tolist()), [0.25, 0.5, 0.75, 1.0], strict=True))
    texture = {"TEXCOORD_0": uv_of(SQUARE).astype("f4")}
    cases = [
        (leaf(attributes={**texture, "COLOR_0": color}), by_place),
        (leaf(attributes={**texture, "COLOR_0": color[:, :3].copy()}), None),
    ]
    for gltf, wanted in cases:
        scene, masks = loaded(gltf, tmp_path)
        got = masks.arrays.triangles["vertex_alpha"][masks.row]
        for place, value in zip(corners(scene).reshape(-1, 3), got.reshape(-1), strict=True):
            assert value == (1.0 if wanted is None else wanted[tuple(place)])


def test_vertex_alpha_alone_is_looked_up_where_it_crosses_the_cutoff(tmp_path: Path) -> None:
    gltf = Gltf()
    primitive = gltf.primitive(np.tile(TRIANGLE, (3, 1)), material=0)
    color = np.ones((9, 4), "f4")
    color[:, 3] = [1, 1, 1, 0, 0, 0, 1, 0, 1]
    primitive["attributes"]["COLOR_0"] = gltf.accessor(color)
    add_material(gltf, None)
    gltf.node(mesh=gltf.mesh(primitive), name="part")
    scene = load(gltf, tmp_path)
    assert scene.notes == ()
    assert scene.masks is not None
    assert scene.masks.row.tolist() == [-1, 0]
    # Corner 1 lies at x = 1: the alpha at (x, y) is 1 - x.
    axes = np.array([[0.0, 0, 1], [0, 0, -1], [1 / 64, 0, 0], [0, 1 / 64, 0]])
    samples = np.array([[8.0, 8], [48, 8], [32, 8]])
    row, places = np.zeros(3, np.int64), np.repeat(corners(scene)[1:], 3, axis=0)
    found = states_at(scene.masks, row, axes, samples, False, places)
    assert found.tolist() == [SOLID, HOLE, BETWEEN]


@pytest.mark.parametrize("mode", [5, 6])
def test_coordinates_follow_strips_and_fans(tmp_path: Path, mode: int) -> None:
    points = np.random.default_rng(3).integers(0, 8, (9, 3)).astype("f4")
    points[:, 2] = np.arange(9)
    for indices in (None, np.array([4, 2, 7, 1, 8, 0, 3], "u2")):
        scene, masks = loaded(leaf(points, indices, mode=mode), tmp_path)
        assert scene.triangle_count == (9 if indices is None else 7) - 2
        assert np.array_equal(uv(masks), uv_of(corners(scene)))


def test_coordinates_stay_with_their_corners_under_a_mirror(tmp_path: Path) -> None:
    gltf = leaf()
    for scale in ([1, 1, 1], [-1, 1, 1], [1, 1, 1], [1, -1, 1], [-1, -1, 1]):
        gltf.node(mesh=0, scale=scale)
    scene, masks = loaded(gltf, tmp_path)
    own = np.abs(corners(scene))
    assert np.array_equal(uv(masks), uv_of(own))
    # Five instances, two windings: two copies of the mesh's two triangles.
    assert len(masks.arrays.triangles) == 4
    flipped = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])[:, 2] < 0.0
    assert flipped.reshape(5, 2).tolist() == [[k in (1, 3)] * 2 for k in range(5)]


def test_masks_stay_with_their_triangles_when_others_are_dropped(tmp_path: Path) -> None:
    points = np.concatenate([SQUARE, SQUARE + 2, SQUARE + 4]).astype("f4")
    broken = points.copy()
    broken[5] = np.nan
    indices = np.concatenate([TWO, TWO + 4, TWO + 8]).astype("u2")
    gltf = leaf(broken, indices, attributes={"TEXCOORD_0": uv_of(points).astype("f4")})
    gltf.json["meshes"][0]["primitives"].insert(0, gltf.primitive(TRIANGLE + 9))
    gltf.node(mesh=0)
    scene = load(gltf, tmp_path, lenient=True)
    assert scene.masks is not None
    masked = scene.masks.row >= 0
    assert masked.tolist() == (scene.alpha == Alpha.MASK).tolist() == [False] + [True] * 5
    got = scene.masks.arrays.triangles["uv"][scene.masks.row[masked]]
    assert np.array_equal(got, uv_of(corners(scene)[masked]))


def test_coordinates_and_colours_move_with_morph_targets(tmp_path: Path) -> None:
    color = np.full((4, 4), 0.75, "f4")
    gltf = leaf(attributes={"TEXCOORD_0": uv_of(SQUARE).astype("f4"), "COLOR_0": color})
    target = {
        "TEXCOORD_0": gltf.accessor(np.tile(np.array([[1, -2]], "f4"), (4, 1))),
        "COLOR_0": gltf.accessor(np.full((4, 4), -0.5, "f4")),
    }
    mesh = gltf.json["meshes"][0]
    mesh["primitives"][0]["targets"] = [target]
    mesh["weights"] = [0.25]
    scene, masks = loaded(gltf, tmp_path)
    assert np.array_equal(uv(masks), uv_of(corners(scene)) + np.array([0.25, -0.5]))
    assert (masks.arrays.triangles["vertex_alpha"] == 0.625).all()


def test_draco_carries_coordinates_too(tmp_path: Path) -> None:
    draco = pytest.importorskip("DracoPy")
    points = SQUARE * 4
    data = draco.encode(points, TWO.reshape(-1, 3), tex_coord=uv_of(SQUARE), quantization_bits=16)
    found = draco.decode(data).attributes
    ids = {a["num_components"]: a["unique_id"] for a in found}
    gltf = leaf(points, TWO)
    gltf.json["meshes"][0]["primitives"][0]["extensions"] = {
        "KHR_draco_mesh_compression": {
            "bufferView": gltf.view(data),
            "attributes": {"POSITION": ids[3], "TEXCOORD_0": ids[2]},
        }
    }
    # What the accessors say is only a shape: were it read, every coordinate would be wrong.
    accessor = gltf.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"]
    gltf.json["accessors"][accessor].pop("bufferView")
    scene, masks = loaded(gltf, tmp_path)
    # A range below 1 in 16 bits.
    assert np.allclose(uv(masks), uv_of(corners(scene) / 4), rtol=0.0, atol=2.0**-16)


def test_image_of_several_materials_is_stored_once(tmp_path: Path) -> None:
    gltf = leaf()
    gltf.entry("textures", source=0, sampler=0)
    gltf.entry("samplers", wrapS=33071)
    used = [gltf.json["meshes"][0]["primitives"][0]]
    for more in ({"info": {"index": 1}}, {"info": {"index": 0}, "alphaCutoff": 0.25}):
        used.append({**used[0], "material": add_material(gltf, **more)})
    used.append({**used[0], "material": add_material(gltf, {"index": 0}, name="as the first")})
    gltf.json["meshes"][0]["primitives"] = used
    _, masks = loaded(gltf, tmp_path)
    assert len(masks.arrays.textures) == 1
    assert masks.arrays.triangles["material"].tolist() == [0, 0, 1, 1, 2, 2, 0, 0]


def test_opaque_materials_read_no_image(tmp_path: Path) -> None:
    for mode in ("OPAQUE", "BLEND"):
        gltf = leaf(data=b"no image at all")
        gltf.json["materials"][0]["alphaMode"] = mode
        gltf.node(mesh=0)
        scene = load(gltf, tmp_path)
        assert scene.masks is None
        assert scene.notes == ()


def test_digest_tells_masks_apart(tmp_path: Path) -> None:
    changed = ALPHA.copy()
    changed[2, 3] ^= 1
    scenes = [loaded(leaf(data=image(alpha)), tmp_path)[0] for alpha in (ALPHA, ALPHA, changed)]
    assert scenes[0].digest == scenes[1].digest
    assert len({scenes[0].digest, scenes[2].digest, replace(scenes[0], masks=None).digest}) == 3


def test_masks_of_other_triangles_are_refused(tmp_path: Path) -> None:
    scene, masks = loaded(leaf(), tmp_path)
    with pytest.raises(InputError, match="masks have 1 rows for 2 triangles"):
        replace(scene, masks=masks.take(np.array([True, False])))
    assert not masks.row.flags.writeable


def test_samples_of_a_card_are_those_of_its_texels(tmp_path: Path) -> None:
    """A card before the camera, four samples to a texel: what lies well inside one is decided,
    and as the texel says."""
    shape = np.zeros((16, 16), np.uint8)
    shape[3:11, 5:14] = 255
    points = SQUARE * 2 - np.array([1, 1, 3], "f4")
    flat = np.stack([SQUARE[:, 0], 1.0 - SQUARE[:, 1]], axis=1).astype("f4")
    gltf = leaf(points, data=image(shape), attributes={"TEXCOORD_0": flat})
    scene, masks = loaded(gltf, tmp_path)
    size = 64
    axes = np.array([[0.0, 0, 0], [0, 0, -1], [1 / size, 0, 0], [0, 1 / size, 0]])
    y, x = np.mgrid[:size, :size]
    samples = np.stack([2 * x + 1 - size, size - 2 * y - 1], axis=-1).reshape(-1, 2)
    place = samples / size
    # The card's two halves meet in the diagonal, where either has the same coordinates.
    triangle = np.where(place[:, 1] > place[:, 0], 1, 0)
    found = states_at(masks, masks.row[triangle], axes, samples, False, corners(scene)[triangle])
    texel = np.repeat(np.repeat(shape, 4, axis=0), 4, axis=1).reshape(-1) > 0
    decided = found != BETWEEN
    assert np.array_equal(found[decided] == SOLID, texel[decided])
    # The band round the 9 x 8 texels: a footprint and a filter reach 1 + 2 samples to each side.
    inside = (9 * 4 - 6) * (8 * 4 - 6)
    assert int((found == SOLID).sum()) == inside
    assert int((found == HOLE).sum()) == size * size - (9 * 4 + 6) * (8 * 4 + 6)


def test_blocks_of_instances_change_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gltf = leaf()
    for i in range(20):
        gltf.node(mesh=0, name="part", translation=[i, 0, 0], scale=[(-1) ** i, 1, 1])
    whole = load(gltf, tmp_path).digest
    monkeypatch.setattr("visref.formats.placed._BLOCK_TRIANGLES", 5)
    assert load(gltf, tmp_path).digest == whole
