"""Files that were made to harm: each is refused in one line, before it takes memory or time."""

from __future__ import annotations

import io
import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.support.gltf_files import SQUARE, TRIANGLE, TWO, Gltf
from visref.errors import InputError
from visref.formats import load_path, load_scene
from visref.formats.gltf.meshes import draco_counts
from visref.inputs import open_inputs

LIMIT = 256 << 20


def refused(file: Path, match: str, *, load=load_scene, **options) -> str:
    """The one line that a file is refused with."""
    with pytest.raises(InputError, match=match) as caught:
        load(file, max_memory=LIMIT, **options)
    line = str(caught.value)
    assert line.startswith(str(file))
    assert "\n" not in line
    assert len(line) < 2000
    line.encode()  # no half characters
    return line


def with_accessor(count: int, **more) -> Gltf:
    """A square whose first accessor is a mere count."""
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh(gltf.primitive(SQUARE, TWO)))
    first = gltf.json["accessors"][0]
    del first["bufferView"]
    first.update(count=count, **more)
    return gltf


def instanced(count: int) -> Gltf:
    gltf = Gltf()
    places = gltf.entry("accessors", componentType=5126, type="VEC3", count=count)
    extension = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}}
    gltf.node(mesh=gltf.mesh(gltf.primitive(SQUARE, TWO)), extensions=extension)
    return gltf


def sparse(count: int) -> Gltf:
    gltf = with_accessor(count)
    gltf.json["accessors"][0]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": gltf.view(b"\1"), "componentType": 5121},
        "values": {"bufferView": gltf.view(bytes(12))},
    }
    return gltf


def one_buffer_many_meshes(count: int) -> Gltf:
    gltf = Gltf()
    primitive = gltf.primitive(np.resize(SQUARE, (4000, 3)), np.resize(TWO, 12000).astype("u2"))
    for _ in range(count):
        gltf.node(mesh=gltf.mesh(primitive))
    return gltf


def picture(side: int) -> Gltf:
    gltf = Gltf()
    image = io.BytesIO()
    Image.new("RGBA", (side, side), (0, 0, 0, 255)).save(image, "PNG")
    uv = {"TEXCOORD_0": gltf.accessor(SQUARE[:, :2])}
    primitive = gltf.primitive(SQUARE, TWO, material=0)
    primitive["attributes"] |= uv
    gltf.entry("images", bufferView=gltf.view(image.getvalue()), mimeType="image/png")
    gltf.entry("textures", source=0)
    look = {"baseColorTexture": {"index": 0}}
    gltf.entry("materials", alphaMode="MASK", pbrMetallicRoughness=look)
    gltf.node(mesh=gltf.mesh(primitive))
    return gltf


@pytest.mark.parametrize(
    ("gltf", "match"),
    [
        pytest.param(instanced(30_000_000), r"30,000,000 instances × 2 triangles", id="instances"),
        pytest.param(with_accessor(2**31 - 1), r"2,147,483,647 vertices", id="count"),
        pytest.param(sparse(2**31 - 1), r"2,147,483,647 vertices", id="sparse"),
        pytest.param(one_buffer_many_meshes(3000), r"4,000 triangles would", id="shared"),
        pytest.param(picture(4000), r"an image of 4000 × 4000 pixels", id="picture"),
    ],
)
def test_what_expands_beyond_the_limit_is_named_with_both_sizes(tmp_path, gltf, match):
    file = gltf.write(tmp_path / "a.glb")
    assert file.stat().st_size < 1 << 20
    line = refused(file, match)
    assert "the limit is 256 MiB; give more with --max-memory" in line


@pytest.mark.parametrize("gltf", [instanced(3), one_buffer_many_meshes(3), picture(40)])
def test_the_same_files_in_small_are_read(tmp_path, gltf):
    assert load_scene(gltf.write(tmp_path / "a.glb"), max_memory=LIMIT).triangle_count


def test_limit_is_the_callers_and_not_the_files(tmp_path):
    file = one_buffer_many_meshes(20).write(tmp_path / "a.glb")
    assert load_scene(file, max_memory=LIMIT).triangle_count == 20 * 4000
    with pytest.raises(InputError, match="the limit is 10 MiB"):
        load_scene(file, max_memory=10 << 20)


