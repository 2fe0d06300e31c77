"""Each wrong culler is convicted by the suite, and the right ones that they start from are not."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.shares import share
from tests.wrong_cullers import RIGHT, WRONG
from tests.wrong_cullers.exact import OneTriangleEach
from visref.conformance import Status, assert_conforms, case, check_culler, conformance_checks

CHECKS = {check.name: check for check in conformance_checks()}

# Of the checks that convict a wrong culler, those that few others fail and that take little time.
CONVICTED_BY = {
    # depth
    "distance-for-depth": "slanting_wall_before_a_screen posters_on_a_wall",
    "depth-of-the-nearest-by-distance": "slanting_wall_before_a_screen",
    "centre-depth": "slanting_wall_before_a_screen interpenetrating_objects",
    "far-corner-depth": "torn_layers",
    "corners-behind-taken": "revealed_across_the_near_plane object_crossing_the_near_plane",
    "y-flipped": "gap_narrower_than_a_texel jump_cuts",
    "x-flipped": "posters_on_a_wall objects_of_one_sample",
    "nearest-of-the-rectangle": "coplanar_ties rotated_and_mirrored_plates",
    "centre-of-the-rectangle": "rotated_and_mirrored_plates slivers",
    "four-corners-of-the-rectangle": "gap_narrower_than_a_texel walk_through_a_city",
    "point-sampled": "objects_of_one_sample rows_and_columns_at_the_border",
    "averaged": "huge_depth_range orthographic_camera",
    "odd-sides-cut": "hole_of_a_pixel",
    "eight-bits": "posters_on_a_wall huge_grazing_triangle",
    "sixteen-bits": "posters_on_a_wall revealed_by_a_pierced_wall",
    "strict-own-depth": "slivers several_hundred_objects",
    "threshold-of-two": "revealed_leaning_panels odd_viewports",
    "threshold-of-eight": "peeking_by_a_pixel gap_narrower_than_a_texel",
    "rounded-inward": "through_the_holes_of_a_mask close_by_in_an_orthographic_view",
    "last-row-left-out": "rows_and_columns_at_the_border odd_viewports",
    "last-column-left-out": "rows_and_columns_at_the_border odd_viewports",
    "boxes-occlude": "through_the_holes_of_a_mask rotated_and_mirrored_plates",
    "clip-plane-ignored": "cut_by_a_plane",
    "occluders-before-near": "exactly_at_the_near_plane",
    "occluders-dilated": "rows_and_columns_at_the_border gap_narrower_than_a_texel",
    "only-the-background-shows": "revealed_across_the_near_plane slanting_wall_before_a_screen",
    "background-is-near": "rotated_and_mirrored_plates slivers",
    # frustum
    "corners-only": "revealed_across_the_near_plane rotated_and_mirrored_plates",
    "centre-only": "revealed_across_the_near_plane large_object_at_the_edge",
    "any-corner-behind": "revealed_across_the_near_plane slanting_wall_before_a_screen",
    "corners-behind-projected": "object_crossing_the_near_plane lens_shift_and_zoom",
    "sphere-of-half-the-side": "jump_cuts walk_through_a_city",
    "two-corners": "eye_inside_an_object walk_through_a_city",
    "shift-ignored": "beside_the_unshifted_view",
    "shift-x-ignored": "beside_the_unshifted_view",
    "shift-y-ignored": "beside_the_unshifted_view",
    "shift-x-reversed": "beside_the_unshifted_view revealed_leaning_panels",
    "shift-y-reversed": "beside_the_unshifted_view",
    "shift-halved": "beside_the_unshifted_view",
    "orthographic-shift-ignored": "beside_the_unshifted_view",
    "aspect-ignored": "close_by_in_an_orthographic_view stacks_of_sheets",
    "aspect-inverted": "close_by_in_an_orthographic_view stacks_of_sheets",
    "horizontal-field-of-view": "stacks_of_sheets posters_on_a_wall",
    "field-of-view-of-the-first-frame": "lens_shift_and_zoom",
    "viewport-of-the-first-frame": "odd_viewports hole_of_a_pixel",
    "up-assumed": "rolled_and_pitched_camera",
    "orthographic-as-perspective": "close_by_in_an_orthographic_view beside_the_unshifted_view",
    "height-halved": "one_sided_walls_at_the_side close_by_in_an_orthographic_view",
    "near-too-large": "exactly_at_the_near_plane huge_depth_range",
    "far-too-near": "posters_on_a_wall huge_depth_range",
    "far-halved": "exactly_at_the_far_plane posters_on_a_wall",
    "on-far-dropped": "exactly_at_the_far_plane",
    "on-near-dropped": "exactly_at_the_near_plane",
    "distance-for-far": "huge_depth_range",
    "eye-inside-dropped": "revealed_across_the_near_plane slanting_wall_before_a_screen",
    "small-dropped": "objects_of_one_sample several_hundred_objects",
    "thin-dropped": "coplanar_ties objects_without_triangles",
    "origin-forgotten": "about_an_origin_of_its_own",
    "float-world": "about_an_origin_of_its_own",
    "half-float-boxes": "huge_depth_range object_crossing_the_near_plane",
    # exact
    "one-triangle-each": "coplanar_ties objects_without_triangles",
    "hidden-drawn-though-exact": "objects_without_triangles one_sided_walls_at_the_side",
    "hidden-drawn-though-aggressive": "coplanar_ties objects_without_triangles",
    "beyond-far-drawn-though-exact": "exactly_at_the_far_plane beside_the_unshifted_view",
    "samples-of-half-the-size": "objects_of_one_sample slivers",
    "nearest-of-a-tie": "coplanar_ties glass",
    # materials
    "glass-occludes": "glass revealed_behind_glass",
    "masks-are-solid": "through_the_holes_of_a_mask",
    "glass-dropped": "glass revealed_behind_glass",
    "masks-dropped": "through_the_holes_of_a_mask",
    "back-faces-occlude": "one_sided_walls",
    "two-sided-turned-away": "slivers eye_inside_an_object",
    "winding-reversed": "one_sided_walls_at_the_side one_sided_walls",
    "facing-by-the-view-axis": "one_sided_walls_at_the_side",
    "facing-by-the-eye-in-orthographic": "one_sided_walls_at_the_side",
    "facing-by-the-first-triangle": "one_sided_walls",
    # memory
    "last-answer": "large_object_at_the_edge interpenetrating_objects",
    "last-depth": "stacks_of_sheets slivers",
    "last-frustum": "slanting_wall_before_a_screen large_object_at_the_edge",
    "first-answer": "interpenetrating_objects revealed_behind_glass",
    "cut-ignored": "jump_cuts revealed_behind_glass",
    "cut-alone-heeded": "fast_turn revealed_behind_glass",
    "hidden-stays-hidden": "large_object_at_the_edge interpenetrating_objects",
    # moving
    "boxes-at-rest": "turning_about bending_reeds",
    "boxes-of-the-frame-before": "carried_about turning_about",
    "frustum-of-boxes-at-rest": "carried_about bending_reeds",
    "moved-without-a-turn": "bending_reeds two_views_of_a_changing_city",
    "boxes-of-joints": "bending_reeds carried_about",
    "depth-at-its-old-place": "sliding_door",
    "depth-at-rest": "sliding_door",
    "removed-still-hides": "appearing_and_vanishing",
    "appeared-unknown": "appearing_and_vanishing",
    "vanished-for-good": "appearing_and_vanishing",
    "answer-of-the-other-view": "two_views",
    "hidden-in-the-other-view": "two_views",
    "first-views-frustum": "two_views_of_a_changing_city",
    # units
    "half-of-the-clusters": "coplanar_ties one_sided_walls_at_the_side",
    "first-cluster-alone": "coplanar_ties objects_without_triangles",
    "last-cluster-lost": "coplanar_ties objects_without_triangles",
    "every-second-triangle-lost": "coplanar_ties objects_without_triangles",
    "last-triangle-lost": "coplanar_ties objects_without_triangles",
    "cells-of-centroids": "revealed_across_the_near_plane one_sided_walls",
    "numbers-off-by-one": "objects_without_triangles exactly_at_the_far_plane",
    "numbers-of-one-byte": "several_hundred_objects",
    "answers-shifted": "objects_without_triangles exactly_at_the_far_plane",
    "last-answer-lost": "coplanar_ties objects_without_triangles",
    "at-most-a-hundred": "several_hundred_objects crowd",
    "same-names-merged": "coplanar_ties through_the_holes_of_a_mask",
    "empty-object-breaks": "objects_without_triangles",
    "empty-scene-breaks": "empty_scene",
}

# Nothing is visible there, or nothing is asked of what is drawn.
ASKS_OF_NO_SAMPLE = {"empty_scene", "answers_repeat", "close_at_any_time"}


def test_every_wrong_culler_stands_in_the_table():
    assert set(CONVICTED_BY) == set(WRONG)
    assert not set(WRONG) & set(RIGHT)
    assert all(found.rule and found.culler.summary for found in WRONG.values())


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG)
def test_wrong_culler_fails_the_checks_that_convict_it(name):
    checks = [CHECKS[check] for check in CONVICTED_BY[name].split()]
    results = check_culler(WRONG[name].culler, checks=checks)
    assert {result.check for result in results if result.status is Status.FAILED} == {
        check.name for check in checks
    }
    if "break" not in name:
        told = [problem for result in results for problem in result.problems]
        assert any(line.startswith(("MISSED_OBJECT", "DRAWN_HIDDEN")) for line in told)


@pytest.mark.slow
@pytest.mark.parametrize("at", range(len(RIGHT)), ids=list(RIGHT))
def test_right_culler_passes_every_check(at):
    """Of its share; another for each."""
    assert_conforms(list(RIGHT.values())[at], checks=share(conformance_checks(), at))


@pytest.mark.parametrize("name", RIGHT)
def test_right_culler_leaves_something_out(name):
    """Or its pass would be that of a culler that draws everything."""
    scene, path = case("one_sided_walls")
    culler = RIGHT[name]()
    units = culler.prepare(scene)
    drawn = [len(culler.cull(view).unit_ids) for view in path]
    culler.close()
    assert 0 < np.mean(drawn) < units.count


@pytest.mark.slow
def test_one_triangle_of_each_visible_object_fails_nearly_all_checks():
    results = check_culler(OneTriangleEach)
    passed = {result.check for result in results if result.status is Status.PASSED}
    assert passed == ASKS_OF_NO_SAMPLE
    assert all("MISSED_OBJECT" in result.problems[0] for result in results if result.problems)
