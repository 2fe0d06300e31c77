"""The container file, as far as it can be read without a container engine."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import visref

ROOT = Path(visref.__file__).parent.parent


def steps() -> list[tuple[str, str]]:
    """The instructions in their order: keyword and the rest, continued lines joined."""
    text = (ROOT / "Containerfile").read_text(encoding="utf-8")
    text = re.sub(r"(?m)^#.*\n", "", text).replace("\\\n", " ")
    return [(line.split()[0], " ".join(line.split()[1:])) for line in text.splitlines() if line]


def test_it_ends_as_a_user_without_rights_who_calls_visref():
    last = dict(steps())
    assert re.fullmatch(r"[1-9]\d*", last["USER"])
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert json.loads(last["ENTRYPOINT"])[0] in scripts["scripts"]
    keywords = [keyword for keyword, _ in steps()]
    # Nothing is built by the user, and nothing runs as root after it.
    assert "RUN" not in keywords[keywords.index("USER") :]


def test_it_installs_extras_and_system_packages_that_there_are():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    runs = " ".join(rest for keyword, rest in steps() if keyword == "RUN")
    (extras,) = re.findall(r"source\[([\w,]+)\]", runs)
    assert set(extras.split(",")) == set(project["optional-dependencies"]) - {
        "dev",
        "bench",
        "engines",
        "docs",
    }
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    (packages,) = re.findall(r"(?m)^SYSTEM_PACKAGES := (.*)$", makefile)
    (installed,) = re.findall(r"--no-install-recommends (.*?) &&", runs)
    assert installed.split() == packages.split()


def test_its_base_is_an_argument_that_names_no_host():
    first, base = steps()[0]
    assert first == "ARG"
    assert re.fullmatch(r"BASE=[\w:.-]+", base)
    assert steps()[1] == ("FROM", "${BASE}")
