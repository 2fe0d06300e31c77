"""What a glTF file animates is posed as an evaluation of our own says, vertex for vertex."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from tests.support.gltf_files import SQUARE, TRIANGLE, TWO, Gltf, one_triangle
from tests.support.gltf_pose import ROUNDINGS, Pose
from visref.formats.gltf.objects import read_gltf
from visref.formats.placed import Placed
from visref.memory import Budget

POINTER = "KHR_animation_pointer"
VISIBLE = "extensions/KHR_node_visibility/visible"


def animate(
    gltf: Gltf,
    target: int | str,
    path: str,
    times: Any,
    values: Any,
    kind: str = "LINEAR",
    *,
    clip: int = 0,
    **more: Any,
) -> None:
    """Add a channel: to a node, or to what a pointer names. `more` is said of the output."""
    clips = gltf.json.setdefault("animations", [])
    while len(clips) <= clip:
        clips.append({"samplers": [], "channels": []})
    values = np.asarray(values)
    values = values.astype("f4") if values.dtype.kind == "f" else values
    clips[clip]["samplers"].append(
        {
            "input": gltf.accessor(np.array(times, "f4")),
            "output": gltf.accessor(values, **more),
            "interpolation": kind,
        }
    )
    where: dict[str, Any] = {"node": target, "path": path}
    if isinstance(target, str):
        where = {"path": "pointer", "extensions": {POINTER: {"pointer": f"{target}/{path}"}}}
    number = len(clips[clip]["samplers"]) - 1
    clips[clip]["channels"].append({"sampler": number, "target": where})


def read(gltf: Gltf, folder: Path) -> Placed:
    return read_gltf(gltf.write(folder / "moving.glb"), budget=Budget.of(1 << 30))


def corners(placed: Placed, number: int, clip: int, time: float) -> np.ndarray:
    """(3 t, 3) float64: where an object's corners are at a time."""
    assert placed.motion is not None
    mesh = placed.meshes[placed.mesh_of_object[number]]
    moment = placed.motion.at(clip, time)
    world = np.concatenate(placed.world_from_object)[number]
    points = moment.positions.get(number, mesh.positions).astype(np.float64)
    if number in moment.objects:
        world = moment.worlds[moment.objects.tolist().index(number)]
    assert points.shape == mesh.positions.shape
    return (points @ world[:3, :3].T + world[:3, 3])[np.asarray(mesh.triangles).reshape(-1)]


def assert_as_evaluated(
    placed: Placed, document: dict[str, Any], buffers: list[bytes], clip: int | None, time: float
) -> None:
    """Every corner of every object is where the evaluation has it: within the roundings of float64,
    and so, where these are less than half of its last place, within one place of float32."""
    pose = Pose(document, buffers, clip, time)
    number = 0
    for node in placed_nodes(document):
        want, size = pose.corners(node)
        for instance, instance_size in zip(want, size, strict=True):
            if clip is None:
                mesh = placed.meshes[placed.mesh_of_object[number]]
                world = np.concatenate(placed.world_from_object)[number]
                points = mesh.positions.astype(np.float64) @ world[:3, :3].T + world[:3, 3]
                got = points[np.asarray(mesh.triangles).reshape(-1)]
            else:
                got = corners(placed, number, clip, time)
            allowed = ROUNDINGS * 2.0**-53 * instance_size
            assert (np.abs(got - instance) <= allowed).all()
            place = np.spacing(np.abs(instance).astype("f4"))
            sure = allowed <= place / 2
            off = np.abs(got.astype("f4").astype(np.longdouble) - instance)
            assert (off[sure] <= place[sure]).all()
            number += 1
    assert number == len(placed.names)


def placed_nodes(document: dict[str, Any]) -> list[int]:
    """The nodes with a mesh, depth first."""
    result: list[int] = []

    def visit(node: int) -> None:
        if "mesh" in document["nodes"][node]:
            result.append(node)
        for child in document["nodes"][node].get("children", []):
            visit(child)

    for root in document["scenes"][0]["nodes"]:
        visit(root)
    return result


