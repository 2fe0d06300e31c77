"""Readers of formats with a history run in a process of their own, with limits.

XML inside zip, hierarchies that name a node many times over, libraries that were not written for
files of strangers: such a reader may take any memory and any time, or die. In a child it does so
alone. The child limits itself before it opens the file: memory, processor time, no writing, no
network, no programs. What it answers is JSON and plain arrays, never pickles: whoever takes the
child over can make it say any scene, as the file could have, and nothing else.

    answer   8 bytes, the JSON's length, little-endian; the JSON; the arrays, one after another
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO, NoReturn, cast

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.files import json_bytes, parse_json
from visref.findings import Code
from visref.formats import keyed_motion
from visref.formats.placed import Mesh, Placed
from visref.memory import Budget, shown_size
from visref.scene import Alpha, Group, check_indices

# The imports take two seconds, and pycollada reads some 8 MB of text a second (27.8 MB in 3.5 s); a
# zipped file holds some ten times as much text as it has bytes. Room for a slower machine.
_SECONDS = 20
_SECONDS_A_MB = 3
# The parent waits for longer than the child may work: a busy machine gives it less than a core.
_PATIENCE = 10

_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "PXR_WORK_THREAD_LIMIT")

_START = """
import json, sys
path, reader, file, memory, seconds, limit, given = json.loads(sys.argv[1])
sys.path[:] = path
from visref.formats.in_a_child import answer
answer(reader, file, memory, seconds, limit, given)
"""
# What an audit hook refuses (PEP 578): whatever leaves the process.
_REFUSED = (
    "socket.",
    "subprocess.",
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "os.fork",
    "ctypes.",
)
_ARRAYS = {"positions": ("<f4", "<f8"), "triangles": ("<i8",), "one_sided": ("|u1",)}


def read_in_a_child(
    reader: str, path: Path, budget: Budget, *, seconds_a_mb: float = _SECONDS_A_MB
) -> Placed:
    """What `reader` (`module:function` of a path and a `Budget`) makes of a file, in a process of
    its own, which may take half of what is left of the budget: for the answer is held twice.
    `seconds_a_mb`: of processor time, for a megabyte of the file.

    Raises InputError where the reader does, and where the process fails or reaches a limit.
    """
    megabytes = path.stat().st_size / 1e6
    seconds = int(_SECONDS + seconds_a_mb * megabytes)
    memory = budget.left // 2
    asked = json.dumps(
        [sys.path, reader, os.fsdecode(path.absolute()), memory, seconds, budget.left, budget.given]
    )
    # A thread of a linear algebra library takes memory before it does anything.
    environment = {**os.environ, **dict.fromkeys(_ONE_THREAD, "1")}
    process = subprocess.Popen(
        [sys.executable, "-I", "-c", _START, asked],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=environment,
    )
    assert process.stdout is not None
    late = threading.Event()

    def stop() -> None:
        late.set()
        process.kill()

    timer = threading.Timer(_PATIENCE * seconds, stop)
    timer.daemon = True
    timer.start()
    try:
        return _Answer(cast(BinaryIO, process.stdout), budget).placed()
    except _NoAnswer:
        status = process.wait()
        if late.is_set() or -status in _OUT_OF_TIME:
            problem, fix = f"reading it took more than {seconds} s", "give a smaller scene"
        elif status == 0:
            problem, fix = "its reader's answer is none", "export the file in another format"
        else:
            how = f"by {signal.Signals(-status).name}" if status < 0 else f"with status {status}"
            problem, fix = f"its reader's process ended {how}", "export the file in another format"
        raise InputError(problem, fix=fix) from None
    finally:
        timer.cancel()
        process.kill()
        process.stdout.close()
        process.wait()


_OUT_OF_TIME = [getattr(signal, "SIGXCPU", 0), getattr(signal, "SIGALRM", 0)]


class _NoAnswer(Exception):
    """The child said nothing, or nothing that can be an answer."""


class _Answer:
    """What a child wrote, believed of nothing but its being a scene."""

    def __init__(self, stream: BinaryIO, budget: Budget) -> None:
        self.stream = stream
        self.budget = budget

    def placed(self) -> Placed:
        header = self._header()
        try:
            if "error" in header:
                problem, fix, place = (str(header["error"][name])[:2000] for name in _ERROR)
                raise InputError(problem, fix=fix or "export the file anew", place=place)
            return self._placed(header)
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            if isinstance(error, InputError) and error.fix:
                raise
            raise _NoAnswer from error

    def _header(self) -> dict[str, Any]:
        length = int.from_bytes(self._bytes(8).tobytes(), "little")
        self.budget.need("what its reader says", 4 * length)
        text = self._bytes(length)
        self.budget.claim("what its reader says", json_bytes(text))
        header = parse_json(text.tobytes())
        if not isinstance(header, dict):
            raise _NoAnswer
        return header

    def _placed(self, header: dict[str, Any]) -> Placed:
        placed = Placed(
            names=_strings(header["names"]),
            paths=_strings(header["paths"]),
            notes=[(Code(code), str(text)) for code, text in header["notes"]],
        )
        count = len(placed.names)
        for sizes in header["meshes"]:
            vertices, triangles, kind = (sizes[name] for name in ("vertices", "triangles", "kind"))
            positions = self._array(kind, ("<f4", "<f8"), (vertices, 3))
            faces = self._array("<i8", ("<i8",), (triangles, 3))
            check_indices(faces, len(positions), lambda bad: f"triangle {bad}")
            one_sided = self._array("|u1", ("|u1",), (triangles,))
            alpha = self._array("|u1", ("|u1",), (triangles,))
            if (alpha > max(Alpha)).any() or (one_sided > 1).any():
                raise _NoAnswer
            placed.meshes.append(Mesh(positions, faces, one_sided.astype(np.bool_), alpha))
        meshes = self._array("<i8", ("<i8",), (count,))
        if count and not -1 <= meshes.min() <= meshes.max() < len(placed.meshes):
            raise _NoAnswer
        placed.mesh_of_object = meshes.tolist()
        placed.world_from_object = [self._array("<f8", ("<f8",), (count, 4, 4))]
        placed.hidden = self._array("|u1", ("|u1",), (count,)).astype(np.bool_).tolist()
        if header["motion"] is not None:
            placed.motion = keyed_motion.read(
                header["motion"],
                lambda shape: self._array("<f8", ("<f8",), shape),
                lambda shape: self._array("<i8", ("<i8",), shape),
                meshes,
                [len(mesh.positions) for mesh in placed.meshes],
            )
        for name, path, first, last in header["groups"]:
            if not 0 <= first <= last <= count:
                raise _NoAnswer
            placed.groups.append(Group(str(name), str(path), tuple(range(first, last))))
        if len(placed.paths) != count:
            raise _NoAnswer
        return placed

    def _array(self, kind: str, allowed: tuple[str, ...], shape: tuple[int, ...]) -> NDArray[Any]:
        sized = all(type(side) is int and 0 <= side < 1 << 40 for side in shape)
        if kind not in allowed or not sized:
            raise _NoAnswer
        dtype, length = np.dtype(kind), 1
        for side in shape:
            length *= side
        self.budget.claim("what its reader made of it", length * dtype.itemsize)
        return self._bytes(length * dtype.itemsize).view(dtype).reshape(shape)

    def _bytes(self, length: int) -> NDArray[np.uint8]:
        result = np.empty(length, np.uint8)
        view, at = result.data, 0
        while at < length:
            read = self.stream.readinto(view[at:])  # type: ignore[attr-defined]
            if not read:
                raise _NoAnswer
            at += read
        return result


def _strings(values: Any) -> list[str]:
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise _NoAnswer
    return values


_ERROR = ("problem", "fix", "place")


def answer(reader: str, file: str, memory: int, seconds: int, limit: int, given: bool) -> NoReturn:
    """The child: read, write the answer to standard output, and end."""
    out = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)  # whatever a library prints
    module, _, name = reader.partition(":")
    taken = 0
    try:
        read = cast(
            Callable[[Path, Budget], Placed], getattr(importlib.import_module(module), name)
        )
        taken = _limit(memory, seconds)
        _write(out, read(Path(file), Budget(limit, given)))
    except InputError as error:
        said = {name: getattr(error, name) for name in _ERROR}
        # A library that gets no memory may say anything.
        if _peak() - taken > memory // 2:
            said["problem"] += f" (it took {shown_size(_peak() - taken)} of {shown_size(memory)})"
            said["fix"] += ", or give more with --max-memory"
        _write_header(out, {"error": said})
    except MemoryError:
        problem = f"reading it takes more than {shown_size(memory)}, half of the limit"
        fix = "give more with --max-memory, or make the scene smaller"
        _write_header(out, {"error": {"problem": problem, "fix": fix, "place": ""}})
    except RecursionError:
        problem, fix = "its nodes are nested too deep", "export the file anew"
        _write_header(out, {"error": {"problem": problem, "fix": fix, "place": ""}})
    out.flush()
    os._exit(0)


def _peak() -> int:
    """The most memory that this process had, in bytes; 0 where the system does not say."""
    status = Path("/proc/self/status")
    lines = status.read_text(encoding="utf-8").splitlines() if status.exists() else []
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("VmPeak")), 0)


def _limit(memory: int, seconds: int) -> int:
    """Limit this process for good. Returns the memory that it has at the start, in bytes."""

    def refuse(event: str, _: Any) -> None:
        if event.startswith(_REFUSED):
            raise PermissionError(f"a reader may not use {event}")

    sys.addaudithook(refuse)
    try:
        import resource
    except ImportError:  # a system without limits
        return 0
    taken = 0
    statm = Path("/proc/self/statm")
    if statm.exists():
        taken = int(statm.read_text(encoding="utf-8").split()[0]) * resource.getpagesize()
    for kind, most in (
        (resource.RLIMIT_AS, taken + memory),
        (resource.RLIMIT_CPU, seconds),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(kind)[1]
        low = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (low, hard if kind == resource.RLIMIT_CPU else low))
    return taken


def _write(out: BinaryIO, placed: Placed) -> None:
    assert all(mesh.masks is None for mesh in placed.meshes)
    kinds = ["<f4" if mesh.positions.dtype == np.float32 else "<f8" for mesh in placed.meshes]
    motion: tuple[dict[str, Any] | None, list[Any]] = (None, [])
    if placed.motion is not None:
        assert isinstance(placed.motion, keyed_motion.KeyedMotion)
        motion = placed.motion.written()
    header = {
        "motion": motion[0],
        "names": placed.names,
        "paths": placed.paths,
        "notes": placed.notes,
        "groups": [
            (group.name, group.path, group.objects[0], group.objects[-1] + 1)
            for group in placed.groups
        ],
        "meshes": [
            {"vertices": len(mesh.positions), "triangles": len(mesh.triangles), "kind": kind}
            for mesh, kind in zip(placed.meshes, kinds, strict=True)
        ],
    }
    _write_header(out, header)
    for mesh, kind in zip(placed.meshes, kinds, strict=True):
        for values, stored in (
            (mesh.positions, kind),
            (mesh.triangles, "<i8"),
            (mesh.one_sided, "|u1"),
            (mesh.alpha, "|u1"),
        ):
            flat: NDArray[Any] = np.ascontiguousarray(values, stored).reshape(-1)
            out.write(flat.view(np.uint8).data)
    out.write(np.array(placed.mesh_of_object, "<i8").tobytes())
    matrices = np.concatenate([np.zeros((0, 4, 4)), *placed.world_from_object])
    out.write(matrices.astype("<f8").tobytes())
    out.write(np.array(placed.hidden, "|u1").tobytes())
    for array in motion[1]:
        out.write(np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes())


def _write_header(out: BinaryIO, header: dict[str, Any]) -> None:
    text = json.dumps(header).encode()
    out.write(len(text).to_bytes(8, "little") + text)
