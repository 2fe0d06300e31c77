"""A target: a reader of visref, good files for it, and what is done to them."""

from __future__ import annotations

import io
import re
import zlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from tests.fuzz.limits import LIMITS, PATIENT, Fault, Folders, Limits, WrongAnswer, watched
from tests.fuzz.quick import quick
from tests.fuzz.spoil import Spoil
from visref.cli.main import main
from visref.judging.status import Exit

# Of a case in so many, the command line reads it too.
COMMAND_SHARE = 16
# Characters that drive a terminal, turn text around, or are none.
_RAW = re.compile(
    "[\x00-\x09\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)


def _write(data: bytes, folders: Folders, target: Target) -> Path:
    for name, content in target.companions.items():
        (folders.inside / name).write_bytes(content)
    file = folders.inside / target.file
    file.write_bytes(data)
    return file


@dataclass(frozen=True)
class Target:
    """`read` takes a case's file and gives what was read of it, to be compared; a case is the
    bytes of `file`, which stands beside `companions`. `spoil` may break a good file, `rewrite`
    must not change what is read. `command` makes a command line of it. `cases`: of the short run.
    `writes`: folders of the input that may change. `reads_outside`: it names files of others."""

    name: str
    file: str
    seeds: Callable[[], Mapping[str, bytes]]
    spoil: Spoil
    read: Callable[[Path, Folders], Any]
    rewrite: Spoil | None = None
    command: Callable[[Path, Folders], Sequence[str]] | None = None
    companions: Mapping[str, bytes] = field(default_factory=dict)
    lay_out: Callable[[bytes, Folders, Target], Path] = _write
    cases: int = 60
    writes: tuple[str, ...] = ()
    reads_outside: bool = False
    limits: Limits = LIMITS

    @property
    def suffix(self) -> str:
        return Path(self.file).suffix

    def warm_up(self, folders: Folders) -> None:
        """Read the good files at leisure: kernels are compiled, libraries imported, once."""
        patient = replace(self, limits=PATIENT)
        for data in self.seeds().values():
            patient.run(data, folders, by_command=True)

    def run(
        self, data: bytes, folders: Folders, *, by_command: bool | None = None
    ) -> tuple[Any, Fault | None]:
        """What was read of a case, None where it is refused, and what was wrong with it.

        `by_command`: whether the command line reads it too, None of a case in so many."""
        if by_command is None:
            by_command = zlib.crc32(data) % COMMAND_SHARE == 0
        folders.empty()
        file = self.lay_out(data, folders, self)
        also = tuple(folders.inside / name for name in self.writes)
        rules = {"also": also, "reads_outside": self.reads_outside}
        with quick():
            value, fault = watched(lambda: self.read(file, folders), folders, self.limits, **rules)
            if fault is None and self.command and by_command:
                line = self.command(file, folders)
                _, fault = watched(lambda: command(line), folders, self.limits, **rules)
        return value, fault


def command(line: Sequence[str]) -> tuple[int, str]:
    """Run a command line here. Its status and standard output.

    Raises WrongAnswer for any status but those of a verdict and of bad input, for any but one
    line on standard error with the latter, and for text that drives a terminal.
    """
    out, errors = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(errors):
        try:
            status = main(line)
        except SystemExit as stop:
            # argparse: its usage, then its line.
            status = int(stop.code or 0)
            said = errors.getvalue()
            errors = io.StringIO(said[said.rfind("visref") :] if "usage:" in said else said)
    said = errors.getvalue()
    if status not in (Exit.NO_VIOLATION, Exit.VIOLATION, Exit.BAD_INPUT, Exit.NOTHING_JUDGED):
        frames = re.findall(r'visref/([\w/]+)\.py", line \d+, in (\w+)', said)
        broken = [frame for frame in frames if frame[0] != "cli/main"]
        where = "{}.{}".format(*broken[-1]) if broken else "nowhere"
        lines = said.strip().splitlines()
        what = lines[-2].split(":")[0] if len(lines) > 1 else said
        raise WrongAnswer(f"status {status}: {what} in {where.split('/')[-1]}")
    if len(said.splitlines()) != (status in (Exit.BAD_INPUT, Exit.NOTHING_JUDGED)):
        raise WrongAnswer(f"status {status}, {len(said.splitlines())} lines of errors", said)
    for text in (out.getvalue(), said):
        if found := _RAW.search(text):
            raise WrongAnswer(f"prints {found[0]!a}")
    return status, out.getvalue()