def test_compressed_meshes_say_how_large_they_are():
    draco = pytest.importorskip("DracoPy")
    for level in (0, 5, 10):
        data = draco.encode(SQUARE, TWO.reshape(-1, 3).astype("u4"), compression_level=level)
        assert draco_counts(data) == (4, 2)
    assert draco_counts(b"DRACO\2\2\1\0\0\0" + b"\xff\xff\xff\xff\x0f" * 2) == (
        2**32 - 1,
        2**32 - 1,
    )


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.ply", "element vertex 1000000000000\nproperty float x\nend_header\n0\n"),
        ("a.ply", "element face -1\nproperty list uchar int vertex_indices\nend_header\n"),
        ("a.ply", "element vertex 1_0\nproperty float x\nend_header\n"),
        ("a.ply", "element vertex 99999999999999999999\nproperty float x\nend_header\n"),
        ("a.off", "OFF\n1000000000000 1 0\n0 0 0\n"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1_0 0 0\n0 1 0\n3 0 1 2\n"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1-2 0\n0 1 0\n3 0 1 2\n"),
        ("a.obj", "v 0 0 0\nv 1_0 0 0\nv 0 1 0\nf 1 2 3\n"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0_3\n"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 ٢ 0\nf 1 2 3\n"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\0\n"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n"),
    ],
)
def test_numbers_that_only_python_reads_and_counts_without_end_are_refused(tmp_path, name, text):
    if name.endswith("ply"):
        text = "ply\nformat ascii 1.0\n" + text
    (tmp_path / name).write_text(text)
    refused(tmp_path / name, "not a number|not understood|truncated|zero byte|too few|out of range")


@pytest.mark.parametrize("kept", [0.2, 0.5, 0.8, 0.97])
@pytest.mark.parametrize("name", ["a.ply", "a.off"])
def test_text_that_is_cut_at_any_place_is_refused(tmp_path, name, kept):
    count = 100
    rows = [f"{i} {i * i % 7} {i % 5}" for i in range(count)]
    rows += [f"3 {i} {i + 1} {i + 2}" for i in range(count - 2)]
    head = f"OFF\n{count} {count - 2} 0\n"
    if name == "a.ply":
        floats = "".join(f"property float {axis}\n" for axis in "xyz")
        head = f"ply\nformat ascii 1.0\nelement vertex {count}\n{floats}element face {count - 2}\n"
        head += "property list uchar int vertex_indices\nend_header\n"
    body = "\n".join(rows) + "\n"
    (tmp_path / name).write_text(head + body)
    assert load_scene(tmp_path / name).triangle_count == count - 2
    (tmp_path / name).write_text(head + body[: int(len(body) * kept)])
    refused(tmp_path / name, "truncated|too few")


@pytest.mark.parametrize("kept", [-1, 1])
def test_binary_ply_of_another_length_than_its_header_says_is_refused(tmp_path, kept):
    floats = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex 3\n{floats}end_header\n"
    body = TRIANGLE.tobytes()
    body = body[:kept] if kept < 0 else body + bytes(kept)
    (tmp_path / "a.ply").write_bytes(head.encode() + body)
    refused(tmp_path / "a.ply", "truncated|more in it than")


