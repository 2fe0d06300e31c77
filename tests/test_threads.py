"""One thread count, for rays and for exact arithmetic."""

import os

import pytest

from visref.engines.embree import EmbreeEngine
from visref.exact import ExactScene
from visref.scene import Scene
from visref.threads import available_threads


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system pins no threads")
def test_rays_and_exact_arithmetic_take_the_threads_that_the_process_may_use():
    everywhere = os.sched_getaffinity(0)
    scene = Scene.from_objects([("one", [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])])
    try:
        for count in {1, len(everywhere)}:
            os.sched_setaffinity(0, sorted(everywhere)[:count])
            assert available_threads() == count
            assert EmbreeEngine(scene)._workers == count
            assert ExactScene(scene)._threads == count
    finally:
        os.sched_setaffinity(0, everywhere)