@st.composite
def rigs(draw) -> Gltf:
    """Nodes that carry meshes with morph targets, skins or instances, and what animates them."""
    numbers = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    gltf = Gltf()
    count = draw(st.integers(2, 6))
    for node in range(count):
        gltf.node(root=False, children=[])
        entry = gltf.json["nodes"][node]
        if node and draw(st.booleans()):
            gltf.json["nodes"][draw(st.integers(0, node - 1))]["children"].append(node)
        else:
            gltf.json["scenes"][0]["nodes"].append(node)
        if draw(st.booleans()):
            entry["translation"] = numbers.uniform(-4, 4, 3).tolist()
            entry["rotation"] = quaternions(numbers, 1)[0].tolist()
            entry["scale"] = numbers.uniform(-2, 2, 3).tolist()
    for node in range(count):
        if not gltf.json["nodes"][node]["children"]:
            del gltf.json["nodes"][node]["children"]
    skin = None
    if draw(st.booleans()):
        joints = draw(st.lists(st.integers(0, count - 1), min_size=1, max_size=5))
        bind = numbers.uniform(-1, 1, (len(joints), 4, 4)).astype("f4")
        bind[:, 3] = (0, 0, 0, 1)
        more = {"inverseBindMatrices": gltf.accessor(bind.transpose(0, 2, 1).reshape(-1, 16))}
        skin = gltf.entry("skins", joints=joints, **(more if draw(st.booleans()) else {}))
    targets = draw(st.integers(0, 3))
    meshes = [draw(mesh_of(gltf, numbers, targets, skin)) for _ in range(draw(st.integers(1, 2)))]
    for node in draw(st.lists(st.integers(0, count - 1), min_size=1, unique=True)):
        entry = gltf.json["nodes"][node]
        entry["mesh"] = draw(st.sampled_from(meshes))
        kind = draw(st.sampled_from(["plain", "skin", "instances"]))
        if kind == "skin" and skin is not None:
            entry["skin"] = skin
        if kind == "instances":
            places = gltf.accessor(numbers.uniform(-4, 4, (2, 3)).astype("f4"))
            attributes = {"attributes": {"TRANSLATION": places}}
            entry["extensions"] = {"EXT_mesh_gpu_instancing": attributes}
        if targets and draw(st.booleans()):
            entry["weights"] = numbers.uniform(-1, 2, targets).tolist()
    for clip in range(draw(st.integers(1, 2))):
        draw(clip_of(gltf, numbers, clip, targets))
    return gltf


def quaternions(numbers: np.random.Generator, count: int) -> np.ndarray:
    """(count, 4) float32: any, longer and shorter than 1, none of them near zero."""
    found = numbers.normal(size=(count, 4))
    return (found + 0.1 * np.sign(found)).astype("f4")


@st.composite
def mesh_of(draw, gltf: Gltf, numbers: np.random.Generator, targets: int, skin: int | None) -> int:
    """Primitives over 3 to 6 vertices, not all of them used."""
    primitives = []
    for _ in range(draw(st.integers(1, 2))):
        size = draw(st.integers(3, 6))
        stored = numbers.uniform(-2, 2, (size, 3)).astype("f4")
        quantised = draw(st.booleans())
        if quantised:
            points = gltf.accessor(
                np.round(numbers.uniform(-1, 1, (size, 3)) * 32767).astype("i2"), normalized=True
            )
        else:
            points = gltf.accessor(stored)
        corner = numbers.integers(0, size, 3 * draw(st.integers(1, 3))).astype("u2")
        entry: dict[str, Any] = {
            "attributes": {"POSITION": points},
            "indices": gltf.accessor(corner),
        }
        if targets:
            entry["targets"] = [
                {"POSITION": draw(displacement(gltf, numbers, size))} for _ in range(targets)
            ]
        if skin is not None:
            joints = len(gltf.json["skins"][skin]["joints"])
            for number in range(draw(st.integers(1, 3))):
                chosen = numbers.integers(0, joints, (size, 4))
                kind = draw(st.sampled_from(["u1", "u2"]))
                entry["attributes"][f"JOINTS_{number}"] = gltf.accessor(chosen.astype(kind))
                if draw(st.booleans()):
                    weights = gltf.accessor(numbers.uniform(0.01, 1, (size, 4)).astype("f4"))
                else:
                    whole = numbers.integers(1, 256, (size, 4)).astype("u1")
                    weights = gltf.accessor(whole, normalized=True)
                entry["attributes"][f"WEIGHTS_{number}"] = weights
        primitives.append(entry)
    more = {"weights": numbers.uniform(-1, 2, targets).tolist()} if targets else {}
    return gltf.mesh(*primitives, **(more if draw(st.booleans()) else {}))


