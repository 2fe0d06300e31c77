"""What only Python has: blocks that an exception leaves, and objects of any kind."""

from __future__ import annotations

import sys

import pytest

from tests.recorders.calls import EYE, strict_lines
from tests.recorders.languages.base import RECORDERS


@pytest.fixture
def recorder(monkeypatch):
    monkeypatch.syspath_prepend(str(RECORDERS / "python"))
    import visref_recorder

    yield visref_recorder
    sys.modules.pop("visref_recorder")


def frame(r, number: int) -> None:
    r.begin_frame(number)
    r.camera("world_from_camera", EYE)
    r.end_frame()


@pytest.mark.parametrize(
    ("raised", "stopped"),
    [
        (ValueError("the engine's own"), ["frame 3: the program raised ValueError"]),
        # As engines end whose window is closed.
        (SystemExit(0), []),
        (KeyboardInterrupt(), []),
    ],
)
def test_an_exception_is_the_one_to_see_and_an_error_ends_the_recording(
    raised, stopped, recorder, tmp_path
):
    file = tmp_path / "recording.jsonl"
    with pytest.raises(type(raised)) as caught, recorder.Recorder(str(file), 64, 48) as r:
        frame(r, 3)
        raise raised
    assert caught.value is raised
    lines = strict_lines(file.read_bytes())
    assert [line["stopped"] for line in lines[2:]] == stopped
    assert lines[1]["frame"] == 3


def test_an_end_amid_a_frame_is_told(recorder, tmp_path):
    file = tmp_path / "recording.jsonl"
    with pytest.raises(SystemExit), recorder.Recorder(str(file), 64, 48) as r:
        frame(r, 3)
        r.begin_frame(4)
        raise SystemExit
    assert strict_lines(file.read_bytes())[2:] == [{"stopped": "frame 4: it has no end"}]


def test_what_is_told_of_half_a_surrogate_pair_is_unicode(recorder, tmp_path):
    file = tmp_path / "recording.jsonl"
    r = recorder.Recorder(str(file), 64, 48)
    r.begin_frame(0)
    r.camera("\udc80", EYE)
    with pytest.raises(recorder.RecordingError):
        r.close()
    assert strict_lines(file.read_bytes())[1:] == [{"stopped": "frame 0: a camera cannot be a ?"}]


@pytest.mark.parametrize(
    ("call", "got", "told"),
    [
        ("visible", ([None],), "visible got None; ids are whole numbers"),
        ("visible", ([2.0],), "visible got 2.0; ids are whole numbers"),
        ("visible_nodes", (["a"],), "visible_nodes got 'a'; node indices are whole numbers"),
        ("level", ("a", None), "level got None; levels are whole numbers"),
        ("stat", ("queries", 1.5), "stat got 1.5; counts are whole numbers"),
    ],
)
def test_what_is_no_whole_number_is_told_at_the_end_and_raises_nowhere_else(
    call, got, told, recorder, tmp_path
):
    r = recorder.Recorder(str(tmp_path / "recording.jsonl"), 64, 48)
    r.begin_frame(7)
    getattr(r, call)(*got)
    with pytest.raises(recorder.RecordingError, match=f"^frame 7: {told}$"):
        r.close()


def test_closing_again_writes_nothing_more(recorder, tmp_path):
    file = tmp_path / "recording.jsonl"
    r = recorder.Recorder(str(file), 64, 48)
    r.begin_frame(0)
    for _ in range(2):
        with pytest.raises(recorder.RecordingError):
            r.close()
    assert len(strict_lines(file.read_bytes())) == 2
