"""A stranger before the page of a run with 1,500 violations: of any object that somebody names, the
frame, the picture and the cause are three clicks away."""

from __future__ import annotations

import json
import re
from urllib.parse import parse_qs

import pytest

from tests.report.test_report import Reader
from tests.report.test_report_browser import ABOUT, LIST, ROWS, axe_findings, needs_axe, wait
from tests.support import chromium
from tests.support.many_losses import CAUSES, CULLERS, VIOLATIONS, frame_of, many_losses, name_of
from visref.report import crop_data
from visref.report.crop_data import CropData
from visref.report.object_list import ObjectList
from visref.report.pictured import PictureBudget, frame_views
from visref.report.summary import summarise
from visref.report.writing import write_report
from visref.run_folder.read import read_run

pytestmark = pytest.mark.slow
needs_chromium = pytest.mark.skipif(chromium.FOUND is None, reason="no Chromium on this machine")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return many_losses(tmp_path_factory.mktemp("many") / "run")


@pytest.fixture(scope="module")
def page_file(folder, tmp_path_factory):
    return write_report([folder], tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def listed(folder):
    """The columns of the page's list, and the frames that have a picture, by culler."""
    run = read_run(folder)
    rows = [summarise(run, culler) for culler in run.cullers]
    views, _ = frame_views(run, rows, PictureBudget())
    pictured = sorted((one.frame, one.view, each.culler) for one in views for each in one.cullers)
    its = ObjectList(run, pictured, CropData())
    for number, row in enumerate(rows):
        its.add(number, row)
    frames = {
        culler: {frame for frame, _, of in pictured if of == culler} for culler in run.cullers
    }
    return its.data(rows, folder), frames


def test_every_one_of_1500_lost_objects_has_a_frame_a_picture_and_a_cause(listed):
    data, _ = listed
    columns = data["columns"]
    assert len(columns["object"]) == VIOLATIONS
    for row in range(VIOLATIONS):
        assert columns["frame"][row] == frame_of(columns["culler"][row], columns["object"][row])
        assert max(columns["crop"][row], columns["pictured"][row]) >= 0, row
        assert data["whys"][columns["why"][row]] != ""


def test_the_page_says_which_object_lacks_a_picture_where_its_budget_ends(folder, monkeypatch):
    monkeypatch.setattr(crop_data, "MAX_BYTES", 20_000)
    run = read_run(folder)
    rows = [summarise(run, culler) for culler in run.cullers]
    its = ObjectList(run, [], CropData())
    for number, row in enumerate(rows):
        its.add(number, row)
    crops = its.data(rows, folder)["columns"]["crop"]
    assert 0 < sum(crop >= 0 for crop in crops) < VIOLATIONS


def test_every_cause_leads_to_a_picture_of_something_lost_by_it(folder, page_file, listed):
    run = read_run(folder)
    page = Reader(page_file.read_text(encoding="utf-8"))
    links = [attrs["href"] for attrs, text in page.find("a") if text.startswith("see ")]
    places = [{key: value[0] for key, value in parse_qs(link[1:]).items()} for link in links]
    told = {(place["culler"], place["frame"], place["object"]) for place in places}
    causes = {
        (row["culler"], str(row["frame"]), str(row["object"])): row["cause"]
        for row in run.objects.to_pylist()
        if row["pixels"] is not None
    }
    assert sorted(causes[one] for one in told) == sorted(CAUSES * CULLERS)
    assert all(int(frame) in listed[1][culler] for culler, frame, _ in told)


class Stranger:
    """Counts what a reader does. Typing into a field is as much as a click."""

    def __init__(self, page):
        self.page, self.clicks = page, 0

    def searches(self, text):
        self.clicks += 1
        self.page.click('.list [data-of="search"]')
        self.page.call("Input.insertText", text=text)
        wait(self.page, f"{LIST}.querySelector('[data-of=told]').textContent.includes(' of ')")

    def chooses(self, field, text):
        self.clicks += 1
        self.page.run(
            f"(() => {{ const s = {LIST}.querySelector('[data-of={field}]');"
            f"s.value = [...s.options].find(o => o.textContent === '{text}').value;"
            "s.dispatchEvent(new Event('input')); })()"
        )

    def opens(self, selector):
        self.clicks += 1
        self.page.click(selector)
        wait(self.page, f"!{ABOUT}.hidden")

    def reads(self):
        facts = self.page.run(
            f"Object.fromEntries([...{ABOUT}.querySelectorAll('.told div')]"
            ".map(e => [e.firstChild.textContent, e.lastChild.textContent]))"
        )
        crops = self.page.run(f"{ABOUT}.querySelectorAll('.compare canvas').length")
        whole = self.page.run(f"{ABOUT}.querySelectorAll('.whole img').length")
        return facts, crops, whole


@needs_chromium
@pytest.mark.parametrize("width", [1280, 390])
def test_frame_picture_and_cause_of_any_named_object_are_three_clicks_away(
    listed, page_file, width
):
    data, frames = listed
    # One of one culler's that no picture of a whole frame shows, as far from the first as can be.
    culler = data["cullers"][3]["name"]
    thing = max(i for i in range(300) if frame_of(3, i) not in set().union(*frames.values()))
    with chromium.browser() as page:
        page.open(page_file, width=width)
        wait(page, f"{ROWS}.length > 0")
        stranger = Stranger(page)
        stranger.searches(name_of(thing))
        assert page.run(f"{ROWS}.length") == CULLERS
        stranger.chooses("culler", culler)
        wait(page, f"{ROWS}.length === 1")
        stranger.opens(".list .row")
        assert stranger.clicks <= 3
        facts, crops, whole = stranger.reads()
        assert facts["worst in"].startswith(f"frame {frame_of(3, thing)}:")
        assert facts["behaves as if"]
        assert crops == 2
        assert whole == 0
        # Where the whole frame has no picture it says which has, and leads there.
        said = page.run(f"{ABOUT}.querySelector('.seen > .more').textContent")
        near = int(re.search(r"the nearest is frame (\d+)", said)[1])
        assert near in frames[culler]
        page.click(".about .seen > .more a")
        wait(
            page,
            f"document.querySelector('.browser output').textContent.startsWith('Frame {near} ')",
        )
        assert page.problems == []


@needs_chromium
def test_where_only_other_cullers_have_pictures_of_a_frame_the_scene_is_shown(listed, page_file):
    data, frames = listed
    culler = data["cullers"][3]["name"]
    thing = max(i for i in range(300) if frame_of(3, i) in frames[culler])
    with chromium.browser() as page:
        page.open(page_file)
        wait(page, f"{ROWS}.length > 0")
        own = f'.frame[data-frame="{frame_of(3, thing)}"] .own'
        page.run(
            f"document.querySelectorAll({json.dumps(own)}).forEach("
            f"(one) => {{ if (one.dataset.cullerName === '{culler}') one.remove(); }}); 0"
        )
        stranger = Stranger(page)
        stranger.searches(name_of(thing))
        stranger.chooses("culler", culler)
        wait(page, f"{ROWS}.length === 1")
        stranger.opens(".list .row")
        assert stranger.reads()[2] == 1
        shown = page.run(f"{ABOUT}.querySelector('.stack.whole img').alt")
        assert f"Frame {frame_of(3, thing)}: the scene as it ought to be seen" in shown
        assert page.run(f"{ABOUT}.querySelectorAll('.stack.whole .mark').length") == 1
        assert page.problems == []


@needs_chromium
def test_a_click_on_a_cause_opens_what_it_did(page_file):
    with chromium.browser() as page:
        page.open(page_file)
        wait(page, f"{ROWS}.length > 0")
        stranger = Stranger(page)
        stranger.opens(".because a")
        facts, _, whole = stranger.reads()
        cause = page.run("document.querySelector('.because').textContent")
        assert facts["behaves as if"].partition(" (score ")[0] in cause
        assert whole == 1
        assert page.problems == []


@needs_axe
@needs_chromium
def test_axe_finds_nothing_on_a_phone_with_an_object_open(page_file):
    with chromium.browser() as page:
        page.open(page_file, width=390)
        wait(page, f"{ROWS}.length > 0")
        page.click(".because a")
        wait(page, f"!{ABOUT}.hidden")
        assert axe_findings(page) == []
