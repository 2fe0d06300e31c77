"""A run that ends in between leaves its finished frames, and the same command goes on with them to
the bytes of a run that nobody interrupted."""

from __future__ import annotations

import json
import os
import shutil
from contextlib import contextmanager

import pytest

from tests.cli.test_cli import write_scene
from tests.merging.scenes import FRAMES, Forgets, cullers, stereo, switched
from tests.merging.test_merge import POLICIES
from tests.merging.test_workers import making
from tests.support.same_bytes import differing
from visref import beside, kept, shares
from visref.cli.main import main
from visref.errors import InputError
from visref.runs import judge_to_folder, truth_to_file
from visref.workers import judging_at_once

COMMAND = {"scene": "squares", "cullers": "some"}


@pytest.fixture(autouse=True)
def _each_frame_is_a_part(monkeypatch):
    monkeypatch.setattr(kept, "PART_S", 0.0)
    # However long it takes to write them.
    monkeypatch.setattr(shares, "_WRITING", float("inf"))


class _Stopped(Exception):
    """Nothing goes on after this."""


def going(out, kind, workers=1, inputs=switched, stop_after=None, command=COMMAND, **given):
    """Judge, until so many frames are told; the frames that were told, and how many there were
    before."""
    told = []

    def on_frame(frame):
        told.append(frame)
        if len(told) == stop_after:
            raise _Stopped

    run = judging_at_once(inputs(), making(kind), out, workers=workers, command=command, **given)
    try:
        with run as under_way:
            before = under_way.before
            under_way.finish(on_frame)
    except _Stopped:
        pass
    return told, before


def parts_of(out):
    """The folders of the parts that are kept for a run folder."""
    (folder,) = out.parent.glob(f"{beside.PREFIX}*")
    return sorted((folder / beside.PARTS).iterdir())


@pytest.mark.parametrize(
    ("kind", "workers", "inputs", "policy"),
    [
        ("objects", 1, switched, "no policy"),
        ("objects", 1, switched, "late"),
        ("objects", 3, switched, "waived"),
        ("broken", 1, switched, "late"),
        ("broken", 2, switched, "late"),
        ("units", 1, switched, "waived"),
        ("views", 1, stereo, "late"),
        ("views", 2, stereo, "late"),
    ],
)
def test_a_run_that_was_stopped_goes_on_to_the_same_bytes(kind, workers, inputs, policy, tmp_path):
    given = {"policy": POLICIES[policy], "pictures": 2}
    judge_to_folder(inputs(), cullers(kind), tmp_path / "whole", **given)
    out, frames = tmp_path / "run", set(inputs().frames)
    known = 0
    # Once more than there are workers: some worker has gone on, and kept what it told before.
    for stop_after in (workers + 1, workers + 2, None):
        told, before = going(out, kind, workers, inputs, stop_after=stop_after, **given)
        assert before >= known
        assert len(told) <= len(frames) - before
        if (out / "manifest.json").exists():
            # It came to its end before it was stopped.
            break
        known = before + 1
    assert differing(tmp_path / "whole", out) == []
    assert sorted(os.listdir(tmp_path)) == ["run", "whole"]


@pytest.mark.parametrize("kind", ["objects", "units"])
def test_a_run_by_a_truth_file_goes_on(kind, tmp_path):
    truth = tmp_path / "truth.parquet"
    truth_to_file(switched(), truth)
    given = {"policy": POLICIES["late"], "truth": truth}
    judge_to_folder(switched(), cullers(kind), tmp_path / "whole", **given)
    going(tmp_path / "run", kind, stop_after=5, **given)
    assert not list(parts_of(tmp_path / "run")[0].glob("truth.parquet"))
    assert going(tmp_path / "run", kind, **given)[1] == 4
    assert differing(tmp_path / "whole", tmp_path / "run") == []


def test_parts_that_nobody_interrupted_are_the_run_too(tmp_path):
    judge_to_folder(switched(), cullers("objects"), tmp_path / "whole", pictures=2)
    told, _ = going(tmp_path / "run", "objects", pictures=2)
    assert told == list(range(FRAMES))
    assert differing(tmp_path / "whole", tmp_path / "run") == []


def test_a_short_run_is_written_once(tmp_path, monkeypatch):
    monkeypatch.setattr(kept, "PART_S", 60.0)

    def nothing_to_merge(*given):
        raise AssertionError

    monkeypatch.setattr("visref.workers.merge_naming", nothing_to_merge)
    judge_to_folder(switched(), cullers("units"), tmp_path / "whole", pictures=2)
    going(tmp_path / "run", "units", pictures=2)
    assert differing(tmp_path / "whole", tmp_path / "run") == []
    assert sorted(os.listdir(tmp_path)) == ["run", "whole"]


