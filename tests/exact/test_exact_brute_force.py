"""The exact engine equals a brute force in integers, in every sample and every tie."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.exact_brute import truth
from tests.support.exact_scenes import HALF, pose, random_case
from visref.camera import Camera
from visref.exact import ExactScene
from visref.scene import Scene
from visref.visibility import FrameTruth

pytestmark = pytest.mark.slow

CHUNKS, FRAMES = 10, 200


def assert_equal(scene: Scene, camera: Camera, frame: FrameTruth) -> Counter[str]:
    """Raise where the frame differs from the brute force; count what it met."""
    seen: Counter[str] = Counter()
    triangle, depth = frame.buffer.triangle.reshape(-1), frame.buffer.depth.reshape(-1)
    blended: Counter[int] = Counter()
    expectation = truth(scene, camera)
    for sample, (nearest, tied, undecided, blend) in enumerate(expectation):
        own = [int(triangle[sample])] if triangle[sample] >= 0 else []
        further = frame.ties.triangle[frame.ties.sample == sample]
        assert own + further.tolist() == tied, f"owners of sample {sample}"
        # The quotient of two integers is correctly rounded.
        expected = math.inf if nearest is None else nearest.numerator / nearest.denominator
        assert depth[sample] == expected, f"depth of sample {sample}"
        assert (sample in frame.undecided) == undecided, f"alpha mask at sample {sample}"
        blended.update(list(blend))
        seen["owned"] += len(tied) > 0
        seen["tied"] += len(tied) > 1
        seen["undecided"] += undecided
    assert (
        dict(zip(frame.blend.object.tolist(), frame.blend.pixels.tolist(), strict=True)) == blended
    )
    for o, s, t, z in zip(
        frame.blend.object, frame.blend.sample, frame.blend.triangle, frame.blend.depth, strict=True
    ):
        assert t in expectation[s][3][o]
        assert z < depth[s]
    seen["blended"] += len(blended)
    return seen


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_random_close_calls_equal_the_brute_force(chunk: int) -> None:
    seen: Counter[str] = Counter()
    for index in range(FRAMES):
        scene, camera = random_case(chunk, index)
        frame = ExactScene(scene, threads=1).certify(camera)
        try:
            seen += assert_equal(scene, camera, frame)
        except AssertionError as error:
            raise AssertionError(f"random_case({chunk}, {index}): {error}") from error
    # The scenes must be worth the name.
    assert seen["owned"] > 5 * FRAMES
    assert min(seen["tied"], seen["undecided"], seen["blended"]) > FRAMES / 10


whole = st.integers(-3, 3)
triangles = st.lists(
    st.tuples(*[st.tuples(whole, whole, st.integers(-4, 1))] * 3), min_size=1, max_size=6
)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(triangles, st.booleans(), st.sampled_from([0.5, 1.0, 2.0]))
def test_small_whole_coordinates_equal_the_brute_force(
    soup: list[tuple[tuple[int, int, int], ...]], perspective: bool, near: float
) -> None:
    count = len(soup)
    scene = Scene.from_objects(
        [("soup", np.array(soup, float).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))]
    )
    projection = {"yfov": HALF} if perspective else {"ymag": 4.0}
    camera = Camera(pose(np.eye(3), np.zeros(3)), 4, 4, near, 4.0, **projection)
    assert_equal(scene, camera, ExactScene(scene, threads=1).certify(camera))


def test_the_comparison_itself_can_fail() -> None:
    scene, camera = next(
        (s, c)
        for s, c in (random_case(0, i) for i in range(100))
        if len(ExactScene(s, threads=1).certify(c).ties.sample)
    )
    frame = ExactScene(scene, threads=1).certify(camera).copy()
    frame.ties.triangle[0] += 1
    with pytest.raises(AssertionError, match="owners"):
        assert_equal(scene, camera, frame)
