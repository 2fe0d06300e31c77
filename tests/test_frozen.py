"""What plug-ins are handed cannot be changed for the judge: arrays stay read-only whatever one
tries, over pickling too, and records and cameras are the plug-in's own."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass, replace
from typing import Any

import numpy as np
import pytest

from tests.masks.test_store import some_masks
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.culler import Culler, DrawnSet
from visref.engines import make_engine
from visref.frozen import frozen, is_frozen
from visref.judging.outcome import verdict_json
from visref.judging.referee import Referee
from visref.scene import Group, Scene, Units

QUAD = np.array([[0, 1, 2], [0, 2, 3]])
FRONT, TOWER, FAR = range(3)


def upright(low: float, high: float, z: float):
    return np.array([[low, -1, z], [high, -1, z], [high, 1, z], [low, 1, z]]), QUAD


def plain_scene() -> Scene:
    return Scene.from_objects(
        [("front", *upright(-2.0, -1.0, -4.0)), ("tower", *upright(0.0, 1.0, -5.0)),
         ("far", *upright(-9.0, 9.0, -9.0))]
    )  # fmt: skip


def rich_scene() -> Scene:
    """With everything that a scene may have."""
    scene = plain_scene()
    masks = some_masks(row=[-1, 0, 1, -1, 2, 0])
    return replace(
        scene,
        masks=masks,
        moved=np.full(len(scene.vertices), 1e-3, np.float32),
        origin=np.array([1.0, 2.0, 3.0]),
        groups=(Group("g", "g", (0, 1)),),
    )


def a_camera(**more: Any) -> Camera:
    size = {"yfov": 1.0} | more
    return Camera(look_at((0.0, 0.0, 0.0), (0.0, 0.0, -1.0)), 32, 24, 0.1, 100.0, **size)


def units() -> Units:
    return Units(np.array([0, 1, 3]), np.array([0, 1, 1], np.int32), "part").owned()


RECORDS = {
    "scene": rich_scene,
    "empty scene": lambda: Scene.from_objects([]),
    "masks": some_masks,
    "camera": a_camera,
    "orthographic camera": lambda: a_camera(yfov=None, ymag=2.0),
    "units": units,
    "a scene's units": lambda: plain_scene().object_units(),
}


def reachable(
    value: Any, at: str = "", above: frozenset[int] = frozenset()
) -> Iterator[tuple[str, Any]]:
    """Every array and mapping that attributes lead to, computed ones too."""
    if id(value) in above:
        return
    above |= {id(value)}
    if isinstance(value, (np.ndarray, Mapping)):
        yield at, value
    elif isinstance(value, tuple):
        for index, part in enumerate(value):
            yield from reachable(part, f"{at}[{index}]", above)
    elif is_dataclass(value) and type(value).__module__.startswith("visref."):
        for name in dir(value):
            part = getattr(value, name)
            if not name.startswith("__") and not callable(part):
                yield from reachable(part, f"{at}.{name}", above)


def make_writable(array: np.ndarray) -> None:
    """Everything that numpy offers for it."""
    for view in (array, array[...], array.view(np.ndarray), array.T, np.asarray(array)):
        base: Any = view
        while isinstance(base, np.ndarray):
            with pytest.raises(ValueError, match="WRITEABLE"):
                base.flags.writeable = True
            with pytest.raises(ValueError, match="WRITEABLE"):
                base.setflags(write=True)
            base = base.base
        with pytest.raises(TypeError):
            memoryview(base).cast("B")[:1] = b"x"
    assert not np.frombuffer(base, np.uint8).flags.writeable if len(bytes(base)) else True


def check(record: Any) -> list[str]:
    names = []
    for at, value in reachable(record):
        names.append(at)
        if isinstance(value, np.ndarray):
            assert not value.flags.writeable, at
            make_writable(value)
        else:
            assert not hasattr(value, "clear"), at
            with pytest.raises(TypeError):
                value["new"] = 1  # type: ignore[index]
    return names


@pytest.mark.parametrize("make", RECORDS.values(), ids=RECORDS)
def test_no_array_that_a_record_leads_to_is_writable_or_can_be_made_so(make):
    names = check(make())
    if make is rich_scene:
        assert {
            ".object_bounds", ".object_of_triangle", ".bounds", ".core_bounds", ".id_of_name",
            ".vertices", ".moved", ".origin", ".masks.row", ".masks.arrays[4]",
        } <= set(names)  # fmt: skip
    if make is a_camera:
        assert {".eye", ".forward", ".right_step", ".up_step", ".column_a", ".row_b",
                ".camera_from_world", ".world_from_camera"} <= set(names)  # fmt: skip


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
@pytest.mark.parametrize("make", RECORDS.values(), ids=RECORDS)
def test_what_was_pickled_is_equal_and_frozen_again(make, protocol):
    record = make()
    before = dict(reachable(record))
    again = pickle.loads(pickle.dumps(record, protocol))
    check(again)
    after = dict(reachable(again))
    assert before.keys() == after.keys()
    for at, value in before.items():
        assert (
            np.array_equal(value, after[at])
            if isinstance(value, np.ndarray)
            else (dict(value) == dict(after[at]))
        ), at


def test_a_scene_in_read_only_shared_memory_is_not_copied():
    scene = rich_scene()
    buffers: list[pickle.PickleBuffer] = []
    data = pickle.dumps(scene, protocol=5, buffer_callback=buffers.append)
    stored = [bytearray(buffer.raw()) for buffer in buffers]
    again = pickle.loads(data, buffers=[memoryview(part).toreadonly() for part in stored])
    memory = [np.frombuffer(part, np.uint8) for part in stored if part]
    for name in ("vertices", "triangles", "object_offsets", "one_sided", "alpha", "moved"):
        array = getattr(again, name)
        assert not array.flags.writeable
        assert any(np.may_share_memory(array, part) for part in memory), name
        assert is_frozen(array)
    assert any(np.may_share_memory(again.masks.row, part) for part in memory)
    assert again.digest == scene.digest


def test_what_is_frozen_is_not_copied_again_and_what_is_not_is():
    array = np.arange(6.0).reshape(2, 3)
    once = frozen(array)
    assert frozen(once) is once
    assert not np.may_share_memory(once, array)
    array[:] = 0.0
    assert once.tolist() == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]
    flagged = np.arange(3)
    flagged.flags.writeable = False
    assert not is_frozen(flagged)
    assert not is_frozen(flagged[1:])
    assert is_frozen(frozen(flagged)[1:])
    with pytest.raises(TypeError):
        frozen(np.array([object()]))


@pytest.mark.parametrize("make", [rich_scene, a_camera, units, some_masks])
def test_what_is_done_to_a_record_that_was_handed_out_stays_there(make):
    record = make()
    own = record.handed_out()
    kept = {name: getattr(record, name) for name in vars(record)}
    for name in list(vars(own)):
        object.__setattr__(own, name, None)
    assert all(getattr(record, name) is value for name, value in kept.items())
    assert check(record)


def test_masks_of_a_scene_that_was_handed_out_are_its_own():
    scene = rich_scene()
    object.__setattr__(scene.handed_out().masks, "row", None)
    assert scene.masks is not None
    assert scene.masks.row is not None


def test_a_scene_is_handed_out_without_a_copy_of_its_arrays_and_a_camera_with_one():
    scene, camera = rich_scene(), a_camera()
    assert scene.handed_out().vertices is scene.vertices
    eye = camera.handed_out().eye
    eye += 5.0
    assert camera.eye.tolist() == [0.0, 0.0, 0.0]
    for again in (copy.copy(camera.handed_out()), pickle.loads(pickle.dumps(camera.handed_out()))):
        again.row_b[:] = 0.0


def test_units_are_kept_apart_from_those_that_a_plug_in_holds():
    given = Units(np.array([0, 2, 4, 6]), np.arange(6, dtype=np.int32))
    kept = given.owned()
    given.triangles[:] = 99
    assert kept.triangles.tolist() == list(range(6))
    with pytest.raises(TypeError):
        Units([0, 1], [0]).owned()  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        Units(np.array([0, 2]), np.zeros((2, 2), np.int32)).owned()


class Writes(Culler):
    """Draws everything but `without`, and writes to what it is handed in the step of that name."""

    name = "writes"

    def __init__(self, step: str = "", write: Any = None, without: int | None = None) -> None:
        self.step, self.write, self.without = step, write, without

    def prepare(self, scene):
        self.scene = scene
        if self.step == "prepare":
            self.write(scene)
        self.units = Units(scene.object_offsets.copy(), np.arange(6, dtype=np.int32))
        return self.units

    def cull(self, camera):
        if self.step == "cull":
            self.write(camera)
        if self.step == "later":
            self.write(self)
        return DrawnSet(np.setdiff1d(range(3), [self.without]).astype(np.int32))


def eye_in_place(camera):
    eye = camera.eye
    eye -= np.array([0.0, 0.0, 1000.0])


def forward_in_place(camera):
    forward = camera.forward
    forward *= -1.0


def columns(camera):
    camera.column_a[:] += 5000.0
    camera.row_b[:] = 0.0


def pose(camera):
    camera.world_from_camera.flags.writeable = True
    camera.world_from_camera[2, 3] = -50.0


def far(camera):
    object.__setattr__(camera, "far", 0.2)
    object.__setattr__(camera, "width", 1)


def names(culler):
    object.__setattr__(culler.scene, "id_of_name", {})
    object.__setattr__(culler.scene, "names", ("a", "b", "c"))
    object.__setattr__(culler.scene, "vertices", np.zeros((12, 3), np.float32))


def own_units(culler):
    culler.units.triangles[:] = 10**6
    object.__setattr__(culler.units, "offsets", None)


OWN = {  # to what is the plug-in's own: of no effect on anybody
    "eye": ("cull", eye_in_place), "forward": ("cull", forward_in_place),
    "columns": ("cull", columns), "pose": ("cull", pose), "far": ("cull", far),
    "names": ("later", names),
    "units": ("later", own_units),
}  # fmt: skip


def bounds(scene):
    scene.object_bounds[:] -= 50.0


def ids(scene):
    scene.object_of_triangle[:] = 0


def vertices(scene):
    scene.vertices.flags.writeable = True
    scene.vertices[:] += 500.0


SHARED = {  # to what is shared: refused
    "bounds": ("prepare", bounds), "ids": ("prepare", ids), "vertices": ("prepare", vertices),
    "clear": ("later", lambda culler: culler.scene.id_of_name.clear()),
    "late bounds": ("later", lambda culler: bounds(culler.scene)),
}  # fmt: skip


def verdicts(engine: str, *cullers: Culler) -> list[Any]:
    scene = plain_scene()
    path = CameraPath((a_camera(), a_camera()))
    referee = Referee(scene, lambda: make_engine(engine, scene))
    outcome = referee.run(path, [0, 1], [(c.name, c) for c in cullers])
    cullers_said = verdict_json(outcome, scene)["cullers"]
    return list(cullers_said.values())  # type: ignore[attr-defined]


@pytest.mark.parametrize("engine", ["exact", "embree"])
@pytest.mark.parametrize("without", [None, TOWER])
@pytest.mark.parametrize("what", OWN)
def test_a_write_to_what_is_its_own_changes_no_verdict(what, without, engine):
    right = verdicts(engine, Writes(without=without), Writes(without=TOWER))
    assert right[1]["confirmed"] == 2
    assert verdicts(engine, Writes(*OWN[what], without), Writes(without=TOWER)) == right
    assert verdicts(engine, Writes(without=TOWER), Writes(*OWN[what], without)) == right[::-1]
    assert verdicts(engine, Writes(*OWN[what], without)) == right[:1]


@pytest.mark.parametrize("without", [None, TOWER])
@pytest.mark.parametrize("what", SHARED)
def test_a_write_to_what_is_shared_fails_and_changes_no_other_verdict(what, without):
    (right,) = verdicts("exact", Writes(without=TOWER))
    for order in (1, -1):
        writer = Writes(*SHARED[what], without)
        failed, other = verdicts("exact", *[writer, Writes(without=TOWER)][::order])[::order]
        assert failed["status"] == "inconclusive"
        assert other == right


def test_what_a_plug_in_leaves_changed_in_the_process_is_put_back(tmp_path):
    import gc
    import os
    import sys
    import warnings

    def state():
        return (np.geterr(), list(warnings.filters), os.getcwd(), sys.getrecursionlimit(),
                gc.isenabled())  # fmt: skip

    def change(_):
        np.seterr(all="raise")
        warnings.simplefilter("error")
        os.chdir(tmp_path)
        sys.setrecursionlimit(sys.getrecursionlimit() + 50)
        gc.disable()

    before = state()
    for step in ("prepare", "cull"):
        assert verdicts("exact", Writes(step, change))[0]["status"] == "no_violation_found"
        assert state() == before
