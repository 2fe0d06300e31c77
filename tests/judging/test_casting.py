"""The truths of frames that follow are cast while one is judged: where that may be, and with no
effect on what is found."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest

from visref.camera import look_at
from visref.camera_path import CameraPath, Frame
from visref.conformance import suite as conformance
from visref.culler import Culler, DrawnSet, Promise, Recorded
from visref.engines import make_engine
from visref.engines.base import TruthEngine
from visref.errors import InputError
from visref.judging import casting
from visref.judging.asking import Panel
from visref.judging.policy import Policy
from visref.judging.referee import Referee, Sitting
from visref.timeline import Timeline

SCENE, PATH = conformance.case("walk_through_a_city")
FRAMES = range(len(PATH))
# Long enough for a slow machine; nobody waits so long unless something is wrong.
WAIT_S = 20.0


class Watched(TruthEngine):
    """Embree, which notes the thread of each cast, and breaks down at the camera `breaks`."""

    name = "watched"
    ahead = True

    def __init__(self, scene=SCENE, *, ahead=True, breaks=None):
        super().__init__(scene)
        self.ahead, self._breaks = ahead, breaks
        self._inner = make_engine("embree", scene)
        self.threads_of_casts = []
        self.casts = threading.Condition()

    def frame(self, camera):
        with self.casts:
            self.threads_of_casts.append(threading.current_thread())
            self.casts.notify_all()
        if camera is self._breaks:
            raise InputError("the engine broke down")
        return self._inner.frame(camera)

    def pose(self, scene):
        self._inner.pose(scene)

    def begun(self, number):
        """Whether so many casts have begun, or do before long."""
        with self.casts:
            return self.casts.wait_for(lambda: len(self.threads_of_casts) >= number, WAIT_S)


class Half:
    """Draws every other object."""

    name = "half"
    promise = Promise.CONSERVATIVE

    def cull(self, camera):
        return DrawnSet(np.arange(0, SCENE.object_count, 2, dtype=np.int32))


class HalfRecorded(Half, Recorded):
    def seek(self, frame):
        pass


class HalfTimed(Half, Culler):
    pass


class Waits(HalfRecorded):
    """Answers once the next frame's cast has begun."""

    def __init__(self, engine):
        self.engine, self.asked, self.saw = engine, 0, []

    def cull(self, camera):
        self.asked += 1
        if self.asked < len(FRAMES):
            self.saw.append(self.engine.begun(self.asked + 1))
        return super().cull(camera)


class Listening:
    def on_truth(self, frame, truth, seen, ms):
        pass

    def on_verdict(self, job, judged):
        pass

    def on_frame_done(self, frame):
        pass


def run(engine, culler, listeners=(), **more):
    referee = Referee(SCENE, lambda: engine, **more)
    return referee, referee.run(PATH, FRAMES, [("half", culler)], listeners)


def found(outcome):
    """All that a run found, but for its timings."""
    (record,) = outcome.cullers
    return [(one.frame, one.verdict.counts, tuple(one.verdict.misses)) for one in record.frames]


def test_a_recording_is_judged_while_the_next_frame_is_cast():
    engine = Watched()
    culler = Waits(engine)
    run(engine, culler)
    assert culler.saw == [True] * (len(FRAMES) - 1)
    assert len(engine.threads_of_casts) == len(FRAMES)


@pytest.mark.parametrize(
    ("culler", "ahead", "shares_cores", "others"),
    [
        (HalfRecorded, True, False, len(FRAMES) - 1),
        (HalfRecorded, False, False, 0),  # the engine allows it not
        (HalfTimed, True, False, 0),  # its time is measured
        (HalfTimed, True, True, len(FRAMES) - 1),
    ],
)
def test_who_is_timed_has_the_machine_to_itself(culler, ahead, shares_cores, others):
    engine = Watched(ahead=ahead)
    run(engine, culler(), shares_cores=shares_cores)
    here = threading.current_thread()
    assert sum(thread is not here for thread in engine.threads_of_casts) == others


def test_what_is_found_does_not_hang_on_it():
    _, before = run(Watched(ahead=False), HalfRecorded())
    _, ahead = run(Watched(), HalfRecorded())
    assert found(ahead) == found(before)
    assert sum(counts.missed for _, counts, _ in found(before)) > 0


class Borrows(Listening):
    """Lets the engine cast other views between frames, into whichever arrays it likes."""

    def __init__(self):
        self.referee, self.owners = None, []
        self.away = look_at((0.0, 500.0, 0.0), (0.0, 900.0, 0.0), up=(1.0, 0.0, 0.0))

    def on_truth(self, frame, truth, seen, ms):
        self.owners.append(truth.buffer.triangle.copy())

    def on_frame_done(self, frame):
        for _ in range(3):
            sky = self.referee.caster.frame(replace(PATH.cameras[0], world_from_camera=self.away))
            assert (sky.buffer.triangle < 0).all()


