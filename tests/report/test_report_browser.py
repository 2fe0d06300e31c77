"""The page in a headless Chromium, where one is installed: clicked, printed, in the dark."""

from __future__ import annotations

import itertools
import json
import os
import re
import time
from pathlib import Path

import pytest

from tests.support import chromium
from tests.support.big_run import big_run
from tests.support.report_runs import (
    BROKEN,
    WALL,
    WIDTH,
    Scripted,
    bench_folder,
    write_run,
    write_runs,
)
from visref.report import crop_data, crops, pictured
from visref.report.page import page_html
from visref.report.writing import write_report
from visref.run_folder.read import read_run

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(chromium.FOUND is None, reason="no Chromium on this machine"),
]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    return write_runs(tmp_path_factory.mktemp("runs"))


@pytest.fixture(scope="module")
def big_page(tmp_path_factory):
    """A page of 500 frames, 6 cullers and 5,000 lost objects of each."""
    folder = tmp_path_factory.mktemp("big")
    small = read_run(write_run(folder / "run", [("wall", Scripted((WALL,)))], frames=2))
    file = folder / "report.html"
    run = big_run(small, frames=500, cullers=6, objects=5000)
    file.write_text(page_html([run], [], folder), encoding="utf-8")
    return file


def test_a_page_of_30000_violations_is_below_8_megabytes(big_page):
    # Next to no pictures are in it: with as many as a page takes at most.
    pictures = pictured.MAX_PICTURE_BYTES + crops.MAX_CROP_BYTES + crop_data.MAX_BYTES
    assert big_page.stat().st_size + pictures < 8_000_000


def test_a_reader_can_click_through_the_page(runs, tmp_path):
    page_file = write_report([runs["violation"]], tmp_path)
    shown = "[...document.querySelectorAll('.frame')].filter(e => e.offsetParent)"
    with chromium.browser() as page:
        page.open(page_file)
        # It opens at the violation's worst pictured frame, one frame and one culler at a time.
        assert page.run(f"{shown}.length") == 1
        assert page.run("document.querySelector('[aria-pressed=true]').dataset.cullerName") == (
            BROKEN
        )
        first = page.run(f"{shown}[0].dataset.frame")
        assert page.run("document.querySelector('.own:not([hidden]) img').naturalWidth") == WIDTH
        before = page.run("document.querySelector('.browser output').textContent")
        assert before.startswith(f"Frame {first} (")

        page.click('.step[data-step="1"]')
        assert page.run(f"{shown}[0].dataset.frame") != first
        page.click('.step[data-step="-1"]')
        assert page.run(f"{shown}[0].dataset.frame") == first

        page.run(
            "(() => { const s = document.querySelector('input[type=range]'); s.value = s.max;"
            "s.dispatchEvent(new Event('input')); })()"
        )
        assert page.run("document.querySelector('.step[data-step=\"1\"]').disabled") is True

        page.click('.tabs button[data-culler-name="tight"]')
        assert page.run(
            f"{shown}[0].querySelector('figure.own:not([hidden]) figcaption').textContent"
        ).startswith("tight:")

        page.click(".frame:not([hidden]) .zoom")
        assert page.run("document.querySelectorAll('figure.wide').length") == 1

        # The pointer reads out a plot.
        where = page.run(
            "(() => { const e = document.querySelector('.plot svg');"
            "e.scrollIntoView({block: 'center', behavior: 'instant'});"
            "const r = e.getBoundingClientRect(); return [r.x + r.width - 14, r.y + 60]; })()"
        )
        page.call("Input.dispatchMouseEvent", type="mouseMoved", x=where[0], y=where[1])
        assert page.run("document.querySelector('.readout:not([hidden])').textContent").startswith(
            "Frame 4"
        )
        assert page.problems == []
        assert {url for url in page.requests if not url.startswith("data:")} == {
            page_file.resolve().as_uri()
        }


LIST = "document.querySelector('.list')"
ABOUT = f"{LIST}.querySelector('.about')"
ROWS = f"[...{LIST}.querySelectorAll('.row')]"


def typed(page, text):
    """Type into the search of the list."""
    page.click('.list [data-of="search"]')
    page.call("Input.insertText", text=text)
    wait(page, f"{LIST}.querySelector('[data-of=told]').textContent.includes(' of ')")


def pressed(page, key):
    for kind in ("keyDown", "keyUp"):
        page.call("Input.dispatchKeyEvent", type=kind, key=key, code=key)


def wait(page, condition):
    """Until it holds; a page that never gets there is a failed test."""
    for _ in range(1500):
        if page.run(condition):
            return
        time.sleep(0.02)
    raise AssertionError(condition)


