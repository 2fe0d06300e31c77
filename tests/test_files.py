"""Nothing half-written is ever left in place."""

from __future__ import annotations

import errno
import itertools
import os
import resource
from pathlib import Path

import pytest

from tests.support.dying import DIED, WENT_ON, content, dies_at
from visref import beside as beside_module
from visref.beside import PREFIX
from visref.errors import InputError
from visref.files import (
    FolderKind,
    make_folder,
    refuse_inputs,
    remove_folder,
    replacing_file,
    replacing_folder,
)

KIND = FolderKind("m", lambda content: ["m", "more/a"] if isinstance(content, int) else None)


def test_file_appears_whole_or_not_at_all(tmp_path):
    target = tmp_path / "deep" / "out.bin"
    with pytest.raises(ZeroDivisionError), replacing_file(target) as beside:
        beside.write_text("half")
        raise ZeroDivisionError
    assert not target.exists()
    with replacing_file(target) as beside:
        beside.write_text("whole")
    assert target.read_text() == "whole"
    assert [p.name for p in target.parent.iterdir()] == ["out.bin"]


@pytest.mark.parametrize("place", ["file/out", "file/deep/out"])
def test_where_a_file_is_in_the_way_it_is_named(place, tmp_path):
    (tmp_path / "file").write_text("mine")
    for writing in (
        replacing_file(tmp_path / place),
        replacing_folder(tmp_path / place, kind=KIND),
    ):
        with pytest.raises(
            InputError, match=r"file/.*out: cannot write here: .*/file is no folder"
        ):
            writing.__enter__()
    with pytest.raises(InputError, match="file is no folder"):
        make_folder(tmp_path / place)
    with pytest.raises(InputError, match="file is no folder"):
        make_folder(tmp_path / "file")
    make_folder(tmp_path / "a" / "b")
    make_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()
    assert (tmp_path / "file").read_text() == "mine"


def test_failed_run_leaves_the_last_good_one(tmp_path):
    target = tmp_path / "run"
    with replacing_folder(target, kind=KIND) as beside:
        (beside / "m").write_text("1")
    with (
        pytest.raises(ZeroDivisionError),
        replacing_folder(target, kind=KIND) as beside,
    ):
        (beside / "m").write_text("2")
        raise ZeroDivisionError
    assert (target / "m").read_text() == "1"
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def written(folder, number):
    """Replace a folder of the kind by one that says `number` everywhere."""
    with replacing_folder(folder, kind=KIND) as beside:
        (beside / "more").mkdir()
        (beside / "more" / "a").write_text(str(number))
        (beside / "m").write_text(str(number))


def whole(number):
    return {"m": b"%d" % number, "more": "", "more/a": b"%d" % number}


def add_link(folder):
    (folder / "out").symlink_to(folder.parent)


def replace_marker(text):
    return lambda folder: (folder / "m").write_text(text)


def marker_by_link(folder):
    (folder / "m").rename(folder.parent / "elsewhere")
    (folder / "m").symlink_to(folder.parent / "elsewhere")


def folder_as_marker(folder):
    (folder / "m").unlink()
    (folder / "m").mkdir()


FOREIGN = {
    "a file": (lambda folder: (folder / "notes.txt").write_text("mine"), "'notes.txt'"),
    "an empty folder": (lambda folder: (folder / "src").mkdir(), "'src/'"),
    "a repository": (lambda folder: (folder / ".git" / "refs").mkdir(parents=True), "'.git/'"),
    "a file in a folder of ours": (lambda folder: (folder / "more" / "b").write_text(""), "more/b"),
    "a folder in a folder of ours": (lambda folder: (folder / "more" / "b").mkdir(), "more/b/"),
    "a link": (add_link, "'out/'"),
    "a link in the place of a file of ours": (
        lambda folder: (
            (folder / "more" / "a").unlink(),
            (folder / "more" / "a").symlink_to(folder / "m"),
        ),
        "'more/a/'",
    ),
    "a pipe": (lambda folder: os.mkfifo(folder / "pipe"), "'pipe/'"),
    "a name with a newline": (lambda folder: (folder / "a\nb").write_text(""), r"'a\\nb'"),
    "no marker": (lambda folder: (folder / "m").unlink(), "not empty and has no m"),
    "another's marker": (replace_marker('{"format": "theirs"}'), "its m is not visref's"),
    "a marker that is no JSON": (replace_marker("1, 2"), "its m is not visref's"),
    "a marker that is too deep": (replace_marker("[" * 100_000), "its m is not visref's"),
    "a marker by link": (marker_by_link, "has no m"),
    "a folder as marker": (folder_as_marker, "has no m"),
    "what merely looks unfinished": (
        lambda folder: (folder / f"{PREFIX}{'0' * 16}" / "x").mkdir(parents=True),
        PREFIX,
    ),
}