@st.composite
def displacement(draw, gltf: Gltf, numbers: np.random.Generator, size: int) -> int:
    kind = draw(st.sampled_from(["dense", "sparse", "quantised"]))
    if kind == "quantised":
        return gltf.accessor(numbers.integers(-127, 128, (size, 3)).astype("i1"), normalized=True)
    if kind == "dense":
        return gltf.accessor(numbers.uniform(-2, 2, (size, 3)).astype("f4"))
    rows = np.array(sorted(draw(st.sets(st.integers(0, size - 1), min_size=1))), "u1")
    new = numbers.uniform(-2, 2, (len(rows), 3)).astype("f4")
    gltf.json["accessors"].append(
        {
            "componentType": 5126,
            "count": size,
            "type": "VEC3",
            "sparse": {
                "count": len(rows),
                "indices": {"bufferView": gltf.view(rows.tobytes()), "componentType": 5121},
                "values": {"bufferView": gltf.view(new.tobytes())},
            },
        }
    )
    return len(gltf.json["accessors"]) - 1


@st.composite
def clip_of(draw, gltf: Gltf, numbers: np.random.Generator, clip: int, targets: int) -> None:
    nodes = range(len(gltf.json["nodes"]))
    paths = [(node, path) for node in nodes for path in ("translation", "rotation", "scale")]
    paths += [(node, VISIBLE) for node in nodes]
    if targets:
        paths += [(n, "weights") for n in nodes if "mesh" in gltf.json["nodes"][n]]
        paths += [(f"/meshes/{m}", "weights") for m in range(len(gltf.json["meshes"]))]
    chosen = draw(st.lists(st.sampled_from(paths), min_size=3, max_size=8, unique=True))
    for target, path in chosen:
        keys = draw(st.integers(1, 4))
        times = np.cumsum(numbers.uniform(0.1, 2, keys)).astype("f4")
        kind = draw(st.sampled_from(["STEP", "LINEAR", "CUBICSPLINE"]))
        rows = keys * (3 if kind == "CUBICSPLINE" else 1)
        more: dict[str, Any] = {}
        if path == VISIBLE:
            kind, values = "STEP", numbers.integers(0, 2, keys).astype("u1")
        elif path == "rotation":
            values = quaternions(numbers, rows)
            if kind != "CUBICSPLINE" and draw(st.booleans()):
                short = values / np.linalg.norm(values, axis=1, keepdims=True)
                values = np.round(short * 32767).astype("i2")
                more = {"normalized": True}
        elif path == "weights":
            values = numbers.uniform(-1, 2, (rows * targets, 1)).astype("f4")
        else:
            values = numbers.uniform(-3, 3, (rows, 3)).astype("f4")
        pointed = isinstance(target, str) or path == VISIBLE or draw(st.booleans())
        where = f"/nodes/{target}" if pointed and isinstance(target, int) else target
        animate(gltf, where, path, times, values, kind, clip=clip, **more)


def is_ambiguous(gltf: Gltf) -> bool:
    """Whether a rotation turns by almost exactly half a turn, where the short way is a matter of
    the last bit, or a spline of rotations is near zero, where its direction is."""
    for animation in gltf.json["animations"]:
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            target = channel["target"]
            pointer = target.get("extensions", {}).get(POINTER, {}).get("pointer", "")
            if target["path"] != "rotation" and not pointer.endswith("rotation"):
                continue
            pose = Pose(gltf.json, [gltf.blob], None, 0.0)
            values = pose.accessor(sampler["output"])
            if sampler["interpolation"] == "CUBICSPLINE":
                keys = pose.accessor(sampler["input"])[:, 0]
                for time in np.linspace(float(keys[0]), float(keys[-1]), 50):
                    if np.linalg.norm(pose._sampled(sampler, "rotation", time)[0]) < 0.2:
                        return True
            elif (np.abs((values[1:] * values[:-1]).sum(axis=1)) < 1e-6).any():
                return True
    return False


# When, as a share of the time from a clip's first key to its last: before, between and after.
shares = st.one_of(st.floats(0.0, 1.0), st.sampled_from([-1e30, -0.1, 0.0, 1.0, 1.1, 1e30]))


def times_of(gltf: Gltf, clip: int, chosen: list[float]) -> list[float]:
    """These shares of a clip's time, in seconds."""
    pose = Pose(gltf.json, [gltf.blob], None, 0.0)
    samplers = gltf.json["animations"][clip]["samplers"]
    keys = np.concatenate([pose.accessor(sampler["input"])[:, 0] for sampler in samplers])
    first, last = float(keys.min()), float(keys.max())
    return [first + share * (last - first) for share in chosen]


many = settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@many
@given(rigs(), st.lists(shares, min_size=2, max_size=4))
def test_random_rigs_stand_where_the_specification_has_them(tmp_path, gltf, chosen):
    assume(not is_ambiguous(gltf))
    placed = read(gltf, tmp_path)
    assert_as_evaluated(placed, gltf.json, [gltf.blob], None, 0.0)
    for clip in range(len(gltf.json["animations"])):
        for time in times_of(gltf, clip, chosen):
            if placed.motion is not None:
                assert_as_evaluated(placed, gltf.json, [gltf.blob], clip, time)
                pose = Pose(gltf.json, [gltf.blob], clip, time)
                hidden = [
                    pose.hidden(node)
                    for node in placed_nodes(gltf.json)
                    for _ in pose._instances(node)
                ]
                assert placed.motion.at(clip, time).hidden.tolist() == hidden


@many
@given(rigs(), st.lists(shares, min_size=2, max_size=4))
def test_what_moves_hides_or_appears_is_among_the_affected(tmp_path, gltf, chosen):
    placed = read(gltf, tmp_path)
    rest = Pose(gltf.json, [gltf.blob], None, 0.0)
    for clip in range(len(gltf.json["animations"])):
        moved = np.zeros(len(placed.names), np.bool_)
        times = times_of(gltf, clip, chosen)
        for time in times:
            pose = Pose(gltf.json, [gltf.blob], clip, time)
            number = 0
            for node in placed_nodes(gltf.json):
                pairs = zip(pose.corners(node)[0], rest.corners(node)[0], strict=True)
                for now, before in pairs:
                    turned = pose.hidden(node) != rest.hidden(node)
                    moved[number] |= turned or not np.array_equal(now, before)
                    number += 1
        affected = np.zeros(len(placed.names), np.bool_)
        if placed.motion is not None:
            affected = placed.motion.affected(clip)
            assert placed.motion.at(clip, times[0]).objects.tolist() == (
                np.flatnonzero(affected).tolist()
            )
        assert not (moved & ~affected).any()


def test_a_door_turns_by_a_right_angle_about_its_hinge(tmp_path):
    gltf = Gltf()
    door = gltf.node(root=False, mesh=gltf.mesh(gltf.primitive(SQUARE, TWO)), name="door")
    hinge = gltf.node(children=[door], translation=[2, 0, 0])
    half = np.sqrt(0.5)
    animate(gltf, hinge, "rotation", [0, 1], [[0, 0, 0, 1.0], [0, half, 0, half]])
    placed = read(gltf, tmp_path)
    (row,) = placed.motion.at(0, 1.0).worlds
    # x goes to -z; float32 keys are off by 2^-25 of a right angle's half, a part in 10^8.
    assert np.allclose(row @ (1, 0, 0, 1), (2, 0, -1, 1), rtol=0, atol=1e-7)
    (row,) = placed.motion.at(0, 0.5).worlds
    assert np.allclose(row @ (1, 0, 0, 1), (2 + half, 0, -half, 1), rtol=0, atol=1e-7)
    assert placed.motion.affected(0).tolist() == [True]
    assert placed.motion.clips == ("animation",)


def test_a_cubic_spline_of_weights_has_its_known_values(tmp_path):
    gltf = Gltf()
    lift = np.tile(np.array([[0, 8, 0]], "f4"), (3, 1))
    mesh = gltf.mesh(
        gltf.primitive(
            TRIANGLE, np.arange(3, dtype="u2"), targets=[{"POSITION": gltf.accessor(lift)}]
        )
    )
    node = gltf.node(mesh=mesh)
    # From 0 to 1 with slopes 4 and 0 over 2 s: w(1/2) of a Hermite spline is 1/2 + 2 * 4 / 8.
    animate(gltf, node, "weights", [0, 2], [0.0, 0, 4, 0, 1, 0], "CUBICSPLINE")
    placed = read(gltf, tmp_path)
    at = placed.motion.at(0, 1.0).positions[0]
    assert np.array_equal(at, TRIANGLE + np.array([0, 8 * 1.5, 0]))
    assert np.array_equal(placed.motion.at(0, -5.0).positions[0], TRIANGLE)
    after = TRIANGLE + np.array([0, 8, 0])
    assert np.array_equal(placed.motion.at(0, 99.0).positions[0], after)


def test_one_key_holds_at_all_times(tmp_path):
    gltf = one_triangle()
    animate(gltf, 0, "translation", [3], [[1.0, 2, 3]])
    motion = read(gltf, tmp_path).motion
    for time in (-1.0, 0.0, 3.0, 1e9):
        assert motion.at(0, time).worlds[0, :3, 3].tolist() == [1, 2, 3]
