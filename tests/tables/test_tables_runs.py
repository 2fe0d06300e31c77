"""What the papers' tables need is run once, kept, made anew when something else is asked for,
and goes on after an interrupt."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support import tables_runs
from tests.support.dying import content
from tests.support.tables_runs import ALL, BROKEN, NOTHING, SIZE, STOPPED, TOWN, All, Steps, paper
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.papers import load_paper, paper_names
from visref.papers.contents import Experiment, JudgedRun
from visref.tables import runs
from visref.tables.plan import code_digest, cut_path, sampled, tasks
from visref.tables.runs import run_all

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def own_experiments(monkeypatch):
    """Experiments of the tests stand where installed ones would, and no culler ran yet."""
    monkeypatch.setattr(runs, "load_entry", lambda group, name, kind: getattr(tables_runs, name))
    All.cameras.clear()


def run(out, papers=None, **options):
    steps = Steps()
    measured = run_all([paper()] if papers is None else papers, out, steps, **options)
    return measured, steps


# The plan.


@given(st.integers(1, 60), st.none() | st.integers(1, 70), st.integers(1, 8))
def test_sampled_frames_are_of_the_path_ascending_and_as_many_as_asked_for(count, wanted, stretch):
    frames = sampled(count, wanted, stretch)
    assert frames == sorted(set(frames))
    assert set(frames) <= set(range(count))
    if stretch == 1 or wanted is None:
        assert len(frames) == min(count, count if wanted is None else wanted)
    assert len(frames) <= (count if wanted is None else wanted)


def test_samples_are_spread_over_the_path_and_come_in_stretches():
    assert sampled(100, 4, 1) == [12, 37, 62, 87]
    assert sampled(100, 6, 3) == [25, 26, 27, 75, 76, 77]


@given(
    st.integers(1, 60),
    st.integers(1, 70),
    st.integers(1, 8),
    st.floats(-0.5, 0.5, allow_nan=False),
)
def test_moved_samples_are_of_the_path_too(count, wanted, stretch, shift):
    frames = sampled(count, wanted, stretch, shift)
    assert frames == sorted(set(frames))
    assert frames
    assert set(frames) <= set(range(count))
    assert sampled(count, wanted, stretch, 0.0) == sampled(count, wanted, stretch)


def test_moved_samples_lie_between_the_usual_ones():
    assert sampled(100, 4, 1, 0.48) == [24, 49, 74, 99]
    assert sampled(100, 4, 1, -0.48) == [0, 25, 50, 75]
    assert sampled(100, 6, 3, 0.2) == [35, 36, 37, 85, 86, 87]
    assert sampled(7, None, 1, 0.5) == list(range(7))


def test_wrong_settings_and_places_are_told_before_anything_is_measured(tmp_path):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "summary.md").write_text("mine")
    for out, options, told in (
        ("new", {"threads": 0}, "--threads is 0"),
        ("new", {"workers": 0}, "--workers is 0"),
        ("new", {"shift": float("nan")}, "--shift is nan"),
        ("file", {}, "file is no folder"),
        ("file/x", {}, "file is no folder"),
        ("folder", {}, "it holds what is no tables"),
    ):
        with pytest.raises(InputError, match=told):
            run_all([paper()], tmp_path / out, Steps(), frames=1, **options)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["file", "folder"]
    assert [one.name for one in (tmp_path / "folder").iterdir()] == ["summary.md"]
    # One that was ended before anything was measured.
    (tmp_path / "early" / "scenes").mkdir(parents=True)
    run_all([], tmp_path / "early", Steps())


def test_another_seed_is_of_every_scene_that_names_none():
    walks = (
        JudgedRun("a", "city", ()),
        JudgedRun("b", "city:scale=0.2", ()),
        JudgedRun("c", "city:seed=3", ()),
    )
    found = paper(walks, (Experiment("e", "n"),))
    scenes = [task.work.scene for task in tasks([found], large=False, seed=7)]
    assert sorted(filter(None, scenes)) == ["city:scale=0.2,seed=7", "city:seed=3", "city:seed=7"]
    assert None in scenes
    usual = [task.work.scene for task in tasks([found], large=False)]
    assert sorted(filter(None, usual)) == ["city", "city:scale=0.2", "city:seed=3"]


def test_a_stretch_starts_with_a_cut_and_goes_on_without():
    camera = Camera(look_at((0, 0, 4), (0, 0, 0)), 4, 4, near=1.0, far=9.0, ymag=2.0)
    path = cut_path(CameraPath((camera,) * 6), [1, 2, 4])
    assert [camera.cut for camera in path] == [False, True, False, False, True, False]


def test_tasks_of_one_scene_come_together_and_large_ones_last():
    walks = (
        JudgedRun("big", "c", (), large=True),
        JudgedRun("a", "x", ()),
        JudgedRun("b", "y", ()),
        JudgedRun("c", "x", ()),
    )
    ordered = tasks([paper(walks, (Experiment("e", "n", "y"),))], large=True)
    assert [task.work.key for task in ordered] == ["a", "c", "b", "e", "big"]
    assert "big" not in [task.work.key for task in tasks([paper(walks, ())], large=False)]


def test_code_digest_changes_with_a_source_and_with_nothing_else(tmp_path, monkeypatch):
    package = tmp_path / "a_package_of_one_module"
    package.mkdir()
    (package / "__init__.py").write_text("x = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    before = code_digest([package.name])
    (package / "notes.txt").write_text("hello")
    assert code_digest([package.name]) == before
    (package / "__init__.py").write_text("x = 2\n")
    assert code_digest([package.name]) != before


@pytest.mark.parametrize("name", paper_names())
def test_every_paper_names_each_of_its_records_once_and_makes_tables_of_none(name):
    found = load_paper(name)
    keys = [work.key for work in (*found.runs, *found.experiments)]
    assert len(set(keys)) == len(keys)

    class Nowhere:
        def run(self, key):
            assert key in keys
            return

        def experiment(self, key):
            assert key in keys
            return

    made = found.tables(Nowhere())
    assert made
    assert all(table.rows for table in made)


def test_an_unknown_paper_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="hey2001"):
        load_paper("hey2002")


# The results.


def test_every_walk_and_experiment_is_recorded_and_read_back(tmp_path):
    measured, steps = run(tmp_path, frames=3)
    (toy,) = measured.papers
    assert not measured.failures
    assert steps.all > 0
    assert steps.done == pytest.approx(steps.all)
    results = measured.results(toy)
    counted = results.experiment("count")
    assert (counted["frames"], counted["sizes"]) == (3, [list(SIZE)])
    first = results.run("first")
    assert counted["triangles"] == first.manifest.scene.triangles
    assert first.frame_numbers == (1, 3, 5)
    assert first.verdict.status == "no_violation_found"
    assert [camera.cut for camera in All.cameras] == [True] * 6


def test_an_experiment_without_a_scene_is_given_none(tmp_path):
    measured, _ = run(tmp_path, [paper((), (Experiment("alone", "counting"),))])
    (toy,) = measured.papers
    assert measured.results(toy).experiment("alone") == {"scene": None, "path": None}


def test_the_same_again_runs_nothing_and_other_frames_run_all(tmp_path):
    run(tmp_path, frames=2)
    assert len(All.cameras) == 4
    _, steps = run(tmp_path, frames=2)
    assert len(All.cameras) == 4
    assert steps.done == pytest.approx(steps.all)
    run(tmp_path, frames=3)
    assert len(All.cameras) == 10


def test_other_code_runs_all_again(tmp_path, monkeypatch):
    run(tmp_path, frames=2)
    monkeypatch.setattr(runs, "code_digest", lambda packages=None: "edited")
    run(tmp_path, frames=2)
    assert len(All.cameras) == 8


def test_an_interrupted_run_goes_on_with_what_it_had_not_done(tmp_path):
    first, second = paper().runs
    stopped = JudgedRun("second", TOWN, (STOPPED,), size=SIZE)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, [paper((first, stopped), ())], frames=2)
    assert len(All.cameras) == 2
    measured, _ = run(tmp_path, [paper((first, second), ())], frames=2)
    assert len(All.cameras) == 4
    assert all(measured.results(measured.papers[0]).run(walk.key) for walk in (first, second))


def test_a_failure_is_told_and_the_rest_goes_on(tmp_path):
    broken = (Experiment("broken", "without_gl"), Experiment("count", "counting", TOWN))
    unknown = JudgedRun("unknown", "no_such_scene", (ALL,))
    measured, _ = run(tmp_path, [paper((unknown,), broken)], frames=1)
    assert measured.failures["toy/broken"] == "no OpenGL here"
    assert "no_such_scene" in measured.failures["toy/unknown"]
    results = measured.results(measured.papers[0])
    assert results.experiment("broken") is None
    assert results.run("unknown") is None
    assert results.experiment("count") is not None


def test_a_culler_that_breaks_down_leaves_no_record_of_half_a_walk(tmp_path):
    measured, _ = run(tmp_path, [paper((JudgedRun("first", TOWN, (ALL, BROKEN), size=SIZE),), ())])
    assert "it fell over" in measured.failures["toy/first"]
    assert measured.results(measured.papers[0]).run("first") is None


def test_what_failed_leaves_no_record_of_an_earlier_time(tmp_path):
    run(tmp_path, [paper((), (Experiment("one", "counting"),))])
    measured, _ = run(tmp_path, [paper((), (Experiment("one", "without_gl"),))])
    assert measured.results(measured.papers[0]).experiment("one") is None


@pytest.mark.parametrize(
    "work", [Experiment("one", "counting"), JudgedRun("one", TOWN, (ALL,), size=SIZE)]
)
def test_what_a_user_put_into_a_record_stays_and_the_record_is_not_read(work, tmp_path):
    papers = [paper((work,), ()) if isinstance(work, JudgedRun) else paper((), (work,))]
    run(tmp_path, papers, frames=1)
    record = tmp_path / "records" / "toy" / "one"
    (record / "notes.txt").write_text("mine")
    before = content(record)
    measured, _ = run(tmp_path, papers, frames=2)
    assert "'notes.txt', which visref did not write" in measured.failures["toy/one"]
    assert content(record) == before
    results = measured.results(measured.papers[0])
    assert (results.run("one"), results.experiment("one")) == (None, None)


def test_a_violation_stands_in_the_records(tmp_path):
    judged = JudgedRun("first", TOWN, (ALL, NOTHING), size=SIZE)
    measured, _ = run(tmp_path, [paper((judged,), ())], frames=2)
    found = measured.results(measured.papers[0]).run("first")
    assert found.verdict.status == "violation"
    assert found.verdict.cullers[ALL].violations == 0


def test_a_scene_is_generated_once_for_all_runs(tmp_path, monkeypatch):
    run(tmp_path, frames=1)
    scenes = sorted((tmp_path / "scenes").rglob("*.glb"))
    assert len(scenes) == 1
    written = scenes[0].stat().st_mtime_ns
    run(tmp_path, frames=2)
    assert sorted((tmp_path / "scenes").rglob("*.glb")) == scenes
    assert scenes[0].stat().st_mtime_ns == written


def test_back_faces_are_culled_in_the_runs_that_say_so_and_in_no_other(tmp_path):
    both = JudgedRun("both", TOWN, (ALL,), size=SIZE)
    fronts = JudgedRun("fronts", TOWN, (ALL,), size=SIZE, cull_backfaces=True)
    sides = (
        Experiment("two-sided", "sided", TOWN),
        Experiment("one-sided", "sided", TOWN, cull_backfaces=True),
    )
    measured, _ = run(tmp_path, [paper((both, fronts), sides)], frames=1)
    results = measured.results(measured.papers[0])
    assert results.experiment("two-sided") == 0.0
    assert results.experiment("one-sided") > 0.5
    culled = [results.run(key).manifest.settings["cull_backfaces"] for key in ("both", "fronts")]
    assert culled == [False, True]
    digests = {results.run(key).manifest.scene.sha256 for key in ("both", "fronts")}
    assert len(digests) == 2


def test_records_say_what_they_were_asked_for(tmp_path):
    measured, _ = run(tmp_path, frames=2)
    asked = measured.results(measured.papers[0]).run("first").manifest.settings["asked"]
    assert asked["work"] == json.loads(json.dumps(vars(tables_runs.RUNS[0])))
    assert asked["frames"] == 2


def test_no_frames_are_refused(tmp_path):
    with pytest.raises(InputError, match="--frames is 0"):
        run(tmp_path, frames=0)
