"""Readers in a process of their own: limits hold, and an answer is a scene or nothing."""

from __future__ import annotations

import io
import json
import os
import signal
import socket
import subprocess
import time

import numpy as np
import pytest

import visref.formats.in_a_child as in_a_child
from visref.errors import InputError
from visref.formats import Mesh, Placed
from visref.formats.in_a_child import _Answer, _NoAnswer, _write, read_in_a_child
from visref.formats.keyed_motion import KeyedMotion, Node
from visref.formats.keyed_ops import Keys, Op
from visref.memory import Budget

MEMORY = 512 << 20


def good(path=None, budget=None):
    placed = Placed(meshes=[Mesh.plain(np.eye(3, dtype="f4"), np.array([[0, 1, 2]]))])
    placed.add("a", 0, np.tile(np.eye(4), (2, 1, 1)), group=True)
    placed.add("b", -1, np.eye(4))
    return placed


def moving():
    """`good`, its first object moved and its mesh deformed in time, its last hidden."""
    placed = good()
    placed.hidden[2] = True
    times, places = np.array([0.0, 1.0]), np.array([[0.0, 0, 0], [1, 2, 3]])
    ops = (Op("translate", places[0], Keys(times, places)), Op("rotateX", np.array([30.0])))
    shown = Keys(times, np.array([1.0, 0.0]))
    nodes = [Node(-1, ops), Node(0, (), False, shown), Node(-1, shown_at_rest=False)]
    points = Keys(times, np.stack([np.eye(3), 2.0 * np.eye(3)]))
    placed.motion = KeyedMotion(
        np.eye(4), nodes, np.array([1, 0, 2]), {1: np.diag([2.0, 2, 2, 1])}, {0: points},
        np.array(placed.mesh_of_object),
    )  # fmt: skip
    return placed


def greedy(path, budget):
    return np.ones(1 << 30)


def endless(path, budget):
    while True:
        pass


def killed(path, budget):
    os.kill(os.getpid(), signal.SIGKILL)


def leaves(path, budget):
    os._exit(0)


def calls_out(path, budget):
    socket.create_connection(("127.0.0.1", 9))


def starts_a_program(path, budget):
    subprocess.run(["true"], check=True)


def writes(path, budget):
    path.with_suffix(".new").write_text("x")


def refuses(path, budget):
    raise InputError("not to my taste", place="line 3", fix="write another")


@pytest.fixture
def file(tmp_path):
    (tmp_path / "a.x").write_text("x")
    return tmp_path / "a.x"


def read(reader, file):
    name = f"{__name__}:{reader.__name__}"
    return read_in_a_child(name, file, Budget(MEMORY, given=True))


def test_answer_is_what_the_reader_made(file):
    placed, expected = read(good, file), good()
    assert (placed.names, placed.paths, placed.groups) == (
        expected.names,
        expected.paths,
        expected.groups,
    )
    assert placed.mesh_of_object == expected.mesh_of_object
    assert np.array_equal(placed.meshes[0].positions, np.eye(3))
    assert placed.meshes[0].positions.dtype == np.float32
    assert np.concatenate(placed.world_from_object).shape == (3, 4, 4)


@pytest.mark.parametrize(
    ("reader", "match"),
    [
        (greedy, "takes more than 256 MiB, half of the limit; give more with --max-memory"),
        (killed, "its reader's process ended by SIGKILL"),
        (leaves, "its reader's answer is none"),
        (refuses, "line 3: not to my taste; write another"),
        (calls_out, "its reader's process ended with status 1"),
        (starts_a_program, "its reader's process ended with status 1"),
        (writes, "its reader's process ended with status 1"),
    ],
)
def test_child_that_fails_or_does_what_it_may_not_is_one_line(file, reader, match):
    with pytest.raises(InputError, match=match) as caught:
        read(reader, file)
    assert "\n" not in str(caught.value)
    new = file.with_suffix(".new")
    assert not new.exists() or not new.read_text()


def test_child_that_never_ends_is_ended(file, monkeypatch):
    monkeypatch.setattr(in_a_child, "_SECONDS", 1)
    start = time.monotonic()
    with pytest.raises(InputError, match="reading it took more than 1 s"):
        read(endless, file)
    assert time.monotonic() - start < 60


def answer_of(placed, change):
    """A child's answer with its header changed."""
    out = io.BytesIO()
    _write(out, placed)
    data = out.getvalue()
    length = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + length])
    change(header)
    text = json.dumps(header).encode()
    return io.BytesIO(len(text).to_bytes(8, "little") + text + data[8 + length :])


@pytest.mark.parametrize(
    "change",
    [
        lambda h: h["meshes"][0].update(kind="|O"),
        lambda h: h["meshes"][0].update(vertices=-1),
        lambda h: h["meshes"][0].update(vertices=2),
        lambda h: h["meshes"][0].update(triangles=1e9),
        lambda h: h["meshes"][0].update(triangles=10**9),
        lambda h: h["meshes"].append(3),
        lambda h: h.pop("names"),
        lambda h: h.update(names=[1, 2, 3]),
        lambda h: h.update(paths=["a"]),
        lambda h: h.update(groups=[["g", "g", 0, 10**12]]),
        lambda h: h.update(notes=[["X999", "?"]]),
        lambda h: h.update(error=3),
        lambda h: h.update(meshes=[]),
    ],
)
def test_forged_answers_are_refused(change):
    with pytest.raises((_NoAnswer, InputError)):
        _Answer(answer_of(good(), change), Budget(MEMORY, given=True)).placed()


def believed(placed, change=lambda _: None):
    return _Answer(answer_of(placed, change), Budget(MEMORY, given=True)).placed()


def test_a_motion_is_the_one_that_was_handed_over():
    here, there = moving(), believed(moving())
    assert there.hidden == [False, False, True]
    assert there.motion.digest == here.motion.digest
    for time_s in (-1.0, 0.25, 2.0):
        a, b = here.motion.at(0, time_s), there.motion.at(0, time_s)
        assert a.objects.tolist() == b.objects.tolist() == [0, 1]
        assert np.array_equal(a.worlds, b.worlds)
        assert np.array_equal(a.positions[0], b.positions[0])
        assert a.hidden.tolist() == b.hidden.tolist()


@pytest.mark.parametrize(
    "change",
    [
        lambda m: m["nodes"][0].__setitem__(0, 0),
        lambda m: m["nodes"][0].__setitem__(0, -2),
        lambda m: m["nodes"][1].__setitem__(0, 1),
        lambda m: m["nodes"].pop(),
        lambda m: m["nodes"][0][4][0].__setitem__(0, "shear"),
        lambda m: m["nodes"][0][4][0].__setitem__(2, 10**10),
        lambda m: m["nodes"][0][4][0].__setitem__(2, -1),
        lambda m: m["nodes"][0][4][0].__setitem__(2, 3),
        lambda m: m.update(instances=[7]),
        lambda m: m.update(instances=[-1]),
        lambda m: m["points"][0].__setitem__(0, 4),
        lambda m: m["points"][0].__setitem__(2, 2),
        lambda m: m["points"].append(3),
        lambda m: m.pop("points"),
    ],
)
def test_forged_motions_are_refused(change):
    with pytest.raises((_NoAnswer, InputError)):
        believed(moving(), lambda header: change(header["motion"]))


def test_unchanged_answer_is_believed():
    placed = _Answer(answer_of(good(), lambda _: None), Budget(MEMORY, given=True)).placed()
    assert placed.names == ["a", "a", "b"]