@pytest.mark.parametrize("mounted", [False, True])
@pytest.mark.parametrize("what", FOREIGN)
def test_a_folder_that_holds_anything_foreign_stays_as_it_is(what, mounted, tmp_path, monkeypatch):
    folder = tmp_path / "run"
    written(folder, 1)
    add, said = FOREIGN[what]
    add(folder)
    if mounted:
        monkeypatch.setattr(os.path, "ismount", lambda path: Path(path) == folder)
    before = content(tmp_path)
    with pytest.raises(InputError, match=said) as refused:
        written(folder, 2)
    assert content(tmp_path) == before
    assert "\n" not in str(refused.value)
    remove_folder(folder, KIND)
    assert content(tmp_path) == before


@pytest.mark.parametrize("swapped", [True, False])
def test_what_is_foreign_and_comes_while_a_run_is_under_way_stays_too(
    swapped, tmp_path, monkeypatch
):
    written(tmp_path / "run", 1)
    exchange = beside_module.exchange

    def late(one, other):
        (tmp_path / "run" / "notes.txt").write_text("mine")
        return swapped and exchange(one, other)

    def once(one, other):
        monkeypatch.setattr(beside_module, "exchange", exchange if swapped else lambda *_: False)
        return late(one, other)

    monkeypatch.setattr(beside_module, "exchange", once)
    with pytest.raises(InputError, match=r"notes\.txt"):
        written(tmp_path / "run", 2)
    assert content(tmp_path / "run") == {**whole(1), "notes.txt": b"mine"}
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_a_file_of_another_kind_is_not_replaced_and_an_empty_one_is(tmp_path):
    file = tmp_path / "scene.bin"
    file.write_text("vertices")
    with pytest.raises(InputError, match="of another kind"), replacing_file(file, begins=b"PAR1"):
        pass
    assert file.read_text() == "vertices"
    for old in ("", "PAR1 old"):
        file.write_text(old)
        with replacing_file(file, begins=b"PAR1") as beside:
            beside.write_text("new")
        assert file.read_text() == "new"


@pytest.mark.parametrize("make", [replacing_file, lambda p: replacing_folder(p, kind=KIND)])
def test_unwritable_place_is_a_clear_error(make, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write here"), make(tmp_path / "file" / "below"):
        pass


@pytest.mark.parametrize("make", [replacing_file, lambda p: replacing_folder(p, kind=KIND)])
def test_a_pipe_or_device_is_never_replaced(make, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="it is no"), make(tmp_path / "pipe"):
        pass
    assert (tmp_path / "pipe").is_fifo()


@pytest.mark.parametrize("make", [replacing_file, lambda p: replacing_folder(p, kind=KIND)])
def test_name_that_no_file_system_takes_is_a_clear_error(make, tmp_path):
    with pytest.raises(InputError, match="cannot write here"), make(tmp_path / ("n" * 300)):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_name_of_full_length_is_written(tmp_path):
    with replacing_file(tmp_path / ("n" * 255)) as beside:
        beside.write_text("whole")
    assert (tmp_path / ("n" * 255)).read_text() == "whole"


def test_a_link_to_a_run_folder_stays_a_link_to_the_new_one(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "m").write_text("1")
    (tmp_path / "link").symlink_to("run")
    with replacing_folder(tmp_path / "link", kind=KIND) as beside:
        (beside / "m").write_text("2")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "run" / "m").read_text() == "2"


