"""How much memory an input may take, and who says so."""

from __future__ import annotations

import resource

import pytest

from visref.errors import InputError
from visref.memory import Budget, default_budget, parse_size, shown_size

GIB = 1 << 30


def machine(root, *, available=8 * GIB, cgroup="", files=()):
    """A file system that says what a machine has."""
    (root / "proc/self").mkdir(parents=True)
    (root / "proc/meminfo").write_text(f"MemTotal: 1 kB\nMemAvailable: {available // 1024} kB\n")
    (root / "proc/self/cgroup").write_text(cgroup)
    for name, text in files:
        file = root / "sys/fs/cgroup" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return root


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("2G", 2 * GIB),
        ("2g", 2 * GIB),
        ("1.5GiB", 3 * GIB // 2),
        ("800M", 800 << 20),
        ("4T", 4096 * GIB),
        ("1048576", 1 << 20),
    ],
)
def test_size_is_read(text, size):
    assert parse_size(text) == size


@pytest.mark.parametrize(
    "text",
    ["", "G", "-2G", "2_0G", "nan", "inf", "1e9", "2X", "2 G G", "1K", "0", "٢G", "2G\0", "9" * 99],
)
def test_what_is_no_size_is_refused_in_one_line(text):
    with pytest.raises(InputError, match="--max-memory: a memory limit of") as caught:
        parse_size(text)
    assert "\n" not in str(caught.value)


def test_default_is_three_quarters_of_what_is_available(tmp_path):
    assert default_budget(machine(tmp_path)) == 6 * GIB


@pytest.mark.parametrize(
    ("cgroup", "files"),
    [
        pytest.param(
            "0::/a/b\n",
            [("a/b/memory.max", "max\n"), ("a/memory.max", f"{2 * GIB}\n")],
            id="version-2-above",
        ),
        pytest.param("0::/host/path\n", [("memory.max", f"{2 * GIB}\n")], id="version-2-container"),
        pytest.param(
            "0::/a\n",
            [
                ("a/memory.max", f"{3 * GIB}"),
                ("a/memory.current", f"{2 * GIB}"),
                ("a/memory.stat", f"anon 1\ninactive_file {GIB}\n"),
            ],
            id="version-2-used",
        ),
        pytest.param(
            "3:cpu:/x\n2:memory:/x\n",
            [("memory/x/memory.limit_in_bytes", f"{2 * GIB}\n")],
            id="version-1",
        ),
    ],
)
def test_control_groups_limit_counts(tmp_path, cgroup, files):
    root = machine(tmp_path, cgroup=cgroup, files=files)
    assert default_budget(root) == 2 * GIB * 3 // 4


def test_resource_limit_counts(tmp_path, monkeypatch):
    limits = {resource.RLIMIT_AS: 4 * GIB, resource.RLIMIT_DATA: resource.RLIM_INFINITY}
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (limits[kind], limits[kind]))
    root = machine(tmp_path)
    pages = GIB // resource.getpagesize()
    (root / "proc/self/statm").write_text(f"{pages} 1 1 1 0 1 0\n")
    assert default_budget(root) == 3 * GIB * 3 // 4


def test_machine_that_says_nothing_has_a_limit_all_the_same(tmp_path):
    assert default_budget(tmp_path) >= 1 << 20


def test_claims_add_up_and_what_is_given_back_does_not():
    budget = Budget(100, given=True)
    budget.claim("a", 40)
    budget.need("b", 60)
    budget.claim("c", 60)
    assert budget.left == 0
    with pytest.raises(InputError):
        budget.need("d", 1)


def test_refusal_says_what_expands_and_to_what_in_one_line():
    budget = Budget.of(19 * GIB)
    with pytest.raises(InputError) as caught:
        budget.claim("30,000,000 instances × 12 triangles", objects=3 * 10**7, triangles=36 * 10**7)
    assert str(caught.value) == (
        "30,000,000 instances × 12 triangles would need about 58 GiB; the limit is 19 GiB;"
        " give more with --max-memory, or make the scene smaller"
    )
    assert budget.claimed == 0


def test_machines_limit_is_told_as_such():
    with pytest.raises(InputError, match="the limit, 3/4 of what is free, is 1 GiB"):
        Budget(GIB).claim("a thing", 2 * GIB)


@pytest.mark.parametrize(
    ("size", "text"),
    [
        (1, "1 byte"),
        (0, "0 bytes"),
        (1536, "1.5 KiB"),
        (2 * GIB, "2 GiB"),
        (19 * GIB + 5, "19 GiB"),
        (1 << 62, "4,096 PiB"),
    ],
)
def test_size_is_shown_in_few_digits(size, text):
    assert shown_size(size) == text