def test_cullers_that_are_asked_again_are_so_once_a_worker_is_through(tmp_path):
    judge_to_folder(
        switched(), cullers("objects"), tmp_path / "whole", repeat=2, anew=making("objects")
    )
    going(tmp_path / "run", "objects", stop_after=3, repeat=2)
    assert os.listdir(tmp_path) == ["whole"]
    going(tmp_path / "run", "objects", 3, repeat=2)
    assert differing(tmp_path / "whole", tmp_path / "run") == []


def test_another_command_is_refused_by_name_and_what_is_kept_stays(tmp_path):
    out = tmp_path / "run"
    going(out, "objects", stop_after=4)
    held = parts_of(out)
    for command in ({**COMMAND, "scene": "circles"}, {**COMMAND, "policy": "one"}):
        (other,) = {name for name in command if command[name] != COMMAND.get(name)}
        with pytest.raises(InputError, match=f"3 frames of another command.*its {other} was") as no:
            going(out, "objects", command=command)
        assert str(no.value.source) == str(held[0].parent.parent)
        assert parts_of(out) == held
    shutil.rmtree(held[0].parent.parent)
    assert going(out, "objects", command={**COMMAND, "scene": "circles"})[1] == 0


def test_another_run_folder_beside_it_neither_uses_nor_removes_what_is_kept(tmp_path):
    going(tmp_path / "run", "objects", stop_after=4)
    held = parts_of(tmp_path / "run")
    assert going(tmp_path / "other", "units", command={})[1] == 0
    assert parts_of(tmp_path / "run") == held


def test_an_end_before_anything_is_finished_leaves_nothing(tmp_path):
    going(tmp_path / "run", "objects", stop_after=1)
    assert os.listdir(tmp_path) == []


def _truncated(part):
    file = part / "objects.parquet"
    file.write_bytes(file.read_bytes()[:-7])


def _changed(part):
    file = part / "verdict.json"
    file.write_text(file.read_text().replace("violation", "violatioN"))


def _sealed_anew(part):
    """What a seal cannot tell: it was made for what stands there."""
    _changed(part)
    seal = json.loads((part / kept.SEAL).read_text())
    seal["files"]["verdict.json"] = kept._digest(part / "verdict.json")
    (part / kept.SEAL).write_text(json.dumps(seal))


def _of_another_place(part):
    part.rename(part.with_name("00000004-00000005"))


def _overlapping(part):
    shutil.copytree(part, part.with_name("00000000-00000002"))


def _a_link(part):
    part.rename(part.parent.parent / "elsewhere")
    part.symlink_to(part.parent.parent / "elsewhere")


def _linked_file(part):
    other = part.parent.parent.parent / "outside.json"
    shutil.copy(part / "verdict.json", other)
    (part / "verdict.json").unlink()
    (part / "verdict.json").symlink_to(other)


def _a_pipe(part):
    (part / "verdict.json").unlink()
    os.mkfifo(part / "verdict.json")


def _not_sealed(part):
    (part / kept.SEAL).unlink()


def _odd_seal(part):
    (part / kept.SEAL).write_text('{"command": 1e999}')


@pytest.mark.parametrize(
    ("spoil", "judged", "named"),
    [
        (_truncated, 1, "00000001-00000002: it is not as it was written"),
        (_changed, 1, "00000001-00000002: it is not as it was written"),
        (_sealed_anew, 1, "00000001-00000002: "),
        (_of_another_place, 1, "00000004-00000005: it is of other frames"),
        (_overlapping, 0, "00000000-00000002: it is of other frames"),
        (_a_link, 1, "00000001-00000002: it is no folder"),
        (_linked_file, 1, "00000001-00000002: it is a link that leaves the folder"),
        (_a_pipe, 1, "00000001-00000002: it is no ordinary file"),
        (_not_sealed, 1, "00000001-00000002: cannot read it"),
        (_odd_seal, 1, "00000001-00000002: cannot read it"),
    ],
)
def test_a_part_that_is_not_as_it_was_kept_is_named_and_judged_again(
    spoil, judged, named, tmp_path
):
    judge_to_folder(switched(), cullers("objects"), tmp_path / "whole", pictures=2)
    out = tmp_path / "run"
    going(out, "objects", stop_after=5, pictures=2)
    spoil(parts_of(out)[1])
    run = judging_at_once(
        switched(), making("objects"), out, workers=1, command=COMMAND, pictures=2
    )
    with run as under_way:
        assert len(under_way.spoilt) == 1
        assert named in under_way.spoilt[0]
        assert under_way.before == 4 - judged
        under_way.finish(lambda frame: None)
    assert differing(tmp_path / "whole", out) == []