def test_the_engine_may_be_borrowed_between_frames():
    borrows = Borrows()
    borrows.referee = Referee(SCENE, Watched)
    borrows.referee.run(PATH, FRAMES, [("half", HalfRecorded())], [borrows])
    engine = make_engine("embree", SCENE)
    assert len(borrows.owners) == len(FRAMES)
    for owners, camera in zip(borrows.owners, PATH.cameras, strict=True):
        assert np.array_equal(owners, engine.frame(camera).buffer.triangle)


@pytest.mark.parametrize("engine", ["embree", "open3d"])
def test_a_truth_is_whole_for_as_long_as_it_is_held(engine):
    if engine == "open3d":
        pytest.importorskip("open3d")
    engine = make_engine(engine, SCENE)
    held = []
    for camera in PATH.cameras:
        truth = engine.frame(camera)
        held.append((truth, truth.buffer.triangle.copy()))
    assert len({owners.tobytes() for _, owners in held}) > 1
    for truth, owners in held:
        assert np.array_equal(truth.buffer.triangle, owners)


class Notes(Listening):
    """Keeps the owners of each view, by frame and view."""

    def __init__(self):
        self.owners = []

    def on_truth(self, frame, truth, seen, ms):
        self.owners.append((frame, truth.camera.view, truth.buffer.triangle.copy()))


def rig(frames):
    """Frames of one, two or three views."""
    views = [
        tuple(
            replace(PATH.cameras[(frame + 2 * number) % len(PATH)], view=f"eye{number}")
            for number in range(1 + frame % 3)
        )
        for frame in range(frames)
    ]
    return CameraPath([Frame(some) for some in views])


@pytest.mark.parametrize("frames", [1, 2, 4, 5, 8, 9, 13, 30])
def test_frames_of_any_number_of_views_are_cast_ahead_each_once(frames):
    path, engine, notes = rig(frames), Watched(), Notes()
    Referee(SCENE, lambda: engine).run(path, range(frames), [("half", HalfRecorded())], [notes])
    expected = [(frame, camera) for frame in range(frames) for camera in path.views(frame)]
    assert len(engine.threads_of_casts) == len(expected)
    alone = make_engine("embree", SCENE)
    for (frame, camera), (at, view, owners) in zip(expected, notes.owners, strict=True):
        assert (frame, camera.view) == (at, view)
        assert np.array_equal(owners, alone.frame(camera).buffer.triangle)


def test_large_frames_are_cast_one_by_one(monkeypatch):
    """So that what is cast ahead does not fill the memory."""
    batches = []
    together = Watched.frames

    def frames(self, cameras):
        batches.append(len(cameras))
        return together(self, cameras)

    monkeypatch.setattr(Watched, "frames", frames)
    run(Watched(), HalfRecorded())
    assert max(batches) == casting.TOGETHER
    batches.clear()
    monkeypatch.setattr(casting, "SAMPLES_TOGETHER", 2 * PATH.cameras[0].samples + 1)
    run(Watched(), HalfRecorded())
    assert max(batches) == 2


def test_arrays_do_not_pile_up_with_the_frames():
    held = []
    for frames in (24, 96):
        engine = make_engine("embree", SCENE)
        path = rig(frames)
        Referee(SCENE, lambda engine=engine: engine).run(
            path, range(frames), [("half", HalfRecorded())]
        )
        held.append(len(engine._memory.unused))
    # As many as frames are cast before they are looked at, a few at a time.
    assert 0 < held[1] <= held[0] + 1 <= 8


def test_a_breakdown_is_told_in_its_frame():
    done = []

    class Counts(Listening):
        def on_frame_done(self, frame):
            done.append(frame)

    with pytest.raises(InputError, match="broke down"):
        run(Watched(breaks=PATH.cameras[2]), HalfRecorded(), [Counts()])
    assert done == [0, 1]


def test_what_moves_is_cast_in_its_own_frame():
    """The engine stands as the scene does in one frame, not in two."""
    door = np.eye(4)
    door[0, 3] = 3.0
    here, there = (
        CameraPath([Frame((PATH.cameras[0],), world_from_object={SCENE.names[0]: pose})] * 2)
        for pose in (np.eye(4), door)
    )
    path = CameraPath([here.frames[0], there.frames[0]])
    timeline = Timeline(SCENE, path)
    assert timeline.moves
    engine = Watched(timeline.still)
    sitting = Sitting(
        path, timeline, Panel([], timeline, Policy()), lambda: engine, shares_cores=True
    )
    sitting.frame(0, [], on_truth=lambda *_: None, on_verdict=lambda *_: None, following=1)
    sitting.close()
    assert len(engine.threads_of_casts) == 1
