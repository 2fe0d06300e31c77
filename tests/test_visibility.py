"""Gathering a frame by object, against a slow brute force over Python sets."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from visref.camera import Camera
from visref.scene import Scene
from visref.visibility import (
    BACKGROUND,
    NO_SAMPLE,
    BlendVisibility,
    Doubt,
    FrameTruth,
    ObjectVisibility,
    Ties,
    VisibilityBuffer,
    objects_seen,
)

OBJECT_SIZES = (2, 0, 1, 3, 2, 1)


def soup() -> Scene:
    """Objects of OBJECT_SIZES triangles each; where they lie does not matter here."""
    triangle = [[0, 0, -1], [1, 0, -1], [0, 1, -1]]
    return Scene.from_objects(
        [("object", triangle * size, np.arange(3 * size).reshape(-1, 3)) for size in OBJECT_SIZES]
    )


SCENE = soup()


def random_truth(seed: int) -> FrameTruth:
    rng = np.random.default_rng(seed)
    width, height = (int(x) for x in rng.integers(1, 9, 2))
    camera = Camera(np.eye(4), width, height, 0.5, yfov=1.0)
    samples, triangles = width * height, SCENE.triangle_count
    triangle = rng.integers(BACKGROUND, triangles, samples).astype(np.int32)
    depth = np.where(triangle >= 0, rng.integers(1, 5, samples).astype(float), math.inf)
    pairs = {
        (int(s), int(t))
        for s, t in zip(rng.integers(0, samples, 12), rng.integers(0, triangles, 12), strict=True)
        if triangle[s] >= 0 and triangle[s] != t
    }
    ties = np.array(sorted(pairs), np.int64).reshape(-1, 2)
    hits, open_ = (int(n) for n in rng.integers(0, 12, 2))
    doubted = np.sort(rng.integers(0, samples, open_))
    return FrameTruth(
        camera,
        "test",
        VisibilityBuffer(triangle.reshape(height, width), depth.reshape(height, width)),
        Ties(ties[:, 0], ties[:, 1].astype(np.int32)),
        doubt=Doubt.of(doubted, rng.integers(0, triangles, open_).astype(np.int32)),
        blend=BlendVisibility.of(
            SCENE,
            rng.integers(0, samples, hits),
            rng.integers(0, triangles, hits).astype(np.int32),
            rng.integers(1, 5, hits) / 2.0,
        ),
    )


def brute_force(truth: FrameTruth) -> ObjectVisibility:
    count = SCENE.object_count
    owners_at: dict[int, set[int]] = {}
    for s, t in enumerate(truth.buffer.triangle.ravel()):
        if t >= 0 and s not in truth.undecided:
            owners_at[s] = {int(SCENE.object_of_triangle[t])}
    for s, t in zip(truth.ties.sample, truth.ties.triangle, strict=True):
        if int(s) in owners_at:
            owners_at[int(s)].add(int(SCENE.object_of_triangle[t]))
    depths = truth.buffer.depth.ravel()
    result = ObjectVisibility(
        np.zeros(count, np.int64),
        np.zeros(count, np.int64),
        np.full(count, NO_SAMPLE, np.int64),
        np.full(count, np.inf),
        np.full(count, np.inf),
        len(owners_at),
    )
    for o in range(count):
        mine = sorted(s for s, owners in owners_at.items() if o in owners)
        alone = [s for s in mine if owners_at[s] == {o}]
        result.samples[o], result.alone[o] = len(mine), len(alone)
        if mine:
            result.sample[o] = alone[0] if alone else mine[0]
            result.depth[o] = depths[result.sample[o]]
            result.nearest[o] = min(depths[s] for s in mine)
        beside = sorted(
            (z, t, s)
            for s, t, z in zip(
                *(
                    x.tolist()
                    for x in (truth.blend.sample, truth.blend.triangle, truth.blend.depth)
                ),
                strict=True,
            )
            if SCENE.object_of_triangle[t] == o and o not in owners_at.get(s, set())
        )
        if beside:
            more = len({s for _, _, s in beside})
            result.samples[o] += more
            result.alone[o] += more
            result.nearest[o] = min(result.nearest[o], beside[0][0])
            if not mine:
                result.depth[o], _, result.sample[o] = beside[0]
    return result


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_objects_seen_counts_what_a_slow_count_counts(seed: int) -> None:
    truth = random_truth(seed)
    fast, slow = objects_seen(truth, SCENE), brute_force(truth)
    assert fast.owned == slow.owned
    for name in ("pixels", "alone", "sample", "depth", "nearest"):
        np.testing.assert_array_equal(getattr(fast, name), getattr(slow, name), err_msg=name)


def test_the_random_truths_reach_ties_blends_and_undecided_samples() -> None:
    truths = [random_truth(seed) for seed in range(50)]
    tied = [objects_seen(t, SCENE) for t in truths]
    assert any((seen.samples > seen.alone).any() for seen in tied)
    assert any(((seen.alone == 0) & (seen.samples > 0)).any() for seen in tied)
    assert any(len(t.undecided) for t in truths)
    assert any(len(t.blend.object) for t in truths)


def one_row(triangles: list[int], **rest: object) -> FrameTruth:
    camera = Camera(np.eye(4), len(triangles), 1, 0.5, yfov=1.0)
    triangle = np.array([triangles], np.int32)
    depth = np.where(triangle >= 0, 2.0, np.inf)
    return FrameTruth(camera, "test", VisibilityBuffer(triangle, depth), **rest)  # type: ignore[arg-type]


def test_a_tied_sample_counts_for_every_object_tied_there_once() -> None:
    # Triangles 0 and 1 are object 0's, 2 is object 2's, 3 to 5 are object 3's.
    ties = Ties(np.array([0, 0, 0, 0]), np.array([1, 2, 3, 4], np.int32))
    seen = objects_seen(one_row([0, 0], ties=ties), SCENE)
    assert seen.samples.tolist() == [2, 0, 1, 1, 0, 0]
    assert seen.alone.tolist() == [1, 0, 0, 0, 0, 0]
    assert seen.sample.tolist() == [1, NO_SAMPLE, 0, 0, NO_SAMPLE, NO_SAMPLE]


def test_an_undecided_sample_makes_nothing_visible() -> None:
    seen = objects_seen(
        one_row([0, 2], doubt=Doubt.of(np.array([1]), np.array([4], np.int32))), SCENE
    )
    assert seen.visible.tolist() == [True, False, False, False, False, False]


def test_a_copy_keeps_its_values_when_the_engine_reuses_its_arrays() -> None:
    truth = one_row([0, 2])
    kept = truth.copy()
    truth.buffer.triangle.fill(BACKGROUND)
    truth.buffer.depth.fill(np.inf)
    assert kept.buffer.triangle.tolist() == [[0, 2]]
    assert kept.buffer.depth.tolist() == [[2.0, 2.0]]


def test_background_belongs_to_no_object() -> None:
    seen = objects_seen(one_row([BACKGROUND] * 3), SCENE)
    assert not seen.visible.any()
    assert not seen.alone.any()
    assert (seen.sample == NO_SAMPLE).all()
    assert np.isinf(seen.nearest).all()