def test_a_link_to_a_file_stays_a_link_to_the_new_one(tmp_path):
    (tmp_path / "old").write_text("1")
    (tmp_path / "link").symlink_to("old")
    with replacing_file(tmp_path / "link") as beside:
        beside.write_text("2")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "old").read_text() == "2"


def test_the_folder_one_stands_in_is_replaced_like_any(tmp_path, monkeypatch):
    (tmp_path / "run").mkdir()
    monkeypatch.chdir(tmp_path / "run")
    with replacing_folder(".", kind=KIND) as beside:
        (beside / "m").write_text("1")
    assert (tmp_path / "run" / "m").read_text() == "1"
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


# How a folder is put in its place: by exchanging two names, by two renames, or file by file into
# a folder that is a mount point.
WAYS = ["exchange", "two renames", "mounted", "mounted, unseen"]


@pytest.fixture(params=WAYS)
def way(request, tmp_path, monkeypatch):
    target, rename = tmp_path / "run", os.rename

    def busy(one, other):
        if target in (Path(one), Path(other)):
            raise OSError(errno.EBUSY, "busy")
        rename(one, other)

    if request.param == "two renames":
        monkeypatch.setattr(beside_module, "exchange", lambda one, other: False)
    if request.param == "mounted":
        monkeypatch.setattr(os.path, "ismount", lambda path: Path(path) == target)
    if request.param.startswith("mounted"):
        target.mkdir()
        monkeypatch.setattr(os, "rename", busy)
    return request.param


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_every_way_writes_into_an_empty_folder_and_over_an_earlier_one(way, tmp_path):
    target = tmp_path / "run"
    target.mkdir(exist_ok=True)
    number = target.stat().st_ino
    for count in (1, 2, 3):
        written(target, count)
        assert content(target) == whole(count)
        assert names(tmp_path) == ["run"]
    # A mount point is never moved.
    assert (target.stat().st_ino == number) == way.startswith("mounted")


@pytest.mark.parametrize("interrupt", [False, True], ids=["killed", "interrupted"])
def test_a_run_that_ends_at_any_step_loses_nothing_and_the_next_leaves_nothing(
    way, interrupt, tmp_path, monkeypatch
):
    monkeypatch.setattr(os, "fsync", lambda file: None)
    target, seen = tmp_path / "run", set()
    for step in itertools.count(1):
        written(target, 1)
        ended = dies_at(step, lambda: written(target, 2), interrupt=interrupt)
        if ended == WENT_ON:
            break
        assert ended == DIED, step
        if way == "exchange":
            assert content(target) in (whole(1), whole(2)), step
        # The next run cleans up, though it comes to nothing itself.
        with pytest.raises(ZeroDivisionError), replacing_folder(target, kind=KIND):
            raise ZeroDivisionError
        assert content(target) in (whole(1), whole(2)), step
        assert names(tmp_path) == ["run"], step
        seen.add(content(target)["m"])
    assert seen == {b"1", b"2"}


@pytest.mark.parametrize("interrupt", [False, True], ids=["killed", "interrupted"])
def test_a_file_is_old_or_new_whenever_its_writer_ends(interrupt, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda file: None)
    target, seen = tmp_path / "t.parquet", set()

    def write(text):
        with replacing_file(target) as beside:
            beside.write_text(text)

    for step in itertools.count(1):
        write("old")
        ended = dies_at(step, lambda: write("new"), interrupt=interrupt)
        if ended == WENT_ON:
            break
        assert ended == DIED, step
        seen.add(target.read_text())
        with pytest.raises(ZeroDivisionError), replacing_file(target):
            raise ZeroDivisionError
        assert names(tmp_path) == ["t.parquet"], step
    assert seen == {"old", "new"}


