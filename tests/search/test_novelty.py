"""What is read off a truth is what is hard about it: each on a scene that is hard in that way, and
not on one that is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from visref.conformance.building import box, camera, case, panel, pixel_panel, together
from visref.engines import make_engine
from visref.scene import Alpha
from visref.search.novelty import count_class, features_of, rarity
from visref.visibility import objects_seen

VIEW = camera()


def features(objects, view=VIEW, before=None, **how) -> set[str]:
    scene = case(objects, [view], **how).scene
    truth = make_engine("exact", scene).frame(view)
    names = list(scene.names)
    seen = objects_seen(truth, scene)
    return set(features_of(truth, seen, scene, before, names.__getitem__))


def behind(x, y, depth=9.0):
    return ("seen", pixel_panel(VIEW, x, y, depth))


def wall(*holes):
    """Over rows 10 to 30 at depth 5, but for columns."""
    edges = [4.6, *holes, 50.4]
    parts = [pixel_panel(VIEW, (a, b), (9.6, 30.4), 5.0)
             for a, b in zip(edges[::2], edges[1::2], strict=True)]  # fmt: skip
    return ("wall", together(*parts))


def test_an_object_that_shows_through_a_slot_of_a_pixel_is_in_a_gap():
    found = features([wall(19.7, 20.3), behind((10.0, 30.0), (12.0, 20.0))])
    assert "seen: in a gap" in found
    found = features([wall(19.7, 21.3), behind((10.0, 30.0), (12.0, 20.0))])
    assert "seen: in a gap" not in found
    assert "seen: in a slit" in found
    found = features([wall(19.7, 25.3), behind((10.0, 30.0), (12.0, 20.0))])
    assert not {"seen: in a gap", "seen: in a slit"} & found


def test_an_object_in_the_last_column_is_at_the_border():
    last = [behind((62.7, 63.3), (12.0, 20.0))]
    assert "seen: at the border" in features(last)
    assert "seen: at the border" not in features([behind((61.7, 62.3), (12.0, 20.0))])


def test_few_samples_are_told_from_more():
    assert "seen: 1 samples" in features([behind((19.8, 20.2), (11.8, 12.2))])
    assert "seen: 4 samples" in features([behind((18.8, 21.2), (11.8, 12.2))])
    classes = [count_class(count) for count in (1, 2, 3, 4, 5, 8, 9, 512, 513, 10**6)]
    assert classes == ["1", "2", "4", "4", "8", "8", "16", "512", "many", "many"]


def test_a_poster_just_before_a_wall_is_told_from_one_far_before():
    back = ("wall", panel((-30.0, 30.0), (-30.0, 30.0), -10.0))
    near = features([back, ("poster", panel((-1.0, 1.0), (-1.0, 1.0), -9.95))])
    far = features([back, ("poster", panel((-1.0, 1.0), (-1.0, 1.0), -5.0))])
    assert "poster: just before" in near
    assert "wall: just before" not in near
    assert "poster: just before" not in far


def test_who_is_seen_for_the_first_time_comes_into_view():
    objects = [behind((10.0, 20.0), (12.0, 20.0))]
    assert "seen: comes into view" in features(objects, before=np.array([False]))
    assert "seen: comes into view" not in features(objects, before=np.array([True]))
    assert not any("comes into view" in one for one in features(objects))


@pytest.mark.parametrize(
    ("name", "there", "elsewhere"),
    [
        ("around the eye", box((-1, -1, -1), (1, 1, 1)), box((-1, -1, -4), (1, 1, -3))),
        ("across the near plane", panel((-9, 9), (-9, 9), -0.1 - 1e-6), None),
        ("middle outside", box((-40, -1, -9), (-3, 1, -8)), box((-4, -1, -9), (-3, 1, -8))),
        ("close by", box((-1, -1, -2), (1, 1, -0.15)), box((-1, -1, -2), (1, 1, -1))),
    ],
)
def test_where_a_box_lies_is_told(name, there, elsewhere):
    if name == "across the near plane":
        there, elsewhere = box((-1, -1, -3), (1, -0.02, 1)), box((-1, -1, -3), (1, -0.02, -1))
    backdrop = ("backdrop", panel((-99.0, 99.0), (-99.0, 99.0), -50.0))
    assert f"seen: {name}" in features([("seen", there), backdrop])
    assert f"seen: {name}" not in features([("seen", elsewhere), backdrop])


def test_what_is_behind_glass_is_told():
    objects = [("glass", panel((-1.0, 1.0), (-1.0, 1.0), -4.0)),
               ("seen", panel((-1.0, 1.0), (-1.0, 1.0), -9.0)),
               ("aside", panel((3.0, 5.0), (-1.0, 1.0), -9.0))]  # fmt: skip
    found = features(objects, alpha={"glass": Alpha.BLEND})
    assert "seen: behind glass" in found
    assert "aside: behind glass" not in found


def test_the_same_under_another_kind_of_camera_is_another_feature():
    edge = [behind((-0.4, 3.0), (12.0, 20.0))]
    assert "plain camera: at the border" in features(edge)
    shifted = replace(VIEW, shift_x_px=0.25)
    assert "shifted lens: at the border" in features(edge, view=shifted)


def test_what_few_trials_showed_is_rarer():
    hits = {"common": 100, "rare": 2}
    assert rarity(["rare"], hits) > rarity(["common"], hits) > 0.0
    assert rarity(["rare", "common"], hits) == pytest.approx(0.51)
