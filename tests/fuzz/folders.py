"""Run folders as input: of `visref report` and of `visref explain`.

A case is what differs from a good folder, as JSON: for each name in it `{"text": …}`, `{"base64":
…}`, `{"link": …}`, `{"folder": true}`, `{"fifo": true}` or null where it is missing.
"""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

from tests.fuzz import rewrite, spoil
from tests.fuzz.draws import Draws
from tests.fuzz.limits import Folders, WrongAnswer
from tests.fuzz.target import Target, command
from tests.support import report_runs

# Frame and object that a culler of the good run lost.
FRAME, OBJECT = 1, report_runs.NASTY_ID


@cache
def good() -> dict[str, bytes]:
    """The files of a run with misses and pictures, and of a bench beside it."""
    with tempfile.TemporaryDirectory() as root:
        folder = Path(root)
        lossy = report_runs.Scripted(report_runs.VISIBLE, (report_runs.WALL, report_runs.HIDDEN))
        fails = report_runs.Scripted(report_runs.EVERYTHING, fails_at=1)
        report_runs.write_run(
            folder / "run", [("lossy", lossy), ("falls", fails)], frames=2, pictures=[1]
        )
        report_runs.bench_folder(folder / "bench")
        # Times differ from run to run.
        return {
            str(file.relative_to(folder)): file.read_bytes()
            for file in sorted(folder.rglob("*"))
            if file.is_file()
        }


def lay_out(data: bytes, folders: Folders, target: Target) -> Path:
    """The good folders in `folders.inside`, with what the case says to be different."""
    del target
    changes: dict[str, Any] = json.loads(data)
    for name, content in good().items():
        file = folders.inside / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    for name, entry in changes.items():
        file = folders.inside / name
        if _is_within_no_folder(file, folders.inside):
            continue
        if file.is_dir() and not file.is_symlink():
            shutil.rmtree(file)
        else:
            file.unlink(missing_ok=True)
        if entry is None:
            continue
        file.parent.mkdir(parents=True, exist_ok=True)
        if "text" in entry:
            file.write_bytes(entry["text"].encode("utf-8", "surrogateescape"))
        elif "base64" in entry:
            file.write_bytes(base64.b64decode(entry["base64"]))
        elif "link" in entry:
            file.symlink_to(entry["link"])
        elif "fifo" in entry:
            os.mkfifo(file)
        else:
            file.mkdir()
    return folders.inside / "run"


def _is_within_no_folder(file: Path, top: Path) -> bool:
    """Whether the case has made something else of a folder that the file would be in."""
    above = [parent for parent in file.parents if parent != top and top in parent.parents]
    return any(parent.is_symlink() or (parent.exists() and not parent.is_dir()) for parent in above)


def _entry(content: bytes) -> dict[str, str]:
    try:
        return {"text": content.decode()}
    except UnicodeDecodeError:
        return {"base64": base64.b64encode(content).decode()}


def _content(entry: dict[str, Any] | None, name: str) -> bytes:
    if entry is not None and "text" in entry:
        return str(entry["text"]).encode("utf-8", "surrogateescape")
    if entry is not None and "base64" in entry:
        return base64.b64decode(entry["base64"])
    return good().get(name, b"")


KINDS = {".json": spoil.json_text, ".jsonl": spoil.json_lines, ".parquet": spoil.parquet}
# These are looked into most.
_OFTEN = ("manifest.json", "verdict.json", "witnesses", "objects.parquet", "frames.parquet")


def _spoilt(data: bytes, draws: Draws) -> bytes:
    changes: dict[str, Any] = json.loads(data)
    names = [name for name in good() for _ in range(6 if any(o in name for o in _OFTEN) else 1)]
    name, kind = draws.pick(names), draws.below(16)
    if kind == 1:
        changes[name] = None
    elif kind == 2:
        changes[name] = {"link": draws.pick((*spoil.OUTSIDE, name.rpartition("/")[2]))}
    elif kind == 3:
        changes[name] = draws.pick(({"folder": True}, {"fifo": True}, {"text": ""}))
    elif kind == 4:
        changes[draws.pick(("run/witnesses", "run/pictures"))] = draws.pick(
            (None, {"link": "../../outside"}, {"link": "/"}, {"text": "x"}, {"link": "witnesses"})
        )
    elif kind == 5:
        other = draws.pick(list(good()))
        changes[name] = _entry(good()[other])
    else:
        spoiler = KINDS.get(Path(name).suffix, spoil.any_bytes)
        changes[name] = _entry(spoiler(_content(changes.get(name), name), draws))
    return spoil.json_bytes(changes)


def _rewritten(data: bytes, draws: Draws) -> bytes:
    """The same records, written in another way."""
    changes: dict[str, Any] = json.loads(data)
    for name, content in good().items():
        if draws.below(2):
            continue
        if name in ("run/manifest.json", "run/verdict.json", "bench/bench.json"):
            changes[name] = _entry(rewrite.with_unknown(content, draws))
        elif name.endswith(".jsonl"):
            changes[name] = _entry(rewrite.json_rows(content, draws))
        elif name.endswith(".parquet") and "truth" not in name:
            changes[name] = _entry(rewrite.parquet_with_unknown(content, draws))
    return spoil.json_bytes(changes)


def _texts(folder: Path) -> dict[str, str]:
    return {file.name: file.read_text(encoding="utf-8") for file in sorted(folder.iterdir())}


def _secret_in(texts: dict[str, str]) -> None:
    secret = base64.b64encode(Folders.SECRET.encode()).decode()[:-4]
    for name, text in texts.items():
        if Folders.SECRET in text or secret in text:
            raise WrongAnswer(f"{name} holds what stands outside")


def _report(run: Path, folders: Folders) -> Any:
    line = ["report", str(run), str(run.with_name("bench")), "--out", str(folders.out / "page")]
    status, said = command(line)
    if status in (2, 3):
        _refused(folders)
        return None
    texts = _texts(folders.out / "page")
    _secret_in(texts)
    page = re.sub(
        r"<style>.*?</style>|data:[\w/+;]+,[\w+/=]+", "", texts["report.html"], flags=re.S
    )
    # What is only data is never run.
    scripts = len(re.findall('<script(?! type="application/octet-stream")', page))
    if scripts > 2 or re.search(r"<[^>]*\son\w+\s*=", page) or "javascript:" in page:
        raise WrongAnswer("report.html holds a script of others")
    return status, said, texts


def _refused(folders: Folders) -> None:
    if any(folders.out.iterdir()):
        raise WrongAnswer("refused, and wrote all the same")


def _explain(run: Path, folders: Folders) -> Any:
    line = ["explain", str(run), "--frame", str(FRAME), "--object", str(OBJECT)]
    picture = folders.out / "picture.png"
    status, said = command([*line, "--picture", str(picture)])
    command(line)
    _secret_in({"standard output": said})
    return None if status in (2, 3) else (status, said, picture.read_bytes())


def _seeds() -> dict[str, bytes]:
    return {"run": b"{}"}


TARGETS = (
    Target("report", "case.json", _seeds, _spoilt, _report, _rewritten, lay_out=lay_out, cases=30),
    Target("explain", "case.json", _seeds, _spoilt, _explain, _rewritten, lay_out=lay_out,
           cases=20, writes=("run/witnesses",)),
)  # fmt: skip