def test_a_spoilt_command_file_is_refused_by_name(tmp_path):
    out = tmp_path / "run"
    going(out, "objects", stop_after=4)
    command = parts_of(out)[0].parent.parent / kept.COMMAND
    command.write_text(command.read_text()[:-9])
    with pytest.raises(InputError, match=r"command\.json"):
        going(out, "objects")


def test_a_second_run_at_once_goes_its_own_way(tmp_path, monkeypatch):
    monkeypatch.setattr(beside, "_LASTING_WAIT_S", 0.0)
    judge_to_folder(switched(), cullers("objects"), tmp_path / "whole")
    out = tmp_path / "run"
    first = judging_at_once(switched(), making("objects"), out, workers=1, command=COMMAND)
    with first as under_way:
        # Its lock is this process's own; the other one's is another file.
        told, before = going(out, "objects")
        assert (len(told), before) == (FRAMES, 0)
        assert differing(tmp_path / "whole", out) == []
        under_way.finish(lambda frame: None)
    assert differing(tmp_path / "whole", out) == []
    assert sorted(os.listdir(tmp_path)) == ["run", "whole"]


def test_what_is_kept_is_told(tmp_path):
    run = judging_at_once(
        switched(), making("objects"), tmp_path / "run", workers=1, command=COMMAND
    )
    told = []

    def on_frame(frame):
        told.append(under_way.finished)
        if frame == 3:
            raise _Stopped

    with pytest.raises(_Stopped), run as under_way:
        under_way.finish(on_frame)
    assert told == [0, 1, 2, 3]


class Dies(Forgets):
    """Ends its process in the fourth frame, the first time. It looks at no earlier frames, so that
    the worker that has this frame is the one that ends."""

    memory = 0
    file = None

    def draw(self, camera):
        if camera.eye[0] == 3.0 and self.file.exists():
            self.file.unlink()
            os.kill(os.getpid(), 9)
        return super().draw(camera)


def test_a_worker_that_was_killed_loses_its_part_alone(tmp_path):
    @contextmanager
    def anew():
        culler = Dies()
        culler.file = tmp_path / "once"
        yield [("dies", culler)]

    judge_to_folder(switched(), [("dies", Forgets())], tmp_path / "whole")
    (tmp_path / "once").touch()
    run = judging_at_once(switched(), anew, tmp_path / "run", workers=2, command=COMMAND)
    with pytest.raises(RuntimeError, match="by signal 9"), run as under_way:
        under_way.finish(lambda frame: None)
    run = judging_at_once(switched(), anew, tmp_path / "run", workers=2, command=COMMAND)
    with run as under_way:
        assert under_way.before >= 3
        under_way.finish(lambda frame: None)
    assert differing(tmp_path / "whole", tmp_path / "run") == []


def test_the_command_line_says_what_is_kept_and_goes_on(tmp_path, monkeypatch, capsys):
    scene, path = write_scene(tmp_path, frames=6)
    drawn = tmp_path / "drawn.jsonl"

    def recorded(frame, last):
        return json.dumps({"frame": frame, "visible": [0, 1, 2] if frame < 5 else last}) + "\n"

    drawn.write_text("".join(recorded(frame, [0, 2]) for frame in range(6)))
    command = ["check", scene, "--path", path, "--visible", str(drawn), "--workers", "1",
               "--threads", "1", "--pictures", "0", "--out"]  # fmt: skip
    status = main([*command, str(tmp_path / "whole")])
    capsys.readouterr()

    def interrupted(bar, frame):
        if frame == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("visref.cli.terminal.Bar.on_frame_done", interrupted)
        assert main([*command, str(tmp_path / "run")]) == 130
    said = "interrupted; 2 of 6 frames are kept: the same command goes on"
    assert said in capsys.readouterr().err
    before = drawn.read_text()
    drawn.write_text("".join(recorded(frame, [0]) for frame in range(6)))
    assert main([*command, str(tmp_path / "run")]) == 2
    assert "2 frames of another command" in (error := capsys.readouterr().err)
    assert "its recording file was otherwise" in error
    drawn.write_text(before)
    assert main([*command, str(tmp_path / "run")]) == status
    assert "Goes on after 2 of 6 frames" in capsys.readouterr().out
    assert differing(tmp_path / "whole", tmp_path / "run") == []
