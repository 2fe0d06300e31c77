"""The exact engine equals a brute force in integers, in every sample and every tie."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.exact_brute import Sample, truth
from tests.support.exact_scenes import HALF, pose, random_case
from tests.support.shares import examples, share
from visref.camera import Camera
from visref.exact import ExactScene
from visref.scene import Alpha, Scene
from visref.visibility import FrameTruth

pytestmark = pytest.mark.slow

CHUNKS, FRAMES = 10, 200


def assert_equal(
    scene: Scene, camera: Camera, frame: FrameTruth, expectation: list[Sample]
) -> Counter[str]:
    """Raise where the frame differs from the brute force; count what it met."""
    seen: Counter[str] = Counter()
    triangle, depth = frame.buffer.triangle.reshape(-1), frame.buffer.depth.reshape(-1)
    doubt, doubted = frame.doubt.at(), 0
    for at, sample in enumerate(expectation):
        own = [int(triangle[at])] if triangle[at] >= 0 else []
        further = frame.ties.triangle[frame.ties.sample == at]
        assert own + further.tolist() == sample.tied, f"owners of sample {at}"
        # The quotient of two integers is correctly rounded.
        nearest = sample.nearest
        expected = math.inf if nearest is None else nearest.numerator / nearest.denominator
        assert depth[at] == expected, f"depth of sample {at}"
        # Front to back by rounded depths: of two that round alike the lesser id comes first.
        order = sorted((t.numerator / t.denominator, i) for t, i in sample.doubt)
        found = frame.doubt.triangle[doubt == at].tolist()
        assert found == [i for _, i in order], f"doubt at sample {at}"
        doubted += len(sample.doubt) > 0
        seen["owned"] += len(sample.tied) > 0
        seen["tied"] += len(sample.tied) > 1
        seen["undecided"] += len(sample.doubt) > 0
        seen["doubted twice"] += len(sample.doubt) > 1
        seen["solid"] += any(scene.alpha[i] == Alpha.MASK for i in sample.tied)
        seen["blended"] += len(sample.blend) > 0
    assert len(frame.doubt) == doubted
    expected_blend = [
        (o, s, i)
        for s, sample in enumerate(expectation)
        for o, triangles in sample.blend.items()
        for i in triangles
    ]
    blend = frame.blend
    hits = list(
        zip(blend.object.tolist(), blend.sample.tolist(), blend.triangle.tolist(), strict=True)
    )
    assert sorted(hits) == sorted(expected_blend), "blended hits"
    order = np.lexsort((blend.triangle, blend.depth, blend.sample, blend.object))
    assert order.tolist() == list(range(len(order))), "the order of blended hits"
    assert (blend.depth <= depth[blend.sample]).all()
    return seen


@pytest.mark.parametrize("chunk", share(range(CHUNKS), 0))
def test_random_close_calls_equal_the_brute_force(chunk: int) -> None:
    seen: Counter[str] = Counter()
    for index in range(FRAMES):
        scene, camera = random_case(chunk, index)
        frame = ExactScene(scene, threads=1).certify(camera)
        try:
            seen += assert_equal(scene, camera, frame, truth(scene, camera))
        except AssertionError as error:
            raise AssertionError(f"random_case({chunk}, {index}): {error}") from error
    # The scenes must be worth the name.
    assert seen["owned"] > 5 * FRAMES
    assert min(seen[kind] for kind in ("tied", "undecided", "blended")) > FRAMES / 10
    assert seen["doubted twice"] > 0


whole = st.integers(-3, 3)
triangles = st.lists(
    st.tuples(*[st.tuples(whole, whole, st.integers(-4, 1))] * 3), min_size=1, max_size=6
)


@settings(max_examples=examples(150), deadline=None, derandomize=True)
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
    frame = ExactScene(scene, threads=1).certify(camera)
    assert_equal(scene, camera, frame, truth(scene, camera))


def test_the_comparison_itself_can_fail() -> None:
    scene, camera = next(
        (s, c)
        for s, c in (random_case(0, i) for i in range(100))
        if len(ExactScene(s, threads=1).certify(c).ties.sample)
    )
    frame = ExactScene(scene, threads=1).certify(camera).copy()
    frame.ties.triangle[0] += 1
    with pytest.raises(AssertionError, match="owners"):
        assert_equal(scene, camera, frame, truth(scene, camera))
