"""How much memory an input may take: a limit, and a budget that readers ask before they allocate.

A few bytes of a file can name gigabytes (instances, nodes that hold each other twice over, zipped
text, the counts in a header). So whoever expands what a file describes first works out what it
will be, and claims it: what does not fit is refused in one line, before the memory is gone.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path

from visref.errors import InputError

# Of the memory that is free: the rest is for the engine's hierarchy, the frames, and others.
SHARE = (3, 4)
# Where a system does not say what it has.
_UNKNOWN_MACHINE = 4 << 30

# What a scene holds, in bytes. An object: its name and path (Python strings, 60 to 150 each), its
# matrix (128), its box (48), its entries in lists and dictionaries of names.
OBJECT_BYTES = 600
# A vertex: three float32 and one for how far it moved, and float64 scratch while it is placed.
VERTEX_BYTES = 16 + 8
# A triangle: three int32, its flags, its object (int32), and int64 scratch while it is placed;
# and 80 in the hierarchy of the engine that casts it.
TRIANGLE_BYTES = 18 + 24 + 80
# A sample of a frame: 12 in the visibility buffer; rays, hits and disputes of the engine and the
# judge take some eight times that.
SAMPLE_BYTES = 100

_UNITS = {"": 0, "K": 1, "M": 2, "G": 3, "T": 4}
_SIZE = re.compile(r"([0-9]{1,15}(?:\.[0-9]{1,6})?)([KMGT]?)(I?B)?", re.IGNORECASE | re.ASCII)


def parse_size(text: str) -> int:
    """Bytes of a size such as 2G, 1.5GiB or 800M: K, M, G and T are powers of 1024.

    Raises InputError for anything else, and for less than 1 MiB.
    """
    match = _SIZE.fullmatch(text)
    size = 0
    if match is not None:
        size = int(float(match[1]) * 1024 ** _UNITS[match[2].upper()])
    if size < 1 << 20:
        raise InputError(
            f"a memory limit of {text[:40]!r} is not understood",
            place="--max-memory",
            fix="write a size such as 2G or 800M, at least 1M",
        )
    return size


def shown_size(size: int) -> str:
    """A size for people: `19 GiB`, `1.5 MiB`, to two digits at least."""
    value = float(size)
    for unit in ("bytes", "KiB", "MiB", "GiB", "TiB", "PiB"):
        if value < 1024.0 or unit == "PiB":
            break
        value /= 1024.0
    if unit == "bytes" and size == 1:
        return "1 byte"
    number = f"{value:.1f}".removesuffix(".0") if value < 10.0 else f"{value:,.0f}"
    return f"{number} {unit}"


@dataclass
class Budget:
    """What one input may take, in bytes, and what of it is claimed already.

    `given`: whether somebody chose the limit, or it is the machine's.
    """

    limit: int
    given: bool = False
    claimed: int = field(default=0, init=False)

    @classmethod
    def of(cls, max_memory: int | None) -> Budget:
        """The budget of `max_memory` bytes, or of this machine where that is None."""
        return cls(default_budget()) if max_memory is None else cls(max_memory, given=True)

    @property
    def left(self) -> int:
        """Bytes that nobody has claimed."""
        return max(0, self.limit - self.claimed)

    def claim(
        self,
        what: str,
        size: int = 0,
        *,
        objects: int = 0,
        vertices: int = 0,
        triangles: int = 0,
        place: str = "",
    ) -> None:
        """Claim memory that stays: `size` bytes, and what so many objects, vertices and triangles
        of a scene take. `what` names what expands to it ("30,000,000 instances × 12 triangles").

        Raises InputError, and claims nothing, where it does not fit beside what is claimed.
        """
        wanted = size + _scene_bytes(objects, vertices, triangles)
        self.need(what, wanted, place=place)
        self.claimed += wanted

    def need(
        self,
        what: str,
        size: int = 0,
        *,
        objects: int = 0,
        vertices: int = 0,
        triangles: int = 0,
        place: str = "",
    ) -> None:
        """Like `claim`, for memory that is given back at once: it must fit, and is not counted."""
        wanted = size + _scene_bytes(objects, vertices, triangles)
        if self.claimed + wanted <= self.limit:
            return
        whose = "the limit" if self.given else f"the limit, {SHARE[0]}/{SHARE[1]} of what is free,"
        beside = f" beside {shown_size(self.claimed)} before it" if self.claimed >= 1 << 20 else ""
        raise InputError(
            f"{what} would need about {shown_size(wanted)}{beside};"
            f" {whose} is {shown_size(self.limit)}",
            place=place,
            fix="give more with --max-memory, or make the scene smaller",
        )


def _scene_bytes(objects: int, vertices: int, triangles: int) -> int:
    return objects * OBJECT_BYTES + vertices * VERTEX_BYTES + triangles * TRIANGLE_BYTES


def default_budget(root: Path = Path("/")) -> int:
    """Bytes that an input may take on this machine: `SHARE` of the least of what the system has
    available, what is left of the control group's limit (version 1 or 2), and what is left of
    RLIMIT_AS and RLIMIT_DATA.

    `root`: where `proc` and `sys` are.
    """
    found = [_available(root), *_of_control_groups(root), *_of_resource_limits(root)]
    least = min((size for size in found if size is not None), default=_UNKNOWN_MACHINE)
    return max(1 << 20, least * SHARE[0] // SHARE[1])


def _available(root: Path) -> int | None:
    for line in _lines(root / "proc/meminfo"):
        words = line.split()
        if words[:1] == ["MemAvailable:"] and len(words) == 3 and words[1].isdecimal():
            return int(words[1]) * 1024
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError, AttributeError):
        return None


def _of_control_groups(root: Path) -> list[int]:
    """What is left in each control group that this process is in, and in those above it."""
    found = []
    mounted = root / "sys/fs/cgroup"
    for line in _lines(root / "proc/self/cgroup"):
        _, controllers, path = (*line.split(":", 2), "", "")[:3]
        if not controllers:
            base, limit, used, cache = mounted, "memory.max", "memory.current", "inactive_file"
        elif "memory" in controllers.split(","):
            base, cache = mounted / "memory", "total_inactive_file"
            limit, used = "memory.limit_in_bytes", "memory.usage_in_bytes"
        else:
            continue
        group = base / path.strip("/")
        # In a container the path is often the host's, and only the mount itself is seen.
        for folder in (group, *group.parents):
            most = _number(folder / limit)
            if most is not None:
                # Pages of files are given back when somebody asks for them.
                given_back = [
                    int(words[1])
                    for words in map(str.split, _lines(folder / "memory.stat"))
                    if words[:1] == [cache] and len(words) == 2 and words[1].isdecimal()
                ]
                taken = (_number(folder / used) or 0) - sum(given_back)
                found.append(max(0, most - max(0, taken)))
            if folder == base:
                break
    return found


def _of_resource_limits(root: Path) -> list[int]:
    try:
        import resource
    except ImportError:  # a system that has none
        return []
    taken = 0
    for line in _lines(root / "proc/self/statm"):
        taken = int(line.split()[0]) * os.sysconf("SC_PAGE_SIZE")
    found = []
    for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA):
        most = resource.getrlimit(kind)[0]
        if most != resource.RLIM_INFINITY:
            found.append(max(0, most - taken))
    return found


def _number(file: Path) -> int | None:
    """A file's number; None where there is none ("max")."""
    lines = _lines(file)
    return int(lines[0]) if lines and lines[0].strip().isdecimal() else None


def _lines(file: Path) -> list[str]:
    try:
        return file.read_text(encoding="utf-8", errors="replace").splitlines()
    except (OSError, ValueError):
        return []