def test_thirty_runs_at_once_into_one_folder_give_one_whole_folder(way, tmp_path, monkeypatch):
    target = tmp_path / "run"
    written(target, 100)
    ready, go = os.pipe()
    children = []
    for number in range(30):
        child = os.fork()
        if child == 0:
            status = 1
            try:
                os.close(go)
                # Nobody starts before all are there.
                os.read(ready, 1)
                written(target, number)
                status = 0
            except InputError:
                status = 2
            finally:
                os._exit(status)
        children.append(child)
    os.close(go)
    os.close(ready)
    ended = [os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children]
    # Where nobody can see that it is a mount point, one may find another at it, and says so.
    assert set(ended) <= ({0, 2} if way == "mounted, unseen" else {0})
    won = [number for number in range(30) if ended[number] == 0]
    assert content(target) in [whole(number) for number in won]
    assert names(tmp_path) == ["run"]


def test_who_reads_while_runs_replace_a_folder_always_finds_one(tmp_path, monkeypatch):
    if not beside_module.exchange(*(_folder(tmp_path / name) for name in "ab")):
        # Of this file system, it is not claimed.
        return
    monkeypatch.setattr(os, "fsync", lambda file: None)
    target = tmp_path / "run"
    written(target, 1)
    child = os.fork()
    if child == 0:
        for number in range(200):
            written(target, number)
        os._exit(0)
    while os.waitpid(child, os.WNOHANG) == (0, 0):
        assert (target / "m").read_text().isdigit()


def test_what_a_killed_run_moved_away_is_back_before_the_next_one_looks(tmp_path):
    """Between two renames there is no folder; a run that refuses to go on finds it again."""
    dead = tmp_path / f"{PREFIX}{'a' * 16}"
    (dead / "replaced").mkdir(parents=True)
    (dead / "replaced" / "m").write_text("1")
    (dead / "replaced" / "notes.txt").write_text("mine")
    (dead / "lock").write_text('{"visref": "unfinished", "name": "run", "marker": ""}')
    with pytest.raises(InputError, match=r"notes\.txt"):
        written(tmp_path / "run", 2)
    assert names(tmp_path) == ["run"]
    assert content(tmp_path / "run") == {"m": b"1", "notes.txt": b"mine"}


@pytest.mark.parametrize("lock", [None, "", "mine", '{"visref": "finished"}', "[1]", "link"])
def test_a_folder_that_merely_has_such_a_name_is_left_alone(lock, tmp_path):
    before = {}
    for name in ("mine", "0" * 16, "0" * 17):
        folder = tmp_path / f"{PREFIX}{name}"
        folder.mkdir()
        (folder / "precious").write_text("keep")
        if lock == "link":
            (tmp_path / "theirs").write_text('{"visref": "unfinished", "name": "", "marker": ""}')
            (folder / "lock").symlink_to(tmp_path / "theirs")
        elif lock is not None:
            (folder / "lock").write_text(lock)
    before = content(tmp_path)
    written(tmp_path / "run", 1)
    remove_folder(tmp_path / "run", KIND)
    assert content(tmp_path) == before


def test_what_a_living_run_writes_is_left_alone(tmp_path):
    with replacing_file(tmp_path / "t.parquet") as file:
        file.write_text("half")
        with replacing_folder(tmp_path / "other", kind=KIND) as folder:
            (folder / "m").write_text("1")
            written(tmp_path / "run", 1)
        assert file.read_text() == "half"
    assert names(tmp_path) == ["other", "run", "t.parquet"]


def test_a_folder_in_which_a_report_is_being_written_is_not_replaced(tmp_path):
    written(tmp_path / "run", 1)
    with replacing_file(tmp_path / "run" / "more.html") as file:
        file.write_text("half")
        with pytest.raises(InputError, match="another command of visref is writing"):
            written(tmp_path / "run", 2)


