"""The page in a headless Chromium, where one is installed: clicked, printed, in the dark."""

from __future__ import annotations

import re

import pytest

from tests.support import chromium
from tests.support.report_runs import BROKEN, WIDTH, bench_folder, write_runs
from visref.report import write_report

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(chromium.FOUND is None, reason="no Chromium on this machine"),
]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    return write_runs(tmp_path_factory.mktemp("runs"))


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
        before = page.run("document.querySelector('output').textContent")
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

        # A loss's link leads to its frame and culler.
        page.click("[data-go-frame]")
        go = page.run("({...document.querySelector('[data-go-frame]').dataset})")
        assert page.run(f"{shown}[0].dataset.frame") == go["goFrame"]
        assert (
            page.run("document.querySelector('[aria-pressed=true]').dataset.cullerName")
            == (go["goCuller"])
        )

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
