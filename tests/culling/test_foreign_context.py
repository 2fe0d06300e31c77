"""A culler of somebody else's with a GL context of its own, in the same process."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from tests.support.culling_scenes import random_camera, random_scene
from visref.camera_path import CameraPath
from visref.culler import Culler, DrawnSet
from visref.engines import make_engine
from visref.judging.referee import Referee
from visref.judging.status import Status
from visref.registry import make_culler
from visref_culling.gl.device import device


class DrawsByItself(Culler):
    """Opens a context when it is asked to, and never says that it is current again: it has seen no
    other. Draws everything."""

    name = "draws-by-itself"

    def __init__(self, opens_in: str) -> None:
        self.opens_in = opens_in
        self.seen: list[int] = []
        self._open("constructor")

    def _open(self, step: str) -> None:
        if step == self.opens_in:
            self.context = moderngl.create_context(standalone=True, backend="egl", require=330)
            self.framebuffer = self.context.simple_framebuffer((4, 4))
            self.framebuffer.use()

    def prepare(self, scene):
        self._open("prepare")
        self.count = scene.object_count
        return scene.object_units()

    def cull(self, camera):
        self._open("cull")
        self.context.clear(1.0, 0.0, 0.0)
        self.seen.append(self.framebuffer.read()[0])
        self.context.disable(moderngl.DEPTH_TEST)
        return DrawnSet(np.arange(self.count, dtype=np.int32))

    def close(self):
        self.framebuffer.release()
        self.context.release()


@pytest.mark.parametrize("opens_in", ["constructor", "prepare", "cull"])
@pytest.mark.parametrize("engine", ["exact", "gl"])
def test_neither_disturbs_the_other(opens_in, engine):
    rng = np.random.default_rng(8)
    scene = random_scene(rng)
    frame = random_camera(rng, 48, 36)
    path = CameraPath((frame, frame))
    ours = ("occlusion-query", "occupancy-map", "n-buffer", "lazy-grid", "plp")

    def drawn(cullers):
        referee = Referee(scene, lambda: make_engine(engine, scene))
        outcome = referee.run(path, range(2), cullers)
        return [
            (record.spec, record.status, vars(record.totals))
            for record in outcome.cullers
            if record.spec in ours
        ]

    alone = drawn([(spec, make_culler(spec)) for spec in ours])
    foreign = DrawsByItself(opens_in)
    beside = drawn([("foreign", foreign), *((spec, make_culler(spec)) for spec in ours)])
    assert beside == alone
    assert foreign.seen == [255, 255]
    if engine == "exact":
        assert all(status is not Status.VIOLATION for _, status, _ in alone)


def test_after_a_call_the_context_that_was_current_is_so_again():
    first = device()
    theirs = moderngl.create_context(standalone=True, backend="egl", require=330)
    with first.current():
        target = first.target(8, 8)
        first.context.clear(0.0, 0.0, 0.0)
        assert target.framebuffer.glo
    texture = theirs.texture((1, 1), 4, b"\x07\x08\x09\x0a")
    assert texture.read() == b"\x07\x08\x09\x0a"
    theirs.release()
    # Theirs is gone; ours goes on.
    with first.current():
        assert first.report()["renderer"]
