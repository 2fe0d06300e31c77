"""Scene, path and cullers put together with real engines: verdicts, isolation, records."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from numba.core import event

from tests.support.hand_made import camera, scene_of_squares
from visref.camera_path import CameraPath
from visref.conformance import suite as conformance
from visref.culler import Culler, DrawnSet, Promise, QueryStats, Raster, RasterTolerance
from visref.engines import make_engine
from visref.errors import InputError, NothingToJudge
from visref.exact import ExactScene
from visref.judging.disputes import find_disputes
from visref.judging.holders import DrawList
from visref.judging.judge import judge
from visref.judging.outcome import verdict_json
from visref.judging.referee import Referee
from visref.judging.settle import settle
from visref.judging.status import Exit, Status
from visref.judging.walk import walk_samples
from visref.recordings.truth_file import TruthTable
from visref.recordings.truth_reading import read_truth
from visref.recordings.visible_sets import Replay, read_visible_sets
from visref.run_folder.write import RunWriter, slug
from visref.scene import Alpha, Units
from visref.stopwatch import Stopwatch
from visref.visibility import Doubt, objects_seen

SCENE, PATH = conformance.case("walk_through_a_city")
FRAMES = range(3)
ENGINES = ["embree", "exact"]


class Draws(Culler):
    """Draws what it was told, the same in each frame; everything by default."""

    name = "draws"

    def __init__(self, *ids, promise=Promise.CONSERVATIVE, everything=True):
        self.ids = None if everything and not ids else np.array(ids, np.int32)
        self.promise = promise
        self.closed = 0

    def prepare(self, scene):
        if self.ids is None:
            self.ids = np.arange(scene.object_count, dtype=np.int32)
        return super().prepare(scene)

    def cull(self, camera):
        return DrawnSet(self.ids)

    def close(self):
        self.closed += 1


def nothing(**more):
    return Draws(everything=False, **more)


class Breaks(Draws):
    """Does `then` in place of its second frame."""

    def __init__(self, then, *ids, **more):
        super().__init__(*ids, **more)
        self.then, self.frame = then, 0

    def cull(self, camera):
        self.frame += 1
        return self.then() if self.frame == 2 else super().cull(camera)


def raises():
    raise KeyError("no such tile")


def run(*cullers, engine="exact", path=PATH, frames=FRAMES, listeners=(), **more):
    referee = Referee(SCENE, lambda: make_engine(engine, SCENE), **more)
    named = [(culler.name, culler) for culler in cullers]
    return referee.run(path, frames, named, listeners)


def codes(outcome, spec=None):
    return [f.code for f in outcome.findings if spec is None or f.culler == spec]


@pytest.mark.parametrize("engine", ENGINES)
def test_culler_that_draws_everything_is_safe_and_superfluous(engine):
    outcome = run(Draws(), engine=engine)
    totals = outcome.cullers[0].totals
    assert outcome.exit is Exit.NO_VIOLATION
    assert (totals.missed, totals.missed_pixels, totals.violations) == (0, 0, 0)
    assert totals.drawn == SCENE.object_count * len(FRAMES)
    assert totals.superfluous == totals.drawn - totals.visible > 0


@pytest.mark.parametrize("engine", ENGINES)
def test_culler_that_draws_nothing_is_a_violation_in_every_frame(engine):
    outcome = run(nothing(), engine=engine)
    assert outcome.exit is Exit.VIOLATION
    frames = outcome.cullers[0].frames
    assert [record.frame for record in frames] == list(FRAMES)
    for record in frames:
        counts = record.verdict.counts
        assert counts.violations == counts.visible > 0
        owned = np.count_nonzero(
            make_engine("exact", SCENE).frame(PATH.cameras[record.frame]).buffer.triangle >= 0
        )
        assert counts.missed_pixels == owned


def test_visible_objects_alone_are_safe_and_one_less_is_not():
    engine = make_engine("exact", SCENE)
    seen = np.flatnonzero(objects_seen(engine.frame(PATH.cameras[0]), SCENE).visible)
    outcome = run(Draws(*seen), Draws(*seen[1:]), frames=[0])
    first, second = (record.totals for record in outcome.cullers)
    assert (first.missed, first.superfluous) == (0, 0)
    assert (second.missed, second.violations) == (1, 1)
    assert outcome.cullers[1].frames[0].verdict.misses[0].object == seen[0]


def test_embree_and_exact_engine_lead_to_the_same_misses():
    """Disputed samples are settled exactly, so the engine does not show."""
    leaves_out = [Draws(*np.arange(0, SCENE.object_count, 2)) for _ in ENGINES]
    found = []
    for culler, engine in zip(leaves_out, ENGINES, strict=True):
        (record,) = run(culler, engine=engine).cullers
        found.append(
            [
                sorted((miss.object, miss.kind, miss.owned) for miss in frame.verdict.misses)
                for frame in record.frames
            ]
        )
    assert found[0] == found[1]
    assert all(found[0])


def test_approximate_culler_is_measured_and_not_convicted():
    outcome = run(nothing(promise=Promise.APPROXIMATE))
    totals = outcome.cullers[0].totals
    assert outcome.exit is Exit.NO_VIOLATION
    assert outcome.cullers[0].status is outcome.status is Status.MEASURED
    assert (totals.violations, totals.confirmed) == (0, totals.visible)
    assert set(codes(outcome)) == {"MISSED_DECLARED"}


def test_promise_settled_while_preparing_is_the_one_that_counts():
    class Settles(Draws):
        def prepare(self, scene):
            self.promise = Promise.AGGRESSIVE
            return super().prepare(scene)

    assert run(Settles(0)).cullers[0].promise is Promise.AGGRESSIVE


@pytest.mark.slow
@pytest.mark.parametrize(
    ("then", "told"),
    [
        (raises, "KeyError: 'no such tile'"),
        (lambda: None, "cull() returned no DrawnSet"),
        (lambda: DrawnSet(np.array([0.5])), "unit_ids is not a list of integers"),
        (lambda: DrawnSet(np.array([[0]])), "unit_ids is not a list of integers"),
        (lambda: DrawnSet(np.array([-1])), "a unit id is outside 0…36"),
        (lambda: DrawnSet(np.array([37])), "a unit id is outside 0…36"),
        (lambda: DrawnSet(np.array([3, 3])), "a unit is drawn twice"),
    ],
)
def test_culler_that_breaks_down_stops_alone_and_is_inconclusive(then, told):
    broken, sound, missing = Breaks(then), Draws(), nothing()
    broken.name = "broken"
    outcome = run(broken, sound, missing)
    record = outcome.cullers[0]
    assert record.failed
    assert [frame.frame for frame in record.frames] == [0]
    assert record.exit is Exit.NOTHING_JUDGED
    (failure,) = [f for f in outcome.findings if f.code == "CULLER_FAILED"]
    assert (failure.culler, failure.frame) == ("broken", 1)
    assert told in failure.message
    # The others are judged as if they were alone.
    alone = run(Draws(), nothing())
    assert [r.totals for r in outcome.cullers[1:]] == [r.totals for r in alone.cullers]
    assert [r.exit for r in outcome.cullers[1:]] == [Exit.NO_VIOLATION, Exit.VIOLATION]
    assert [c.closed for c in (broken, sound, missing)] == [1, 1, 1]


def test_violation_before_the_breakdown_stands():
    outcome = run(Breaks(raises, everything=False))
    assert outcome.cullers[0].failed
    assert outcome.exit is Exit.VIOLATION


def test_culler_that_cannot_prepare_stops_alone():
    class Refuses(Draws):
        def prepare(self, scene):
            raise MemoryError("too many triangles")

    refuses = Refuses()
    outcome = run(refuses, Draws())
    assert [r.exit for r in outcome.cullers] == [Exit.NOTHING_JUDGED, Exit.NO_VIOLATION]
    assert "MemoryError: too many triangles" in [f.message for f in outcome.findings]
    assert refuses.closed == 1


def test_culler_that_cannot_close_is_told_and_the_others_are_closed():
    class Clings(Draws):
        def close(self):
            raise OSError("still in use")

    sound = Draws()
    outcome = run(Clings(), sound)
    assert [r.exit for r in outcome.cullers] == [Exit.NOTHING_JUDGED, Exit.NO_VIOLATION]
    assert len(outcome.cullers[0].frames) == len(FRAMES)
    assert "OSError: still in use" in [f.message for f in outcome.findings]
    assert sound.closed == 1


def test_method_without_gl_is_reported_and_the_others_go_on():
    class NeedsGL(Draws):
        def prepare(self, scene):
            raise NothingToJudge("no OpenGL context can be made")

    outcome = run(NeedsGL(), Draws())
    assert [r.exit for r in outcome.cullers] == [Exit.NOTHING_JUDGED, Exit.NO_VIOLATION]
    assert outcome.findings[0].code == "NO_GL"
    assert outcome.exit is Exit.NOTHING_JUDGED


@pytest.mark.parametrize("when", ["prepare", "cull"])
def test_bad_input_that_a_culler_finds_ends_the_run_and_closes_everything(when):
    def bad():
        raise InputError("frame 1 is missing", source="visible.jsonl")

    culler = Breaks(bad)
    if when == "prepare":
        culler.prepare = lambda scene: bad()
    others = [Draws(), Draws()]
    with pytest.raises(InputError, match=r"visible\.jsonl: frame 1 is missing"):
        run(others[0], culler, others[1])
    assert [c.closed for c in (culler, *others)] == [1, 1, 1]


def test_cullers_of_one_name_are_told_apart():
    outcome = run(Draws(), nothing(), Draws(0))
    assert [r.spec for r in outcome.cullers] == ["draws", "draws#2", "draws#3"]
    assert {f.culler for f in outcome.findings if f.code == "MISSED_OBJECT"} == {
        "draws#2",
        "draws#3",
    }


def test_units_that_overlap_or_lack_triangles_are_judged_by_their_triangles():
    class ByParity(Draws):
        """Two units: all triangles, and every other one again."""

        def prepare(self, scene):
            every = np.arange(scene.triangle_count, dtype=np.int32)
            parts = [every, every[::2]]
            return Units(np.cumsum([0, *map(len, parts)]), np.concatenate(parts), "part")

    outcome = run(ByParity(0), ByParity(1), ByParity(0, 1))
    whole, half, both = (record.totals for record in outcome.cullers)
    assert (whole.missed_pixels, both.missed_pixels) == (0, 0)
    assert (whole.drawn, both.drawn) == (len(FRAMES), 2 * len(FRAMES))
    # Half of each box still shows some of it, and loses samples.
    assert half.missed_pixels > half.missed
    assert outcome.cullers[0].unit_kind == "part"


def test_run_without_a_visible_object_is_vacuous():
    scene, path = conformance.case("empty_scene")
    outcome = Referee(scene, lambda: make_engine("exact", scene)).run(
        path, range(len(path)), [("draws", Draws())]
    )
    assert outcome.exit is Exit.NOTHING_JUDGED
    assert codes(outcome) == ["NOTHING_JUDGED"]
    assert run(Draws(), frames=[]).exit is Exit.NOTHING_JUDGED


def test_run_without_cullers_is_the_truth_alone_and_violates_nothing():
    assert run().exit is Exit.NO_VIOLATION


def test_only_the_asked_frames_are_judged_in_the_order_asked():
    seen = []

    class Watches(Draws):
        def cull(self, camera):
            seen.append(camera)
            return super().cull(camera)

    outcome = run(Watches(), frames=[4, 1])
    assert [record.frame for record in outcome.cullers[0].frames] == [4, 1]
    asked = [PATH.cameras[4], PATH.cameras[1]]
    assert [camera.definition() for camera in seen] == [camera.definition() for camera in asked]


def test_blind_spots_are_told_for_every_engine_but_the_exact_one():
    assert "ENGINE_BLIND_SPOTS" in codes(run(Draws(), engine="embree"))
    assert "ENGINE_BLIND_SPOTS" not in codes(run(Draws(), engine="exact"))


def test_image_check_is_reported_and_changes_no_status():
    class Differs:
        def pixels_differ(self, camera, drawn):
            assert drawn.shape == (SCENE.triangle_count,)
            return 0 if drawn.all() else 7

    outcome = run(Draws(), nothing(promise=Promise.APPROXIMATE), image_check=Differs())
    assert [r.exit for r in outcome.cullers] == [Exit.NO_VIOLATION] * 2
    (found,) = [f for f in outcome.findings if f.code == "IMAGE_DIFFERS"]
    assert (found.culler, found.message) == ("draws#2", "21 pixels over 3 frames")


def test_time_of_cull_is_measured_by_the_referee_unless_the_culler_says_more():
    class Timed(Draws):
        def cull(self, camera):
            return DrawnSet(self.ids, QueryStats(queries=3, ms={"cull": 123.0, "query": 1.0}))

    plain, timed = run(Draws(), Timed()).cullers
    assert plain.frames[0].stats.ms["cull"] > 0.0
    assert timed.frames[0].stats.ms == {"cull": 123.0, "query": 1.0}


def test_answers_that_were_recorded_have_the_times_that_are_recorded_with_them(tmp_path):
    lines = [
        {"frame": 0, "visible": [0]},
        {"frame": 1, "visible": [0], "stats": {"ms": {"cull": 7.5}}},
        {"frame": 2, "visible": [0], "stats": {"ms": {"sort": 1.0}}},
    ]
    file = tmp_path / "visible.jsonl"
    file.write_text("\n".join(map(json.dumps, lines)))
    replay = Replay(read_visible_sets(file, SCENE, FRAMES, PATH), PATH)
    folder = tmp_path / "run"
    folder.mkdir()
    writer = RunWriter(folder, SCENE, PATH, engine="exact", settings={})
    run(replay, Draws(), listeners=[writer])
    rows = writer_timings(writer)
    assert [r for r in rows if r[0] == "replay"] == [
        ("replay", 1, "cull", 7.5),
        ("replay", 1, "first_call", 7.5),
        ("replay", 2, "sort", 1.0),
    ]
    # A culler that is called has a time in every frame, and its first call is marked.
    times = [r[1:3] for r in rows if r[0] == "draws"]
    first, *others = FRAMES
    assert times == [(first, "cull"), (first, "first_call"), *((f, "cull") for f in others)]


def writer_timings(writer):
    return [(r["culler"], r["frame"], r["phase"], r["ms"]) for r in writer._timings]


def test_compiling_is_no_frames_time(monkeypatch):
    clock = [0.0]

    def compiled_and(answer):
        """What takes an hour to compile, and a second to run."""
        event.start_event("numba:compiler_lock")
        clock[0] += 3600.0
        event.end_event("numba:compiler_lock")
        clock[0] += 1.0
        return answer

    class Compiles(Draws):
        def cull(self, camera):
            return compiled_and(super().cull(camera))

    engine, told = make_engine("exact", SCENE), []
    cast = engine.frame
    engine.frame = lambda camera: compiled_and(cast(camera))

    class Listens(Diary):
        def on_truth(self, frame, truth, seen, ms):
            told.append(ms)

    for module in ("casting", "asking"):
        monkeypatch.setattr(
            f"visref.judging.{module}.Stopwatch", lambda: Stopwatch(clock=lambda: clock[0])
        )
    outcome = Referee(SCENE, lambda: engine).run(
        PATH, FRAMES, [("compiles", Compiles())], [Listens()]
    )
    assert told == pytest.approx([1000.0] * len(FRAMES))
    for frame in outcome.cullers[0].frames:
        assert frame.stats.ms["cull"] == pytest.approx(1000.0)


class Diary:
    """A listener that writes down what it is told."""

    def __init__(self):
        self.entries = []

    def on_truth(self, frame, truth, seen, ms):
        self.entries.append(("truth", frame))

    def on_verdict(self, job, judged):
        self.entries.append((job.spec, judged.record.frame, bool(judged.settled)))

    def on_frame_done(self, frame):
        self.entries.append(("done", frame))


def test_truth_is_cast_once_a_frame_and_told_before_its_verdicts():
    diary = Diary()
    run(Draws(), nothing(), listeners=[diary], frames=[0, 1])
    per_frame = [("truth", 0), ("draws", 0, True), ("draws#2", 0, True), ("done", 0)]
    assert diary.entries == per_frame + [(e[0], 1, *e[2:]) for e in per_frame]


# A recorded truth.


def recorded(tmp_path, engine="exact", frames=FRAMES):
    table, caster = TruthTable(SCENE), make_engine(engine, SCENE)
    for frame in frames:
        truth = caster.frame(PATH.cameras[frame])
        table.add(frame, truth.camera.width, objects_seen(truth, SCENE))
    file = tmp_path / "truth.parquet"
    table.write(file, engine=engine, path=PATH, ties_complete=truth.ties_complete)
    return read_truth(file, SCENE, PATH, frames)


def comparable(outcome):
    """All of an outcome but the times, as values."""
    return [
        (
            record.spec,
            record.exit,
            [(f.frame, f.verdict.counts, f.verdict.misses) for f in record.frames],
            [f.verdict.superfluous_units.tolist() for f in record.frames],
        )
        for record in outcome.cullers
    ]


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("seed", range(4))
def test_recorded_truth_gives_the_verdict_that_casting_gives(tmp_path, engine, seed):
    rng = np.random.default_rng(seed)
    chosen = [np.flatnonzero(rng.random(SCENE.object_count) < p) for p in (0.5, 0.9, 0.98)]
    visible = recorded(tmp_path, engine)
    every = np.unique(np.concatenate([rows.objects for rows in visible.frames.values()]))

    def cullers():
        return [Draws(), nothing(), Draws(*every), *(Draws(*ids) for ids in chosen)]

    cast = run(*cullers(), engine=engine)
    recalled = run(*cullers(), engine=engine, recorded=visible)
    assert comparable(recalled) == comparable(cast)
    assert {record.exit for record in cast.cullers} == {Exit.NO_VIOLATION, Exit.VIOLATION}


def test_recorded_truth_with_nothing_to_dispute_builds_no_engine(tmp_path):
    def no_engine():
        raise AssertionError("an engine was built")

    visible = recorded(tmp_path)
    diary = Diary()
    referee = Referee(SCENE, no_engine, recorded=visible, examine=True)
    outcome = referee.run(PATH, FRAMES, [("all", Draws())], [diary])
    assert outcome.exit is Exit.NO_VIOLATION
    assert [entry[0] for entry in diary.entries] == ["all", "done"] * len(FRAMES)
    assert not any(entry[2] for entry in diary.entries if entry[0] == "all")
    with pytest.raises(AssertionError, match="an engine was built"):
        Referee(SCENE, no_engine, recorded=visible).run(PATH, FRAMES, [("none", nothing())])


def test_recorded_truth_of_units_that_are_no_objects_is_looked_at_by_sample(tmp_path):
    class ByTriangle(Draws):
        def prepare(self, scene):
            count = scene.triangle_count
            self.ids = np.arange(1, count, dtype=np.int32)
            return Units(np.arange(count + 1), np.arange(count, dtype=np.int32), "triangle")

    visible = recorded(tmp_path)
    cast, recalled = run(ByTriangle()), run(ByTriangle(), recorded=visible)
    assert comparable(recalled) == comparable(cast)


def superfluous_of(frames=FRAMES):
    """Of `Draws()`: how many objects with triangles are no owner, by a census of exact truths."""
    engine, total = make_engine("exact", SCENE), 0
    for frame in frames:
        seen = objects_seen(engine.frame(PATH.cameras[frame]), SCENE)
        total += np.count_nonzero(~seen.visible & (SCENE.object_units().sizes > 0))
    return total


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("recall", [False, True])
@pytest.mark.parametrize(
    ("promise", "kept_to", "forbidden"),
    [
        (Promise.CONSERVATIVE, {"draws": Exit.NO_VIOLATION, "draws#2": Exit.VIOLATION}, 0),
        (Promise.EXACT, {"draws": Exit.VIOLATION, "draws#2": Exit.VIOLATION}, 1),
        (Promise.AGGRESSIVE, {"draws": Exit.VIOLATION, "draws#2": Exit.NO_VIOLATION}, 1),
        (Promise.APPROXIMATE, {"draws": Exit.NO_VIOLATION, "draws#2": Exit.NO_VIOLATION}, 0),
    ],
)
def test_drawing_what_is_hidden_convicts_where_the_promise_forbids_it(
    tmp_path, engine, recall, promise, kept_to, forbidden
):
    more = {"recorded": recorded(tmp_path, engine)} if recall else {}
    outcome = run(Draws(promise=promise), nothing(promise=promise), engine=engine, **more)
    assert {record.spec: record.exit for record in outcome.cullers} == kept_to
    everything = outcome.cullers[0].totals
    assert everything.superfluous_confirmed == forbidden * superfluous_of()
    assert everything.superfluous == superfluous_of() > 0
    assert everything.violations == everything.superfluous_confirmed
    assert ("DRAWN_HIDDEN" in codes(outcome, "draws")) == bool(forbidden)
    for record in outcome.cullers[0].frames:
        confirmed = [one.unit for one in record.verdict.confirmed_superfluous]
        assert confirmed == (record.verdict.superfluous_units.tolist() if forbidden else [])


@pytest.mark.parametrize("promise", Promise)
def test_drawing_the_visible_alone_keeps_every_promise_and_builds_no_engine(tmp_path, promise):
    def no_engine():
        raise AssertionError("an engine was built")

    visible = recorded(tmp_path, frames=[0])
    ids = visible.frames[0].objects
    referee = Referee(SCENE, no_engine, recorded=visible)
    outcome = referee.run(PATH, [0], [("all", Draws(*ids, promise=promise))])
    (record,) = outcome.cullers
    assert record.exit is Exit.NO_VIOLATION
    assert (record.totals.superfluous, record.totals.violations) == (0, 0)


# Records.


def recording(folder, *cullers, recalled=None, superfluous_rows=False):
    folder.mkdir()
    recorder = RunWriter(
        folder,
        SCENE,
        PATH,
        engine="exact",
        settings={"frames": "0:3"},
        picture_frames=[1],
        superfluous_rows=superfluous_rows,
    )
    outcome = run(*cullers, listeners=[recorder], recorded=recalled)
    recorder.finish(outcome)
    return outcome


def half():
    return Draws(*range(0, SCENE.object_count, 2))


@pytest.mark.parametrize("all_rows", [False, True])
def test_run_folder_holds_what_the_run_found(tmp_path, all_rows):
    folder = tmp_path / "run"
    outcome = recording(folder, Draws(), half(), superfluous_rows=all_rows)
    verdict = json.loads((folder / "verdict.json").read_text())
    expected = json.loads(json.dumps(verdict_json(outcome, SCENE)))
    expected["cullers"]["draws#2"]["worst"]["view"] = ""
    assert verdict == {"version": 2, **expected}
    assert (verdict["status"], verdict["exit_status"]) == ("violation", 1)
    rows = pq.read_table(folder / "frames.parquet").to_pylist()
    assert [(row["culler"], row["frame"]) for row in rows] == [
        (spec, frame) for frame in FRAMES for spec in ("draws", "draws#2")
    ]
    for record in outcome.cullers:
        own = [row for row in rows if row["culler"] == record.spec]
        for name, total in vars(record.totals).items():
            assert sum(row[name] for row in own) == total == verdict["cullers"][record.spec][name]
    objects = pq.read_table(folder / "objects.parquet").to_pylist()
    for record in outcome.cullers:
        own = [row for row in objects if row["culler"] == record.spec]
        kinds = [row["kind"] for row in own]
        assert kinds.count("confirmed") == record.totals.confirmed
        # What was drawn for nothing is listed in the frames picked for pictures, or in all.
        of_frame = {
            row["frame"]: row["superfluous"] for row in rows if row["culler"] == record.spec
        }
        assert of_frame[0] > 0 < of_frame[1]
        for frame, counted in of_frame.items():
            listed = [r for r in own if r["frame"] == frame and r["kind"] == "superfluous"]
            assert len(listed) == (counted if all_rows or frame == 1 else 0)
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["scene"]["sha256"] == SCENE.digest
    assert manifest["samples"] == [{"": camera.definition()} for camera in PATH]
    assert manifest["settings"] == {"frames": "0:3"}


def test_recorded_witness_owns_its_sample_and_was_not_drawn(tmp_path):
    folder = tmp_path / "run"
    outcome = recording(folder, half())
    (file,) = (folder / "witnesses").iterdir()
    witnesses = [json.loads(line) for line in file.read_text().splitlines()]
    assert len(witnesses) == outcome.cullers[0].totals.missed > 0
    engine = make_engine("exact", SCENE)
    for witness in witnesses:
        camera = PATH.cameras[witness["frame"]]
        truth = engine.frame(camera)
        owner = truth.buffer.triangle[witness["y"], witness["x"]]
        assert SCENE.object_of_triangle[owner] == witness["object"]
        assert truth.buffer.depth[witness["y"], witness["x"]] == witness["depth"]
        assert witness["object"] % 2 == 1
        assert witness["samples"] == camera.definition()
        (own,) = [t for t in witness["triangles"] if t["triangle"] == witness["triangle"]]
        corners = SCENE.vertices[SCENE.triangles[witness["triangle"]]]
        assert [[float.fromhex(v) for v in p] for p in own["vertices"]] == corners.tolist()


def test_two_runs_write_the_same_bytes_but_for_the_times(tmp_path):
    for name in ("a", "b"):
        recording(tmp_path / name, Draws(), half())
    files = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*"))
    assert files == sorted(p.relative_to(tmp_path / "b") for p in (tmp_path / "b").rglob("*"))
    for file in files:
        if (tmp_path / "a" / file).is_file() and file.name != "timings.parquet":
            first, second = ((tmp_path / name / file).read_bytes() for name in ("a", "b"))
            assert first == second, file


def test_truth_of_a_run_serves_the_next(tmp_path):
    first = recording(tmp_path / "first", Draws(), half())
    recalled = read_truth(tmp_path / "first" / "truth.parquet", SCENE, PATH, FRAMES)
    assert (recalled.engine, recalled.exact) == ("exact", True)
    second = recording(tmp_path / "second", Draws(), half(), recalled=recalled)
    assert comparable(second) == comparable(first)
    # It was not cast whole, so it is not written again.
    assert not (tmp_path / "second" / "truth.parquet").exists()


def test_drawing_a_subset_disputes_exactly_the_samples_of_the_rest():
    truth = make_engine("exact", SCENE).frame(PATH.cameras[0])
    owner = truth.buffer.triangle.reshape(-1)
    drawn = np.arange(SCENE.triangle_count) % 3 > 0
    disputed = find_disputes(walk_samples(truth, SCENE, drawn))
    undrawn = np.flatnonzero((owner >= 0) & ~drawn[owner])
    tied = truth.ties.sample[drawn[truth.ties.triangle]]
    assert disputed.tolist() == np.setdiff1d(undrawn, tied).tolist()


def test_path_of_one_frame_is_a_path():
    assert run(Draws(), path=CameraPath(PATH.cameras[:1]), frames=[0]).exit is Exit.NO_VIOLATION


class Halves(Culler):
    """Units that are no objects, though nobody says so: two a triangle list, one drawn."""

    name = "halves"

    def prepare(self, scene):
        count = scene.triangle_count
        return Units(np.arange(count + 1), np.arange(count, dtype=np.int32))

    def cull(self, camera):
        return DrawnSet(np.arange(SCENE.triangle_count, dtype=np.int32))


def test_units_that_are_no_objects_are_not_named_as_objects(tmp_path):
    record = recording(tmp_path / "run", Halves())
    assert record.cullers[0].unit_kind == "unit"
    rows = pq.read_table(tmp_path / "run" / "objects.parquet").to_pylist()
    assert rows
    assert {(row["object"], row["name"]) for row in rows} == {(-1, None)}
    assert max(row["unit"] for row in rows) >= SCENE.object_count


@pytest.mark.parametrize(
    "stats",
    [
        QueryStats(queries=1 << 63),
        QueryStats(queries=-1),
        QueryStats(queries=1.5),
        QueryStats(ms={"cull": float("nan")}),
        QueryStats(ms={"cull": "1"}),
        None,
    ],
    ids=["too large", "negative", "a fraction", "NaN ms", "ms as text", "none"],
)
def test_stats_that_no_record_can_hold_stop_the_culler_alone(stats, tmp_path):
    class Boasts(Draws):
        name = "boasts"

        def cull(self, camera):
            return DrawnSet(self.ids, stats)

    outcome = recording(tmp_path / "run", Boasts(), Draws())
    assert [record.exit for record in outcome.cullers] == [Exit.NOTHING_JUDGED, Exit.NO_VIOLATION]
    assert codes(outcome, "boasts") == ["CULLER_FAILED"]


def test_stats_of_one_frame_do_not_change_with_the_next(tmp_path):
    class Counts(Draws):
        stats = QueryStats(queries=0)

        def cull(self, camera):
            self.stats.queries += 1
            return DrawnSet(self.ids, self.stats)

    outcome = recording(tmp_path / "run", Counts())
    frames = outcome.cullers[0].frames
    assert [row.stats.queries for row in frames] == [1, 2, 3]
    assert len({row.stats.ms["cull"] for row in frames}) > 1


@pytest.mark.parametrize(
    "picture",
    [
        lambda camera: 1 / 0,
        lambda camera: np.zeros((1, 1), np.int32),
        lambda camera: np.full((camera.height, camera.width), SCENE.triangle_count),
        lambda camera: np.zeros((camera.height, camera.width)),
    ],
    ids=["raises", "wrong size", "unknown triangle", "floats"],
)
def test_rasteriser_without_a_proper_picture_stops_its_culler_alone(picture):
    class Painted(Raster):
        # Half a pixel of snap excuses every small object, if the picture lacks it.
        tolerance = RasterTolerance(0.5)

        def item_buffer(self, camera):
            return picture(camera)

    culprit = nothing()
    culprit.raster = Painted()
    outcome = run(culprit, Draws())
    assert "CULLER_FAILED" in codes(outcome, "draws")
    assert [record.exit for record in outcome.cullers] == [Exit.NOTHING_JUDGED, Exit.NO_VIOLATION]


def test_a_promise_that_is_none_is_its_culler_s_fault_alone():
    broken, sound = Draws(promise="perfect"), Draws()
    broken.name = "broken"
    outcome = run(broken, sound)
    assert [record.failed for record in outcome.cullers] == [True, False]
    (told,) = [finding for finding in outcome.findings if finding.code == "CULLER_FAILED"]
    assert told.culler == "broken"
    assert "it promises 'perfect'" in told.message


def test_masked_triangle_that_the_ray_engine_overlooked_convicts_nobody():
    squares = scene_of_squares(0.0, -1.0)
    scene = replace(squares, alpha=np.repeat(np.array([Alpha.MASK, Alpha.OPAQUE], np.uint8), 2))
    exact = ExactScene(scene)
    true = exact.certify(camera())
    assert len(true.undecided) == camera().samples
    # As a float32 engine would have it whose rays slipped through the leaf.
    slipped = replace(true, ties_complete=False, doubt=Doubt())
    drawn = DrawList.of_units(scene, scene.object_units(), np.array([0], np.int32))
    settled = settle(scene, slipped, drawn, exact=lambda: exact)
    found = judge(settled, Promise.CONSERVATIVE)
    assert (found.counts.missed, found.counts.undecided) == (0, 1)
    assert found.counts.undecided_samples == found.counts.owned_samples == camera().samples


def test_two_specs_never_share_a_file_name():
    specs = ["a:b=1", "a:b,1", "a_b_1", "x" * 300, "x" * 301, "plain"]
    names = [slug(spec) for spec in specs]
    assert len(set(names)) == len(specs)
    assert max(map(len, names)) < 100
    assert slug("plain") == "plain"
