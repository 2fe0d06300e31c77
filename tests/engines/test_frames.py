"""Several views asked for at once: what each engine says of them, and in whose arrays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.truth_scenes import random_soup
from visref.camera import Camera, look_at
from visref.engines import make_engine
from visref.engines.embree import EmbreeEngine
from visref.engines.lending import Lender
from visref.visibility import FrameTruth, VisibilityBuffer

SCENE = random_soup(3, triangles=300)


def cameras() -> list[Camera]:
    """Of two sizes, one with a clip plane: not all can be cast in one call."""
    rng = np.random.default_rng(4)
    found = [
        Camera(look_at(*rng.uniform(-1.0, 1.0, (2, 3))), 40, 30, 0.01, 50.0, yfov=1.2)
        for _ in range(6)
    ]
    found[2:4] = [replace(camera, width=21, height=17) for camera in found[2:4]]
    found[5] = replace(found[5], clip_plane=(1.0, 0.0, 0.0, 0.0))
    return found


def engine_of(name: str):
    if name == "open3d":
        pytest.importorskip("open3d")
    return make_engine(name, SCENE)


@pytest.mark.parametrize("name", ["embree", "embree:robust=off", "open3d", "exact"])
def test_frames_together_are_frames_one_by_one(name: str) -> None:
    engine = engine_of(name)
    together = engine.frames(cameras())
    for camera, truth in zip(cameras(), together, strict=True):
        alone = engine.frame(camera)
        assert truth.camera.width == camera.width
        assert np.array_equal(truth.buffer.triangle, alone.buffer.triangle)
        assert np.array_equal(truth.buffer.depth, alone.buffer.depth)
    assert len({truth.buffer.triangle.tobytes() for truth in together}) == len(together)
    engine.close()


class Mirrored(EmbreeEngine):
    """A subclass with a way of its own to cast a frame."""

    def frame(self, camera: Camera) -> FrameTruth:
        truth = super().frame(camera)
        triangle = np.ascontiguousarray(truth.buffer.triangle[:, ::-1])
        return replace(truth, buffer=VisibilityBuffer(triangle, np.zeros(triangle.shape)))


def test_an_engine_that_says_how_a_frame_is_cast_is_asked_for_each() -> None:
    plain, mirrored = EmbreeEngine(SCENE).frames(cameras()), Mirrored(SCENE).frames(cameras())
    for one, other in zip(plain, mirrored, strict=True):
        assert np.array_equal(other.buffer.triangle, one.buffer.triangle[:, ::-1])


def test_no_views_are_none() -> None:
    assert make_engine("embree", SCENE).frames([]) == []


def test_what_is_lent_is_its_holders_alone() -> None:
    lender = Lender()
    held = [lender.lend(1000) for _ in range(3)]
    for number, array in enumerate(held):
        array[:] = number
    # A view of a view is enough to hold it.
    rows = held.pop(1).reshape(10, 100)[2:, 5:]
    held += [lender.lend(900), lender.lend(1000)]
    for array in held[2:]:
        array[:] = 7
    assert [int(array[0]) for array in held] == [0, 2, 7, 7]
    assert (rows == 1).all()


def test_what_nobody_holds_is_lent_again() -> None:
    lender = Lender()
    first = lender.lend(1000)
    where = first.ctypes.data
    view = first[::2]
    del first
    assert lender.lend(1000).ctypes.data != where
    del view
    taken = [lender.lend(size, kind) for size, kind in ((1000, np.int32), (500, np.float64))]
    assert where in {array.ctypes.data for array in taken}
    assert taken[1].dtype == np.float64
    # What is far larger is not given away for something small.
    del taken
    assert where != lender.lend(10).ctypes.data
    assert sorted(lender.unused) == [64, 4096, 4096]


@pytest.mark.parametrize("size", [0, 1, 2, 3, 1023, 1024, 1025])
def test_arrays_of_any_size_are_lent(size: int) -> None:
    array = Lender().lend(size, np.int64)
    array[:] = np.arange(size)
    assert array.shape == (size,)
    assert array.tolist() == list(range(size))
