"""Geometry compressed with meshopt is read as it was before, and hostile streams are refused."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from tests.support import meshopt_encoder as encoder
from tests.support.gltf_files import SQUARE, TWO, Gltf, one_triangle
from tests.support.meshopt_encoder import compressed_accessor
from visref.errors import InputError
from visref.formats import load_scene
from visref.formats.gltf import meshopt_codecs as codecs
from visref.formats.gltf.meshopt_filters import FILTERS, UnspecifiedElement


def attributes(data: bytes, count: int, stride: int) -> np.ndarray | None:
    stream = np.frombuffer(data, np.uint8)
    result = np.full((count, stride), 0xCC, np.uint8)
    tail = codecs.tail_bytes(data[0], stride)
    _, whole = codecs.decode_attributes(stream, tail, stride, data[0] - 0xA0, result)
    return result if whole else None


def corners(decode, data: bytes, count: int, kind: str = "<u4") -> list[int] | None:
    result = np.zeros(count, kind)
    _, whole = decode(np.frombuffer(data, np.uint8), result)
    return result.tolist() if whole else None


def smooth(count: int, stride: int, seed: int) -> np.ndarray:
    """Bytes that change by a little as a rule, and by much now and then."""
    random = np.random.default_rng(seed)
    step = random.integers(-2, 3, (count, stride))
    step[random.random(step.shape) < 0.05] = 100
    step[:, random.random(stride) < 0.3] = 0
    return np.cumsum(step, axis=0).astype(np.uint8)


# --- attributes


def test_the_specification_s_own_example_is_decoded():
    group = bytes.fromhex("175ff0bc77a9210034b5")
    deltas = [-1, -4, -3, 26, -91, 0, -6, 6, -4, -4, 5, -5, 1, -1, 0, 0]
    # A lane of 4-bit deltas, then three lanes of nothing, then the tail.
    data = b"\xa0" + b"\x02" + group + bytes(3) + bytes(32)
    found = attributes(data, 16, 4)
    assert found is not None
    assert found[:, 0].tolist() == (np.cumsum(deltas) % 256).tolist()
    assert not found[:, 1:].any()


@pytest.mark.parametrize("stride", [4, 8, 12, 64, 256])
@pytest.mark.parametrize("count", [1, 15, 16, 17, 255, 256, 257, 700])
def test_attributes_of_version_0_are_decoded(stride, count):
    rows = smooth(count, stride, count)
    assert np.array_equal(attributes(encoder.attributes(rows), count, stride), rows)


@pytest.mark.parametrize("modes", [(0,), (1,), (0x02,), (0x12,), (0xF2,), (0, 1, 0x72)])
@pytest.mark.parametrize("controls", [(0,), (1,), (2,), (3,), (2, 0, 3, 1, 1)])
def test_attributes_of_version_1_are_decoded_in_every_mode(modes, controls):
    for count, stride in ((1, 4), (33, 12), (300, 24)):
        rows = smooth(count, stride, stride)
        data = encoder.attributes(rows, version=1, modes=modes, controls=controls)
        assert np.array_equal(attributes(data, count, stride), rows)


@pytest.mark.parametrize("version", [0, 1])
def test_an_attribute_stream_holds_neither_more_nor_less(version):
    rows = smooth(300, 8, 1)
    data = encoder.attributes(rows, version=version)
    assert attributes(data, 300, 8) is not None
    tail = codecs.tail_bytes(data[0], 8)
    assert attributes(data[: -tail - 1] + data[-tail:], 300, 8) is None
    assert attributes(data[:-tail] + b"\0" + data[-tail:], 300, 8) is None
    assert attributes(data, 600, 8) is None


@pytest.mark.parametrize("mode", [3, 0x10, 0x21, 15])
def test_a_channel_mode_that_there_is_not_is_refused(mode):
    data = encoder.attributes(smooth(20, 4, 3), version=1)
    assert attributes(data[:-1] + bytes([mode]), 20, 4) is None


# --- indices


def test_an_index_sequence_is_decoded():
    sequence = [0, 1000, 1, 1001, 2, 5, 70_000, 0, 2**30 - 1, 3]
    data = encoder.indices(sequence)
    assert corners(codecs.decode_indices, data, 10) == sequence
    short = [index & 0xFFFF for index in sequence]
    assert corners(codecs.decode_indices, data, 10, "<u2") == short
    for spoilt in (data[:-1], data + b"\0", data[:4] + b"\xff" * 6 + data[4:]):
        assert corners(codecs.decode_indices, spoilt, 10) is None


def every_code() -> encoder.Triangles:
    """Uses each kind of code."""
    made = encoder.Triangles([0x00, 0x10, 0x02, 0x21, 0xEE])
    made.three(0xF0)
    made.edge(0, 0)
    for back in range(15):
        if back < len(made.edges):
            made.edge(back, 0)
    made.three(0xF1)
    made.three(0xF2)
    made.three(0xF3)
    made.three(0xF4)
    for low in range(1, 13):
        made.edge(low % 5, low)
    made.edge(3, 15, 40_000)
    made.edge(1, 13)
    made.edge(2, 14)
    made.three(0xFE, 0xF3, [7])
    made.three(0xFF, 0x1F, [90_000, 12])
    made.three(0xFF, 0xFF, [1, 2, 3])
    made.three(0xFE, 0x00)
    made.edge(0, 0)
    return made


def test_triangles_of_every_code_are_decoded():
    made = every_code()
    expected = np.array(made.made)
    found = corners(codecs.decode_triangles, made.stream(), expected.size)
    assert found == expected.reshape(-1).tolist()
    short = corners(codecs.decode_triangles, made.stream(), expected.size, "<u2")
    assert short == (expected.reshape(-1) & 0xFFFF).tolist()


def test_a_cut_or_longer_stream_of_triangles_is_refused():
    made = every_code()
    count, data = 3 * len(made.made), made.stream()
    for spoilt in (data[:-17] + data[-16:], data[:-16] + b"\0" + data[-16:], data[:12]):
        assert corners(codecs.decode_triangles, spoilt, count) is None


@pytest.mark.parametrize("code", [0x00, 0x31])
def test_an_edge_that_was_never_written_is_refused(code):
    assert corners(codecs.decode_triangles, b"\xe1" + bytes([code]) + bytes(16), 3) is None


def test_a_vertex_that_was_never_written_is_refused():
    made = encoder.Triangles()
    made.three(0xF0)
    data = b"\xe1" + made.codes + b"\x04" + bytes(16)
    assert corners(codecs.decode_triangles, data, 6) is None
    assert corners(codecs.decode_triangles, b"\xe1\xfe\x11" + bytes(16), 3) is None


@pytest.mark.parametrize(("place", "value"), [(14, 1), (15, 16), (3, 0x0F), (3, 0xF0)])
def test_a_table_of_codes_that_is_not_one_is_refused(place, value):
    made = encoder.Triangles()
    made.three(0xF0)
    data = bytearray(made.stream())
    data[len(data) - 16 + place] = value
    assert corners(codecs.decode_triangles, bytes(data), 3) is None


@pytest.mark.parametrize("seed", range(40))
def test_no_spoilt_stream_is_read_or_written_out_of_bounds(seed, monkeypatch):
    """In Python, where an index out of bounds raises: spoilt streams end in a word, not in one."""
    random = np.random.default_rng(seed)
    plain = {name: getattr(codecs, name) for name in dir(codecs)}
    for name, kernel in plain.items():
        if hasattr(kernel, "py_func"):
            monkeypatch.setattr(codecs, name, _checked(kernel.py_func))
    rows = smooth(40, 8, seed)
    streams = (
        (encoder.attributes(rows), lambda data: attributes(data, 40, 8)),
        (encoder.attributes(rows, version=1), lambda data: attributes(data, 40, 8)),
        (encoder.indices([3, 1, 2, 900]), lambda d: corners(codecs.decode_indices, d, 4)),
        (every_code().stream(), lambda d: corners(codecs.decode_triangles, d, 135)),
    )
    for good, decode in streams:
        for _ in range(10):
            data = bytearray(good)
            for _ in range(random.integers(1, 4)):
                data[random.integers(1, len(data))] = random.integers(256)
            least = 1 + (codecs.tail_bytes(good[0], 8) if good[0] < 0xB0 else 0)
            decode(bytes(data[: random.integers(least, len(data) + 1)]))


def _checked(function):
    """With arrays that have no negative index."""

    def call(*given):
        return function(*(_Bounded(x) if isinstance(x, np.ndarray) else x for x in given))

    return call


class _Bounded(np.ndarray):
    def __new__(cls, array):
        return array.view(cls)

    def __getitem__(self, key):
        self._check(key)
        found = super().__getitem__(key)
        return found if isinstance(found, np.ndarray) else int(found)

    def __setitem__(self, key, value):
        self._check(key)
        super().__setitem__(key, value)

    def _check(self, key):
        for number in key if isinstance(key, tuple) else (key,):
            for end in (number.start or 0, number.stop or 0) if isinstance(number, slice) else ():
                assert 0 <= end <= max(self.shape)
            assert isinstance(number, slice) or number >= 0


# --- filters


def filtered(name: str, values: list[list[int]], kind: str) -> np.ndarray:
    return FILTERS[name][0](np.array(values, kind).view(np.uint8)).view(kind)


def test_octahedral_vectors_have_their_length_and_direction():
    one = 511
    found = filtered("OCTAHEDRAL", [[0, 0, one, 9], [one, 0, one, -9], [0, -one, one, 0],
                                    [one, one, one, 1], [-one, one, one, 1]], "<i2")  # fmt: skip
    top = 32767
    assert found.tolist() == [[0, 0, top, 9], [top, 0, 0, -9], [0, -top, 0, 0],
                              [0, 0, -top, 1], [0, 0, -top, 1]]  # fmt: skip
    # (1, 1, 1) / sqrt(3): a third of one along x and y.
    assert filtered("OCTAHEDRAL", [[21, 21, 63, 5]], "i1").tolist() == [[73, 73, 73, 5]]


def test_quaternions_get_their_largest_component_back():
    one = 2**11 - 1
    for largest in range(4):
        (found,) = filtered("QUATERNION", [[0, 0, 0, one & ~3 | largest]], "<i2").tolist()
        assert found == [32767 if k == largest else 0 for k in range(4)]
    # Two equal components: one stored, as 1 / sqrt(2) times sqrt(2).
    (found,) = filtered("QUATERNION", [[one, 0, 0, one & ~3 | 3]], "<i2").tolist()
    assert found == [23170, 0, 0, 23170]


def test_exponential_numbers_are_exact():
    words = [(e << 24 | m & 0xFFFFFF) for e, m in ((0, 1), (-1, -3), (100, 1), (-100, 2**22))]
    words = [word - 2**32 if word >= 2**31 else word for word in words]
    found = filtered("EXPONENTIAL", [words], "<i4").view("<f4")[0].tolist()
    assert found == [1.0, -1.5, 2.0**100, 2.0**-78]


def test_colours_come_out_of_luma_and_chroma():
    # K of 8 bits: white, red as y + co - cg, and alpha of 7 bits below its own mark.
    found = filtered("COLOR", [[255, 0, 0, 0xFF], [64, 127, -64, 0x80]], "i2").view("u2")
    assert found.tolist() == [[65535] * 4, [65535, 0, 257, 0]]


@pytest.mark.parametrize(
    ("name", "values", "kind"),
    [
        ("OCTAHEDRAL", [0, 0, 0, 0], "i1"),
        ("OCTAHEDRAL", [0, 0, 100, 0], "i1"),
        ("OCTAHEDRAL", [64, 0, 63, 0], "i1"),
        ("QUATERNION", [0, 0, 0, 0], "<i2"),
        ("QUATERNION", [0, 0, 0, 64], "<i2"),
        ("QUATERNION", [8, 0, 0, 4], "<i2"),
        ("EXPONENTIAL", [101 << 24], "<i4"),
        ("EXPONENTIAL", [-101 << 24], "<i4"),
        ("COLOR", [0, 0, 0, 0], "i1"),
        ("COLOR", [0, 0, 0, 1], "i1"),
        ("COLOR", [0, 100, 0, -1], "i1"),
    ],
)
def test_what_the_specification_leaves_open_is_refused(name, values, kind):
    good = {"OCTAHEDRAL": [0, 0, 63, 0], "QUATERNION": [0, 0, 0, 7], "EXPONENTIAL": [0],
            "COLOR": [0, 0, 0, 2]}[name]  # fmt: skip
    filtered(name, [good], kind)
    with pytest.raises(UnspecifiedElement) as error:
        filtered(name, [good, good, values], kind)
    assert error.value.element == 2


# --- in a file


def square(**more) -> Gltf:
    """A square of one triangle pair, its positions and its triangles compressed."""
    gltf = Gltf()
    data = encoder.attributes(SQUARE.view(np.uint8).reshape(4, 12), version=more.get("version", 0))
    name = more.get("name", "EXT_meshopt_compression")
    position = compressed_accessor(gltf, SQUARE, data, "ATTRIBUTES", states_stride=True, name=name)
    mode = more.get("mode", "TRIANGLES")
    data = (encoder.triangles if mode == "TRIANGLES" else encoder.indices)(TWO.tolist())
    indices = compressed_accessor(gltf, TWO, data, mode, name=name)
    gltf.node(mesh=gltf.mesh({"attributes": {"POSITION": position}, "indices": indices}))
    return gltf


def plain_square() -> Gltf:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh(gltf.primitive(SQUARE, TWO)))
    return gltf


@pytest.mark.parametrize("mode", ["TRIANGLES", "INDICES"])
@pytest.mark.parametrize("version", [0, 1])
@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_a_compressed_file_is_the_same_scene(tmp_path, mode, version, name):
    packed = load_scene(square(mode=mode, version=version, name=name).write(tmp_path / "a.glb"))
    assert packed.digest == load_scene(plain_square().write(tmp_path / "b.glb")).digest


def test_quantised_positions_with_padding_are_read(tmp_path):
    """KHR_mesh_quantization: three int16 of an element of 8 bytes."""
    gltf = Gltf()
    padded = np.zeros((4, 4), "<i2")
    padded[:, :3] = SQUARE * 100
    data = encoder.attributes(padded.view(np.uint8).reshape(4, 8))
    position = compressed_accessor(gltf, padded, data, "ATTRIBUTES", states_stride=True)
    gltf.json["accessors"][position]["type"] = "VEC3"
    gltf.json["extensionsRequired"].append("KHR_mesh_quantization")
    primitive = {"attributes": {"POSITION": position}, "indices": gltf.accessor(TWO)}
    gltf.node(mesh=gltf.mesh(primitive), scale=[0.01] * 3)
    gltf.json["buffers"][0]["byteLength"] = len(gltf.blob)
    scene = load_scene(gltf.write(tmp_path / "scene.glb"))
    assert np.allclose(scene.vertices[scene.triangles].reshape(-1, 3), SQUARE[TWO], atol=1e-7)


def test_exponential_positions_are_read(tmp_path):
    gltf = Gltf()
    words = np.array((-2 << 24) | np.array(SQUARE * 4, "i4") & 0xFFFFFF, "<i4")
    data = encoder.attributes(words.view(np.uint8).reshape(4, 12))
    position = compressed_accessor(gltf, SQUARE, data, "ATTRIBUTES", filter="EXPONENTIAL")
    primitive = {"attributes": {"POSITION": position}, "indices": gltf.accessor(TWO)}
    gltf.node(mesh=gltf.mesh(primitive))
    gltf.json["buffers"][0]["byteLength"] = len(gltf.blob)
    scene = load_scene(gltf.write(tmp_path / "scene.glb"))
    assert scene.digest == load_scene(plain_square().write(tmp_path / "b.glb")).digest


def test_compressed_rotations_of_instances_are_read(tmp_path):
    """A quarter turn about z, its w left out as the largest component is not: both are equal."""
    gltf = one_triangle()
    turn = np.array([[0, 0, 2047, 2044]], "<i2")  # w is stored as x would be: (w) = 3 is left out
    data = encoder.attributes(turn.view(np.uint8).reshape(1, 8))
    rotation = compressed_accessor(
        gltf, np.zeros((1, 4), "i2"), data, "ATTRIBUTES", filter="QUATERNION"
    )
    gltf.json["accessors"][rotation]["normalized"] = True
    attributes = {"EXT_mesh_gpu_instancing": {"attributes": {"ROTATION": rotation}}}
    gltf.json["nodes"][0]["extensions"] = attributes
    scene = load_scene(gltf.write(tmp_path / "scene.glb"))
    # (x, y, z) in the places after component 0: x = w = 1 / sqrt(2), a quarter turn about x.
    expected = [[0, 0, 0], [1, 0, 0], [0, 0, 1]]
    assert np.allclose(scene.vertices, expected, atol=2.0 / 32767.0)


def test_the_compressed_bytes_are_read_and_not_the_fallback(tmp_path):
    """As readers with the extension do; a fallback may be missing or be another model."""
    gltf = square()
    expected = load_scene(gltf.write(tmp_path / "a.glb")).digest
    gltf.json["buffers"][1]["uri"] = "no such file"
    assert load_scene(gltf.write(tmp_path / "b.glb")).digest == expected


def test_a_view_named_by_many_accessors_is_decompressed_once(tmp_path):
    gltf = square()
    primitive = gltf.json["meshes"][0]["primitives"][0]
    gltf.json["meshes"][0]["primitives"] = [copy.deepcopy(primitive) for _ in range(500)]
    gltf.json["buffers"][0]["byteLength"] = len(gltf.blob)
    scene = load_scene(gltf.write(tmp_path / "scene.glb"), max_memory=4 << 20)
    assert scene.triangle_count == 1000


WRONG = {
    "mode": ("mode", "CUBES", "'CUBES' is not ATTRIBUTES, TRIANGLES or INDICES"),
    "filter": ("filter", "SEPIA", "'SEPIA' is not NONE, OCTAHEDRAL"),
    "stride": ("byteStride", 6, "6 is not a multiple of 4"),
    "filter's stride": ("filter", "QUATERNION", "12 bytes are no element of the filter QUATERNION"),
    "count": ("count", 5, "5 elements of 12 bytes are not 48 bytes"),
    "length": ("byteLength", 30, "has 30 bytes, and 33 at least are due"),
    "offset": ("byteOffset", 10_000, "it ends at byte"),
    "buffer": ("buffer", 2, "buffers[2] is named, but the file has 2"),
    "bytes": ("byteOffset", 1, "starts with 0x"),
    "no mode": ("mode", None, "'mode' is missing"),
}


@pytest.mark.parametrize(("key", "value", "message"), WRONG.values(), ids=WRONG)
def test_what_contradicts_itself_is_refused_with_its_place(tmp_path, key, value, message):
    gltf = square()
    extension = gltf.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"]
    extension[key] = value
    if value is None:
        del extension[key]
    with pytest.raises(InputError) as error:
        load_scene(gltf.write(tmp_path / "scene.glb"))
    assert message in str(error.value)
    assert "bufferViews[0]" in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_a_filter_on_triangles_is_refused(tmp_path):
    gltf = square()
    extension = gltf.json["bufferViews"][1]["extensions"]["EXT_meshopt_compression"]
    extension["filter"] = "COLOR"
    with pytest.raises(InputError, match="TRIANGLES has no filter"):
        load_scene(gltf.write(tmp_path / "scene.glb"))


def test_both_names_at_once_are_refused(tmp_path):
    gltf = square()
    extensions = gltf.json["bufferViews"][0]["extensions"]
    extensions["KHR_meshopt_compression"] = extensions["EXT_meshopt_compression"]
    with pytest.raises(InputError, match="exclude each other"):
        load_scene(gltf.write(tmp_path / "scene.glb"))


def test_a_spoilt_stream_is_refused_in_one_line(tmp_path):
    gltf = square()
    place = gltf.json["bufferViews"][1]["extensions"]["EXT_meshopt_compression"]
    blob = bytearray(gltf.blob)
    blob[place["byteOffset"] + 1] = 0x40
    gltf.blob = bytes(blob)
    with pytest.raises(InputError, match="not valid at byte 1 of "):
        load_scene(gltf.write(tmp_path / "scene.glb"))


def test_a_few_bytes_that_stand_for_gigabytes_are_refused_before_they_are_taken(tmp_path):
    gltf = square()
    view = gltf.json["bufferViews"][0]
    extension = view["extensions"]["EXT_meshopt_compression"]
    extension["count"] = 100_000_000
    view["byteLength"] = 1_200_000_000
    with pytest.raises(InputError, match="100,000,000 elements, decompressed, would need about"):
        load_scene(gltf.write(tmp_path / "scene.glb"), max_memory=64 << 20)