def special(folder: Path, kind: str) -> Path:
    if kind == "pipe":
        os.mkfifo(folder / "pipe")
        return folder / "pipe"
    return Path("/dev/zero")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_pipes_and_devices_are_never_waited_for(tmp_path, kind):
    target = special(tmp_path, kind)
    for ending in ("glb", "obj", "ply", "off", "stl", "dae", "json"):
        link = tmp_path / f"a.{ending}"
        link.symlink_to(target)
        refused(link, "not a file|a pipe", load=load_path if ending == "json" else load_scene)
    scene = tmp_path / "m.obj"
    scene.write_text("mtllib link\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "link").symlink_to(target)
    assert any("a pipe, a device" in text for _, text in load_scene(scene).notes)
    gltf = with_accessor(4, bufferView=0)
    gltf.json["buffers"] = [{"byteLength": 100, "uri": "link"}]
    (tmp_path / "b.gltf").write_text(json.dumps(gltf.json))
    refused(tmp_path / "b.gltf", r"buffers\[0\]\.uri: file 'link': this is a pipe, a device")


@pytest.mark.parametrize(
    "uri", ["a\0b", "a%00b", "\ud800", "/etc/passwd", "C:\\x.bin", "file:///x"]
)
def test_names_that_no_neighbour_can_have_are_refused(tmp_path, uri):
    gltf = with_accessor(4, bufferView=0)
    gltf.json["buffers"] = [{"byteLength": 48, "uri": uri}]
    (tmp_path / "b.gltf").write_text(json.dumps(gltf.json))
    refused(tmp_path / "b.gltf", "no file can have|absolute|not a file beside")


def test_a_buffer_may_stand_in_a_folder_beside(tmp_path):
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh(gltf.primitive(SQUARE, TWO)))
    (tmp_path / "scene").mkdir()
    (tmp_path / "other files").mkdir()
    (tmp_path / "other files/x.bin").write_bytes(gltf.blob)
    uri = "../other%20files/x.bin"
    gltf.json["buffers"] = [{"byteLength": len(gltf.blob), "uri": uri}]
    file = tmp_path / "scene/a.gltf"
    file.write_text(json.dumps({k: v for k, v in gltf.json.items() if v != []}))
    assert load_scene(file).triangle_count == 2


def test_zeros_and_half_characters_in_names_become_the_replacement_character(tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(SQUARE, TWO))
    for name in ("a\0b", "\ud800", "😀", "a\0b"):
        gltf.node(mesh=mesh, name=name)
    scene = load_scene(gltf.write(tmp_path / "a.glb"))
    assert scene.names == ("a\ufffdb", "\ufffd", "😀", "a\ufffdb#2")
    assert scene.given_names == scene.paths == ("a\ufffdb", "\ufffd", "😀", "a\ufffdb")


def test_deep_hierarchies_are_read_level_by_level(tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(SQUARE, TWO))
    depth = 3000  # three times as deep as Python recurses
    for i in range(depth):
        gltf.node(root=i == 0, children=[i + 1], name="n")
    gltf.node(root=False, mesh=mesh)
    assert load_scene(gltf.write(tmp_path / "a.glb")).triangle_count == 2


def test_deeply_nested_json_is_refused(tmp_path):
    (tmp_path / "p.json").write_text("[" * 100_000)
    refused(tmp_path / "p.json", "too deep|not valid JSON", load=load_path)
    (tmp_path / "a.gltf").write_text('{"asset":' * 100_000)
    refused(tmp_path / "a.gltf", "too deep|not valid JSON")


def test_a_frame_too_large_for_the_limit_is_named_with_its_size(tmp_path):
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh(gltf.primitive(SQUARE, TWO)))
    scene = gltf.write(tmp_path / "a.glb")
    frame = {"world_from_camera": np.eye(4).tolist()}
    path = {"format": "visref-path", "version": 1, "width": 64, "height": 64, "near": 0.1}
    path |= {"yfov": 1.0, "frames": [frame, {**frame, "width": 16384, "height": 16384}]}
    file = tmp_path / "p.json"
    file.write_text(json.dumps(path))
    with pytest.raises(InputError) as caught:
        open_inputs(str(scene), path=str(file), max_memory=LIMIT)
    assert str(caught.value).startswith(
        f"{file}: frames[1]: an image of 16384 × 16384 samples would need about 25 GiB"
    )
    assert len(open_inputs(str(scene), path=str(file), frames="0:1", max_memory=LIMIT).frames) == 1


def test_zipped_text_is_measured_before_it_is_unzipped(tmp_path):
    pytest.importorskip("collada")
    with zipfile.ZipFile(tmp_path / "a.zae", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.dae", b" " * (LIMIT + 1))
    assert (tmp_path / "a.zae").stat().st_size < 1 << 20
    refused(tmp_path / "a.zae", "'a.dae', unzipped, would need")