@pytest.mark.parametrize("left", [None, "t.parquet"])
def test_a_disk_that_is_full_is_one_line_and_the_old_stands(left, tmp_path):
    written(tmp_path / "run", 1)
    (tmp_path / "t.parquet").write_text("old")

    def fill(file):
        # Python ignores SIGXFSZ, so a write beyond the limit is an error as a full disk's is.
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))
        file.write_bytes(bytes(5000))

    before = content(tmp_path)
    try:
        with pytest.raises(InputError, match=r"cannot write here: File too large"):
            if left is None:
                with replacing_folder(tmp_path / "run", kind=KIND) as folder:
                    fill(folder / "m")
            else:
                with replacing_file(tmp_path / left) as file:
                    fill(file)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
    assert content(tmp_path) == before


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EIO, errno.EDQUOT])
@pytest.mark.parametrize("call", ["fsync", "mkdir", "rename"])
def test_what_a_disk_refuses_at_any_call_is_one_line_and_the_old_stands(
    number, call, tmp_path, monkeypatch
):
    written(tmp_path / "run", 1)
    before = content(tmp_path)

    def refuse(*_, **__):
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch:
        patch.setattr(os, call, refuse)
        with pytest.raises(InputError, match="cannot write here") as refused:
            written(tmp_path / "run", 2)
    assert os.strerror(number) in str(refused.value)
    assert content(tmp_path) == before


def test_all_is_on_disk_before_it_has_its_name(tmp_path, monkeypatch):
    synced, fsync = [], os.fsync

    def note(file):
        synced.append(os.readlink(f"/proc/self/fd/{file}").rpartition(PREFIX)[2])
        assert not (tmp_path / "run").exists() or synced[-1] == str(tmp_path)
        fsync(file)

    monkeypatch.setattr(os, "fsync", note)
    written(tmp_path / "run", 1)
    places = [place.partition("/")[2] for place in synced[:-1]]
    assert sorted(places) == ["written", "written/m", "written/more", "written/more/a"]
    assert synced[-1] == str(tmp_path)


@pytest.mark.parametrize("place", ["~", "~/deep", "~root", "$HOME"])
def test_a_name_with_a_tilde_is_a_name(place, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    written(Path(place), 1)
    with replacing_file(Path(place) / "file") as file:
        file.write_text("1")
    assert content(tmp_path / place) == {**whole(1), "file": b"1"}
    assert not (tmp_path / "home").exists()


def same(path):
    return path


def by_link(path):
    link = path.with_name("link")
    link.symlink_to(path)
    return link


def by_hard_link(path):
    link = path.with_name("hard link")
    link.hardlink_to(path)
    return link


def by_folder_link(path):
    link = path.parent.with_name("folder link")
    link.symlink_to(path.parent)
    return link / path.name


def by_dots(path):
    return path.parent / ".." / path.parent.name / path.name


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("other", [same, by_link, by_hard_link, by_folder_link, by_dots])
def test_an_input_is_no_output_by_whatever_name(other, swapped, tmp_path):
    (tmp_path / "in").mkdir()
    file = tmp_path / "in" / "scene.glb"
    file.write_text("")
    pair = [file, other(file)]
    given, out = reversed(pair) if swapped else pair
    with pytest.raises(InputError, match=r"an input of this command, '.*', would be lost"):
        refuse_inputs(out, [None, "city:scale=1", given])
    refuse_inputs(tmp_path / "in" / "new", [given])


@pytest.mark.parametrize("other", [same, by_link, by_folder_link])
def test_a_folder_that_holds_an_input_is_no_output(other, tmp_path):
    (tmp_path / "in").mkdir()
    file = tmp_path / "in" / "truth.parquet"
    file.write_text("")
    for out in (tmp_path / "in", tmp_path):
        with pytest.raises(InputError, match="would be lost"):
            refuse_inputs(out, [other(file) if out == tmp_path / "in" else file])
    refuse_inputs(tmp_path / "run", [file])


def test_a_link_that_leads_nowhere_new_is_a_clear_error(tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    for make in (replacing_file, lambda path: replacing_folder(path, kind=KIND)):
        with pytest.raises(InputError, match="link to itself"), make(tmp_path / "loop"):
            pass


def _folder(path):
    path.mkdir()
    return path
