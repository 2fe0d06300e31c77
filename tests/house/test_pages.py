"""What the README and the pages of docs/ show runs, and the site is built of them."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import visref
from tests.cli.test_cli import write_scene
from tests.support.page_blocks import blocks, lines, run
from visref.schemas import NAMES

ROOT = Path(__file__).parent.parent.parent
DOCS = ROOT / "docs"


def page(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


SHOWN = """
Text.

1. In a list

   ```sh
   pip install visref
   echo one > said
   test -e nothing   # exit status 1
   ```

```python
open("said", "a").write("two\\n")
```
"""


def test_the_runner_runs_what_a_page_shows_in_its_order(tmp_path):
    assert len(run(SHOWN, tmp_path)) == 3
    assert (tmp_path / "said").read_text() == "one\ntwo\n"


@pytest.mark.parametrize(
    ("shown", "other"),
    [("# exit status 1", "# exit status 0"), ("echo one", "ecko one"), ('("said"', '("sad", "x"')],
)
def test_the_runner_notices_what_ends_otherwise(shown, other, tmp_path):
    with pytest.raises(AssertionError):
        run(SHOWN.replace(shown, other), tmp_path)


def test_the_readmes_commands_run_on_an_engines_recording(tmp_path):
    """It forgets an object that is in view, as the README's engine does."""
    _, path = write_scene(tmp_path)
    camera = json.loads(Path(path).read_text())
    (frame, *_) = camera.pop("frames")
    header = {**camera, "format": "visref-recording"}
    rows = [header, {**frame, "frame": 0, "visible": ["front"]}]
    (tmp_path / "frames.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    assert len(run(page("README.md"), tmp_path)) == 2
    assert (tmp_path / "page" / "report.html").is_file()
    verdict = json.loads((tmp_path / "run" / "verdict.json").read_text())
    assert [one["object"] for one in verdict["findings"] if one["severity"] == "error"] == [
        "beside"
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["start", "your-engine", "papers"])
def test_what_a_page_shows_runs_from_its_first_command_to_its_last(name, tmp_path):
    assert run(page(f"docs/{name}.md"), tmp_path)


def test_the_page_of_the_start_catches_what_its_engine_forgets():
    """Without running it again: the objects are of the scene that it generates."""
    named = re.findall(r"block\d+/[\w/-]+", page("docs/start.md"))
    assert {"block000/office-3", "block000/office-3/glazing"} <= set(named)


@pytest.mark.slow
def test_the_culler_that_a_page_writes_is_judged_as_the_page_says(tmp_path):
    text = page("docs/write-a-culler.md")
    python, *_ = (block for block in blocks(text) if block.language == "python")
    (tmp_path / "mine.py").write_text(python.text)
    assert run(text, tmp_path, ("sh",))
    verdict = json.loads((tmp_path / "run" / "verdict.json").read_text())
    assert {one["status"] for one in verdict["cullers"].values()} == {"no_violation_found"}


def test_every_command_line_of_the_pages_is_in_a_block_that_is_run():
    ran = {"start", "your-engine", "papers", "write-a-culler"}
    shown = {
        file.stem
        for file in DOCS.rglob("*.md")
        if any(block.language == "sh" and lines(block) for block in blocks(file.read_text("utf-8")))
    }
    # Those of others are run by tests of theirs.
    assert ran <= shown


def test_the_page_of_the_api_has_every_public_name_and_no_other():
    listed = re.findall(r"^::: visref\.(\w+)$", page("docs/api.md"), re.MULTILINE)
    assert sorted(listed) == sorted({*visref.__all__} - {"__version__"})


def test_the_page_of_the_schemas_has_each():
    listed = re.findall(
        r"^\| \[`(\w+)`\]\(\.\./visref/schemas/\1\.json\)", page("docs/schemas.md"), re.M
    )
    assert sorted(listed) == sorted(NAMES)


def build(folder: Path, *more: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(folder)]
    return subprocess.run([*command, *more], cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_its_links_lead_somewhere(tmp_path):
    pytest.importorskip("mkdocs")
    built = build(tmp_path)
    assert built.returncode == 0, built.stderr
    # A folder's README is its index.
    named = [
        re.sub(r"README\.md$", "index.md", str(one.relative_to(DOCS))) for one in DOCS.rglob("*.md")
    ]
    ours = {Path(name).with_suffix(".html") for name in named}
    made = {file.relative_to(tmp_path) for file in tmp_path.rglob("*.html")}
    assert made == ours | {Path("404.html")}
    leads = 0
    for file in ours:
        html = (tmp_path / file).read_text(encoding="utf-8")
        for link in re.findall(r'(?:href|src)="(?!\w+:)([^"#?]+)', html):
            assert ((tmp_path / file).parent / link).exists(), (file, link)
            leads += 1
    assert leads > 1000


@pytest.mark.slow
@pytest.mark.parametrize(
    "wrong", ["[x](nowhere.md)", "[x](verdict.md#nowhere)", "[x](../nowhere.py)"]
)
def test_a_link_that_leads_nowhere_stops_the_site(wrong, tmp_path):
    pytest.importorskip("mkdocs")
    docs = tmp_path / "docs"
    docs.mkdir()
    for name, text in {"index": f"# Index\n\n{wrong}\n", "verdict": "# Verdict\n"}.items():
        (docs / f"{name}.md").write_text(text)
    settings = "site_name: x\nstrict: true\nvalidation: {links: {not_found: warn, anchors: warn}}\n"
    config = tmp_path / "mkdocs.yml"
    config.write_text(f"{settings}hooks: [{ROOT / 'tools' / 'docs_hooks.py'}]\nnav: [index.md]\n")
    built = build(tmp_path / "site", "-f", str(config))
    assert built.returncode != 0
    assert "nowhere" in built.stderr