def test_frame_picture_and_cause_of_a_named_object_are_three_clicks_away(runs, tmp_path):
    page_file = write_report([runs["violation"]], tmp_path)
    with chromium.browser() as page:
        page.open(page_file)
        wait(page, f"{ROWS}.length === 3")
        typed(page, "pill")
        assert page.run(f"{ROWS}.map(e => e.firstChild.textContent)") == ["pillar"]
        page.click(".list .row")
        wait(page, f"!{ABOUT}.hidden")
        told = page.run(f"{ABOUT}.textContent")
        assert "worst inframe 1: 81 of 81 samples" in told
        assert "causenone is known" in told
        # What ought to be seen over what was drawn, and the whole frame.
        assert page.run(f"{ABOUT}.querySelectorAll('canvas').length") == 2
        assert page.run(f"{ABOUT}.querySelector('.whole img').naturalWidth") == WIDTH
        # The frame browser went along.
        assert page.run("document.querySelector('.browser output').textContent").startswith(
            "Frame 1 ("
        )
        assert page.problems == []


def test_what_the_pointer_is_at_is_named(runs, tmp_path):
    page_file = write_report([runs["violation"]], tmp_path)
    with chromium.browser() as page:
        page.open(page_file)
        wait(page, f"{ROWS}.length === 3")
        # So that nothing moves any more when the pointer comes.
        page.run("document.documentElement.style.scrollBehavior = 'auto'; 0")
        page.run("location.hash = '#object=pillar'")
        wait(page, f"!{ABOUT}.hidden")
        where = page.run(
            "(() => { const e = document.querySelector('.compare .stack');"
            "e.scrollIntoView({block: 'center', behavior: 'instant'});"
            # The middle of the sample (37, 21), of 48 x 32, in the lattice that holds all of them.
            "const r = e.getBoundingClientRect();"
            "return [r.x + r.width * 37.5 / 48, r.y + r.height * 21.5 / 32]; })()"
        )
        page.call("Input.dispatchMouseEvent", type="mouseMoved", x=where[0], y=where[1])
        said = "document.querySelector('.compare output').textContent"
        wait(page, f"{said} !== ''")
        assert page.run(said) == "pixel (37, 21): pillar, lost; drawn: wall"


def test_a_link_leads_to_its_object_and_back_leads_away(runs, tmp_path):
    page_file = write_report([runs["violation"]], tmp_path)
    title = f"{ABOUT}.querySelector('h3')?.textContent"
    with chromium.browser() as page:
        page.open(page_file)
        wait(page, f"{ROWS}.length === 3")
        page.run("location.hash = '#frame=1&object=pillar'")
        wait(page, f"{title} === 'pillar'")
        page.run("location.hash = '#culler=module%3AForgets&object=1'")
        wait(page, f"{title}?.startsWith('<script>')")
        assert "module:Forgets" in page.run(f"{ABOUT}.textContent")
        page.run("history.back()")
        wait(page, f"{title} === 'pillar'")
        # By keyboard alone: the list, down, Enter.
        page.run(f"{LIST}.querySelector('[role=grid]').focus()")
        for key in ("Home", "ArrowDown", "Enter"):
            pressed(page, key)
        wait(page, f"{title}?.startsWith('<script>')")
        assert page.problems == []


def test_a_list_of_30000_holds_few_rows_and_finds_one(big_page):
    with chromium.browser() as page:
        page.open(big_page)
        wait(page, f"{ROWS}.length > 0")
        assert page.run(f"{ROWS}.length") < 60
        assert page.run(f"{LIST}.querySelector('[role=grid]').getAttribute('aria-rowcount')") == (
            "30001"
        )
        typed(page, "window 4321")
        assert page.run(f"{ROWS}.length") == 6
        page.run(
            f"(() => {{ const s = {LIST}.querySelector('[data-of=culler]'); s.value = '2';"
            "s.dispatchEvent(new Event('input')); })()"
        )
        wait(page, f"{ROWS}.length === 1")
        assert page.run(f"{ROWS}[0].children[1].textContent").endswith("way=2")


def test_print_shows_every_frame_and_no_control(runs, tmp_path):
    page_file = write_report([runs["violation"]], tmp_path)
    seen = "[...document.querySelectorAll('{}')].filter(e => e.offsetParent).length"
    with chromium.browser() as page:
        page.open(page_file)
        frames = page.run("document.querySelectorAll('.frame').length")
        assert page.run(seen.format(".frame")) == 1 < frames
        page.call("Emulation.setEmulatedMedia", media="print")
        assert page.run(seen.format(".frame")) == frames
        assert page.run(seen.format(".controls, .copy")) == 0


