"""Labels against each object drawn by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.labels.alone import by_the_book, scene_of
from tests.support.motion import moments, with_own_vertices
from tests.support.truth_scenes import random_soup
from visref.camera import Camera, look_at
from visref.conformance.suite import case
from visref.engines import make_engine
from visref.exact import ExactScene
from visref.labels.frame import FrameLabels, Labeller
from visref.labels.windows import Window
from visref.scene import Alpha, Scene
from visref.visibility import objects_seen

TOWARDS = look_at((0.0, 0.0, 0.5), (0.2, 0.1, -5.0))


def labelled(scene: Scene, camera: Camera, *, threads: int = 1) -> FrameLabels:
    exact = ExactScene(scene, threads=threads)
    truth = exact.certify(camera)
    return Labeller(exact).frame(scene, truth, objects_seen(truth, scene))


def mixed_soup(seed: int) -> Scene:
    """Triangles of all kinds, several to an object."""
    rng = np.random.default_rng(seed)
    scene = random_soup(seed, triangles=36)
    alpha = rng.choice(
        [Alpha.OPAQUE, Alpha.MASK, Alpha.BLEND], scene.triangle_count, p=[0.6, 0.2, 0.2]
    )
    return replace(
        scene,
        alpha=alpha.astype(np.uint8),
        one_sided=rng.random(scene.triangle_count) < 0.3,
    )


CAMERAS = {
    "perspective": Camera(TOWARDS, 20, 16, near=0.5, far=7.0, yfov=1.0),
    "orthographic": Camera(TOWARDS, 20, 16, near=-2.0, far=7.0, ymag=2.0),
    "shifted": Camera(TOWARDS, 16, 20, near=0.25, yfov=1.2, shift_x_px=0.375, shift_y_px=-3.5),
}


CUT = Camera(TOWARDS, 20, 16, near=0.5, yfov=1.0, clip_plane=(0.3, 1.0, 0.1, 0.4), view="cut")


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("seed", range(2))
def test_silhouette_is_what_the_rules_say_of_the_object_alone(seed, name):
    scene, camera = mixed_soup(seed), CAMERAS[name]
    labels = labelled(scene, camera)
    some = 0
    for each in range(scene.object_count):
        alone = by_the_book(scene, camera, each)
        own = labels.alone.undecided[labels.alone.undecided[:, 0] == each, 1]
        assert own.tolist() == np.flatnonzero(alone.open).tolist()
        mask = np.zeros((camera.height, camera.width), np.bool_)
        for _, y, x0, x1 in labels.alone.runs[labels.alone.runs[:, 0] == each]:
            assert not mask[y, x0 : x1 + 1].any()
            mask[y, x0 : x1 + 1] = True
        assert np.array_equal(mask.reshape(-1), alone.mine)
        assert labels.silhouette_samples[each] == alone.mine.sum()
        some += alone.mine.any()
        if alone.mine.any():
            # Its hits' keys are computed in float64: some 2^-40 of a depth, at these sizes.
            assert labels.depth[each] == pytest.approx(alone.depth, rel=2.0**-40)
        else:
            assert np.isnan(labels.depth[each])
    assert some > 5


@pytest.mark.parametrize("seed", range(2))
def test_object_alone_is_all_visible_at_any_moment_and_in_any_view(seed):
    scene = with_own_vertices(random_soup(seed + 10, triangles=24))
    poses = moments(scene, seed, 3)
    other = look_at((2.0, 1.0, 0.0), (-0.5, 0.0, -4.0))
    right = Camera(other, 30, 12, near=0.25, yfov=0.8, view="right")
    views = [CAMERAS["perspective"], right, CUT]
    still = replace(poses[0], absent=None)
    exact = ExactScene(poses[0], threads=2)
    labeller, compared = Labeller(exact), 0
    for posed in poses:
        exact.pose(posed)
        for camera in views:
            truth = exact.certify(camera)
            labels = labeller.frame(posed, truth, objects_seen(truth, posed))
            gone = np.zeros(still.object_count, np.bool_) if posed.absent is None else posed.absent
            assert np.array_equal(labels.there, ~gone)
            for each in np.flatnonzero(labels.there):
                only = scene_of(posed, int(each))
                alone_truth = ExactScene(only, threads=1).certify(camera)
                seen = objects_seen(alone_truth, only)
                alone = labelled(only, camera)
                samples = seen.samples[each]
                assert labels.silhouette_samples[each] == samples
                assert alone.silhouette_samples[each] == samples
                assert alone.visible_samples[each] == samples
                assert not len(alone.occluders)
                compared += samples > 0
    assert compared > 10


def test_textured_masks_are_decided_as_in_the_truth_of_the_object_alone():
    scene, path = case("through_the_holes_of_a_mask")
    camera = path.views(path.numbers[0])[0]
    labels = labelled(scene, camera)
    for each in range(scene.object_count):
        only = scene_of(scene, each)
        truth = ExactScene(only, threads=1).certify(camera)
        assert labels.silhouette_samples[each] == objects_seen(truth, only).samples[each]
        assert (labels.alone.undecided[:, 0] == each).sum() == len(truth.undecided)
    assert scene.has_mask


@pytest.mark.parametrize("name", ["perspective", "orthographic"])
def test_image_as_large_as_it_takes_is_as_good_as_a_wider_camera(name):
    scene, camera = random_soup(3, triangles=30), CAMERAS[name]
    labels = labelled(scene, camera)
    # An odd factor, so that each sample is one of the wide image's.
    factor = 9
    lens = (
        {"yfov": 2.0 * np.arctan(factor * np.tan(camera.yfov / 2))}
        if camera.yfov
        else {"ymag": camera.ymag * factor, "yfov": None}
    )
    wide = replace(camera, width=camera.width * factor, height=camera.height * factor, **lens)
    margin = (factor - 1) // 2 * np.array([camera.width, camera.height] * 2)
    whole = labelled(scene, wide)
    partly = 0
    for each in range(scene.object_count):
        box = whole.amodal_box[each]
        if labels.whole_samples[each] < 0 or not labels.silhouette_samples[each]:
            continue
        assert np.all(box[:2] > 0), "the wide image holds it all"
        assert labels.whole_samples[each] == whole.silhouette_samples[each]
        assert np.array_equal(labels.amodal_box[each], box - margin)
        assert (
            labels.in_view_fraction[each]
            == labels.silhouette_samples[each] / whole.silhouette_samples[each]
        )
        partly += labels.in_view_fraction[each] < 1.0
    assert partly > 2


def test_samples_beyond_the_image_have_the_cameras_own_rays():
    camera = CAMERAS["shifted"]
    wide = Window(camera, -3, -2, camera.width + 5, camera.height + 7)
    assert np.array_equal(wide.column_a[3 : 3 + camera.width], camera.column_a)
    assert np.array_equal(wide.row_b[2 : 2 + camera.height], camera.row_b)
    assert np.array_equal(np.diff(wide.column_a), np.full(wide.width - 1, 2.0))


@pytest.mark.parametrize("seed", range(3))
def test_visible_hidden_and_undecided_make_the_silhouette(seed):
    scene = mixed_soup(seed + 20)
    camera = CAMERAS["perspective"]
    labels = labelled(scene, camera)
    exact = ExactScene(scene, threads=1)
    truth = exact.certify(camera)
    assert np.array_equal(labels.visible_samples, objects_seen(truth, scene).samples)
    hidden = np.bincount(
        labels.occluders[:, 0], labels.occluders[:, 2], minlength=scene.object_count
    )
    own = np.bincount(labels.alone.undecided[:, 0], minlength=scene.object_count)
    undecided = np.nan_to_num(labels.undecided_fraction) * (labels.silhouette_samples + own) - own
    assert len(truth.ties.sample) == 0
    assert np.allclose(labels.visible_samples + hidden + undecided, labels.silhouette_samples)
    # Who hides it is who owns the sample.
    owner = truth.buffer.triangle.reshape(-1)
    for each, by, samples in labels.occluders[:20]:
        alone = by_the_book(scene, camera, int(each)).mine
        glass = truth.blend.sample[truth.blend.object == each]
        alone[glass] = False
        alone[truth.undecided] = False
        assert samples == (scene.object_of_triangle[owner[alone & (owner >= 0)]] == by).sum()


def test_no_object_shows_more_than_it_has_however_the_engine_rounds():
    scene = random_soup(7)
    camera = Camera(TOWARDS, 160, 120, near=0.5, far=8.0, yfov=1.0)
    engine = make_engine("embree", scene, threads=1)
    truth = engine.frame(camera).copy()
    # As if it had given some samples to whoever is nowhere near.
    truth.buffer.triangle[:2, :3] = 0
    seen = objects_seen(truth, scene)
    labels = Labeller(ExactScene(scene, threads=1)).frame(scene, truth, seen)
    engine.close()
    assert np.array_equal(labels.visible_samples, seen.samples)
    assert (labels.visible_samples <= labels.silhouette_samples).all()
    honest = labelled(scene, camera)
    more = labels.silhouette_samples - honest.silhouette_samples
    assert (more >= 0).all()
    assert 1 <= more[0] <= 6
    near = np.abs(labels.visible_samples - honest.visible_samples).sum()
    assert near < 0.01 * camera.samples
