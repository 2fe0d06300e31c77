"""A mistake in the input is named, and nothing is said of an engine that is at fault itself."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.alignment.faulty import LIKE_AN_INPUT
from tests.alignment.faulty import recorded as drawn_by
from tests.alignment.mistakes import MISTAKES
from tests.alignment.scenes import RECORDERS, SCENES, visible_sets
from tests.alignment.trying import found_for, recorded, said_of
from tests.wrong_cullers import WRONG
from visref.alignment import HYPOTHESES, best_alignment, search
from visref.alignment.agreement import Agreement, Answers, within_view
from visref.alignment.sentence import percent, sentence
from visref.camera import Camera, look_at
from visref.cli.main import main
from visref.conformance import case
from visref.engines import make_engine
from visref.scene import Units
from visref.timeline import Timeline

CASES = ["walk_through_a_city", "crowd", "fast_turn", "several_hundred_objects"]

# Where the wrong input gives the right drawn sets but for a few objects, or two readings give them:
# nothing can be named.
HARDLY_SHOWS = {
    # The house's corner is where its path's world begins.
    ("rooms", "owners", "origin at the lowest corner"),
    ("rooms", "frustum", "origin at the lowest corner"),
    # The city's ground is level and the eye low: below it things look alike.
    ("city", "owners", "left-handed, y"),
    ("city", "frustum", "left-handed, y"),
    ("city", "frustum", "horizontal for vertical"),
    ("city", "frustum", "twice the angle"),
    # The shift in y matters little there.
    ("city", "frustum", "shift x and y"),
}

# Each mistake by one recorder in one scene, and once more in another; `python -m tests.alignment`
# tries them all.
_OTHERS = [(scene, recorder) for scene in SCENES for recorder in RECORDERS][1:]
_TRIED = [("yard", "owners", name) for name in MISTAKES] + [
    (*_OTHERS[index % len(_OTHERS)], name) for index, name in enumerate(MISTAKES)
]


@pytest.mark.parametrize(
    ("scene", "recorder", "name"),
    [row for row in _TRIED if MISTAKES[row[2]].only in ("", row[1])],
)
def test_a_mistake_is_named_first(scene, recorder, name):
    mistake = MISTAKES[name]
    found = found_for(scene, recorder, mistake)
    if (scene, recorder, name) in HARDLY_SHOWS:
        assert found is None
        return
    assert found is not None, "nothing was named"
    assert found.hypothesis.name == mistake.named
    # An id that no number is left for is lost.
    assert found.agreement >= (0.99 if mistake.named.startswith("ids") else 1.0)
    assert found.agreement > max(found.as_given, found.next_best[1])


def test_every_hypothesis_is_the_answer_to_a_mistake():
    named = {mistake.named for mistake in MISTAKES.values()}
    # In these scenes the path's far plane hides nothing that a square picture would not.
    assert {hypothesis.name for hypothesis in HYPOTHESES} - named == {"square picture"}


@pytest.mark.parametrize("recorder", RECORDERS)
@pytest.mark.parametrize("scene", SCENES)
def test_nothing_is_said_of_a_sound_recording(scene, recorder):
    scene, path, sets = recorded(scene, recorder)
    assert said_of(scene, path, sets) is None


def seen_by(scene, path, asked):
    """What a truth says, as a search is given it; `asked` gets what was asked for."""
    engine = make_engine("embree", scene, threads=1)

    def known(frame, view):
        asked.append((frame, view))
        (camera,) = [one for one in path.views(frame) if one.view == view]
        owner = engine.frame(camera).buffer.triangle
        seen = np.zeros(scene.object_count, np.bool_)
        seen[scene.object_of_triangle[owner[owner >= 0]]] = True
        return seen

    return known


def test_a_sound_recording_needs_no_engine_where_a_truth_is_given(monkeypatch):
    scene, path, sets = recorded("yard", "owners")
    asked: list = []
    known = seen_by(scene, path, asked)
    monkeypatch.setattr(search, "make_engine", lambda *_, **__: pytest.fail("an engine is made"))
    timeline = Timeline(scene, path)
    assert best_alignment(timeline, path, visible_sets(scene, sets), known=known) is None
    assert len(asked) == search.FRAMES
    with pytest.raises(pytest.fail.Exception):
        best_alignment(timeline, path, visible_sets(scene, sets), known=lambda *_: None)


def test_what_was_drawn_is_the_same_whether_units_are_objects_or_only_alike():
    scene, path, sets = recorded("yard", "owners")
    alike = visible_sets(scene, sets)
    assert alike.units.are_objects(scene)
    turned = alike.units.triangles.copy()
    first = slice(*alike.units.offsets[:2])
    turned[first] = turned[first][::-1]
    others = replace(alike, units=Units(alike.units.offsets, turned))
    assert not others.units.are_objects(scene)
    for one, other in zip(
        search._cells(scene, path, alike), search._cells(scene, path, others), strict=True
    ):
        assert (one.drawn == other.drawn).all()
        assert one.drawn.any()


@pytest.mark.parametrize("name", ["left-handed, x", "frames +1", "ids from 1"])
def test_a_truth_changes_nothing_of_what_is_found(name):
    scene, path, sets = MISTAKES[name].change(*recorded("yard", "owners"))
    found = said_of(scene, path, sets)
    known = seen_by(scene, path, [])
    again = best_alignment(
        Timeline(scene, path), path, visible_sets(scene, sets), threads=1, known=known
    )
    assert found is not None
    assert again is not None
    assert (again.hypothesis.name, again.agreement) == (found.hypothesis.name, found.agreement)


def test_nothing_is_said_of_an_engine_that_draws_everything_or_nothing():
    scene, path, _ = recorded("yard", "owners")
    for ids in (np.arange(scene.object_count), np.zeros(0, int)):
        sets = {frame: {"": ids} for frame in path.numbers}
        assert said_of(scene, path, sets) is None


def test_nothing_is_said_where_two_readings_fit():
    """Seen from a level floor's height, with all things high, up and down are alike."""
    scene, path, sets = recorded("city", "frustum")
    scene, path, sets = MISTAKES["left-handed, y"].change(scene, path, sets)
    assert said_of(scene, path, sets) is None