def test_dark_and_light_pages_can_be_read(runs, tmp_path):
    """Every text stands out from its page at 4.5 to 1 (WCAG 2.2, 1.4.3), in either scheme."""
    page_file = write_report([runs["violation"], bench_folder(tmp_path / "bench")], tmp_path)
    colours = """[...document.querySelectorAll('main *')]
        .filter(e => e.offsetParent && !e.closest('button, .glyph, svg, figure')
            && [...e.childNodes].some(n => n.nodeType === 3 && n.data.trim()))
        .map(e => getComputedStyle(e).color)"""
    with chromium.browser() as page:
        for scheme in ("light", "dark"):
            feature = {"name": "prefers-color-scheme", "value": scheme}
            page.call("Emulation.setEmulatedMedia", media="screen", features=[feature])
            page.open(page_file)
            paper = luminance(page.run("getComputedStyle(document.body).backgroundColor"))
            assert (paper > 0.5) == (scheme == "light")
            found = set(page.run(colours))
            assert len(found) > 2
            for colour in found:
                low, high = sorted((paper, luminance(colour)))
                assert (high + 0.05) / (low + 0.05) >= 4.5, (scheme, colour)


def luminance(colour):
    """Relative luminance (WCAG 2.2) of a colour as `rgb(r, g, b)`."""
    channels = [int(part) / 255 for part in re.findall(r"\d+", colour)[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_the_page_never_scrolls_sideways(runs, tmp_path):
    bench = bench_folder(tmp_path / "bench")
    page_file = write_report([runs["violation"], runs["clean"], bench], tmp_path)
    with chromium.browser() as page:
        for width in (360, 768, 1280):
            page.open(page_file, width=width)
            assert page.run("document.documentElement.scrollWidth") <= width


# Where the rules of https://github.com/dequelabs/axe-core are, if they are on this machine: `make
# test` puts them into the checkout where there is npm.
AXE = Path(
    os.environ.get("AXE_CORE")
    or Path(__file__, "../../../node_modules/axe-core/axe.min.js").resolve()
)
needs_axe = pytest.mark.skipif(not AXE.is_file(), reason="axe-core is not installed")


def axe_findings(page):
    """Of each rule that is broken its name, and where."""
    page.run(AXE.read_text(encoding="utf-8") + ";0")
    answer = page.call(
        "Runtime.evaluate",
        expression="axe.run(document, {resultTypes: ['violations']}).then(r => JSON.stringify("
        "r.violations.map(v => [v.id, v.nodes.map(n => n.target.join(' ') + ' ' + "
        "(n.any[0] || n.all[0] || n.none[0]).message)])))",
        awaitPromise=True,
        returnByValue=True,
    )
    return json.loads(answer["result"]["value"])


@needs_axe
def test_axe_finds_nothing_on_the_page_in_either_scheme(runs, tmp_path):
    bench = bench_folder(tmp_path / "bench")
    page_file = write_report([*runs.values(), bench], tmp_path)
    with chromium.browser() as page:
        for scheme in ("light", "dark"):
            feature = {"name": "prefers-color-scheme", "value": scheme}
            page.call("Emulation.setEmulatedMedia", media="screen", features=[feature])
            page.open(page_file)
            wait(page, f"{ROWS}.length > 0")
            # With an object open.
            page.run("location.hash = '#object=pillar'")
            wait(page, f"!{ABOUT}.hidden")
            assert axe_findings(page) == []


@needs_axe
def test_axe_can_find_something(runs, tmp_path):
    page_file = write_report([runs["clean"]], tmp_path)
    with chromium.browser() as page:
        page.open(page_file)
        page.run("document.querySelector('img').removeAttribute('alt'); 0")
        # The picture's button is named by it.
        assert {rule for rule, _ in axe_findings(page)} == {"button-name", "image-alt"}


def test_contents_lead_to_every_section(runs, tmp_path):
    page_file = write_report([runs["violation"]], tmp_path)
    with chromium.browser() as page:
        page.open(page_file)
        links = page.run(
            "[...document.querySelectorAll('.contents a')].map(a => a.getAttribute('href'))"
        )
        sections = page.run(
            "[...document.querySelectorAll('h2[id]')].map(h => '#' + h.id)"
            ".filter(id => !id.endsWith('-claims'))"
        )
        assert links == sections
        assert len(links) > 6
        levels = page.run(
            "[...document.querySelectorAll('h1, h2, h3, h4')].map(h => Number(h.tagName[1]))"
        )
        assert levels[0] == 1
        assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