@pytest.mark.parametrize("seed", range(6))
def test_nothing_is_said_of_objects_lost_at_random(seed):
    scene, path, sets = recorded("rooms", "owners")
    rng = np.random.default_rng(seed)
    lost = rng.random(scene.object_count) < 0.1 + 0.1 * seed
    sets = {f: {"": views[""][~lost[views[""]]]} for f, views in sets.items()}
    assert said_of(scene, path, sets) is None


def test_the_sentence_says_both_agreements_the_reading_and_the_fix():
    found = found_for("yard", "owners", MISTAKES["OpenCV's axes"])
    assert found is not None
    text = sentence(found)
    assert text.startswith("100 % if the camera looks along +Z, ")
    assert f"{percent(found.as_given)} as given (8 frames looked at): write world_from" in text
    assert "Or the engine" not in text
    late = found_for("yard", "owners", MISTAKES["frames +1"])
    assert late is not None
    assert sentence(late).endswith("Or the engine answers 1 frame late")


@pytest.mark.parametrize("name", sorted(WRONG))
def test_no_wrong_engine_is_taken_for_a_wrong_input(name):
    """On one of its cases each; `python -m tests.alignment engines` tries them on all."""
    at = CASES[sorted(WRONG).index(name) % len(CASES)]
    scene, world = case(at)
    path = world.relative_to(scene.origin)
    timeline, sets = drawn_by(WRONG[name].culler, scene, path)
    found = best_alignment(timeline, path, sets, threads=1)
    assert found is None or (found.hypothesis.engine and name in LIKE_AN_INPUT)


def test_agreement_is_matthews_correlation():
    drawn = np.array([1, 1, 1, 0, 0, 0, 0, 1, 1, 0], bool)
    seen = np.array([1, 1, 0, 1, 0, 0, 0, 0, 0, 0], bool)
    within = np.array([1, 1, 0, 1, 0, 0, 0, 0, 1, 1], bool)
    found = Answers.of(drawn, seen, within).counted()
    # The last two are within the view and hidden: they count neither way.
    assert found == Agreement(shown=2, lost=1, beside=2, left_out=3)
    expected = np.corrcoef(drawn[:8], seen[:8])[0, 1]
    assert found.score == pytest.approx(expected, rel=1e-12)
    assert Agreement(5, 0, 9, 0).score == 0.0
    assert percent(0.9999) == "99 %"
    assert percent(-0.5) == "0 %"


@pytest.mark.parametrize("shift", [(0.0, 0.0), (7.0, -11.0)])
@pytest.mark.parametrize("lens", [{"yfov": 0.8}, {"ymag": 6.0}])
def test_what_a_view_holds_is_never_outside_of_it(lens, shift):
    """Against each point of boxes put through the projection matrix."""
    camera = Camera(
        look_at((3.0, 2.0, 9.0), (0.0, 1.0, -4.0)),
        64,
        40,
        near=1.0,
        far=30.0,
        shift_x_px=shift[0],
        shift_y_px=shift[1],
        **lens,
    )
    rng = np.random.default_rng(2)
    low = rng.uniform(-25, 25, (400, 3))
    boxes = np.stack([low, low + rng.uniform(0.1, 6, (400, 3))], axis=1)
    inside = within_view(camera, boxes)
    points = low[:, None] + rng.random((400, 64, 3)) * (boxes[:, 1] - low)[:, None]
    clip = np.concatenate([points, np.ones((400, 64, 1))], axis=2) @ camera.clip_from_world().T
    held = (np.abs(clip[..., :3]) <= clip[..., 3:]).all(axis=2).any(axis=1)
    assert held.any()
    assert not (held & ~inside).any()
    # And it is no empty claim: most of what lies apart is found to.
    assert np.count_nonzero(~inside) > 100


def test_check_says_it_first_and_the_user_chooses_what_follows(tmp_path, capsys):
    _, wrong, sets = MISTAKES["OpenCV's axes"].change(*recorded("city", "owners"))
    (tmp_path / "path.json").write_text(json.dumps(wrong.to_json()))
    lines = [json.dumps({"frame": f, "visible": v[""].tolist()}) for f, v in sets.items()]
    (tmp_path / "seen.jsonl").write_text("\n".join(lines) + "\n")
    given = ["check", "city:scale=0.15,seed=3", "--path", str(tmp_path / "path.json")]
    given += ["--visible", str(tmp_path / "seen.jsonl"), "--pictures", "0"]
    for choice, status in (("keep", 1), ("inconclusive", 3)):
        out = tmp_path / choice
        assert main([*given, "--if-misaligned", choice, "--out", str(out)]) == status
        said = capsys.readouterr().out
        assert said.startswith("MISALIGNED: seen.jsonl: 100 % if the camera looks along +Z, ")
        verdict = json.loads((out / "verdict.json").read_text())
        assert verdict["findings"][0]["code"] == "MISALIGNED"
        assert verdict["cullers"]["seen.jsonl"]["violations"] > 0
        assert main(["report", str(out), "--out", str(out / "page")]) in (0, status)
        capsys.readouterr()
        page = (out / "page" / "report.html").read_text()
        assert page.index("if the camera looks along +Z") < page.index("samples lost")
