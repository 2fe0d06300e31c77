"""The page shows what each convicted object ought to have looked like, within its budget."""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path

import pytest
from PIL import Image

from tests.report.test_report import Reader
from tests.support.report_runs import NASTY, VISIBLE, WALL, Scripted, write_run
from visref.report import crops
from visref.report.page import page_html
from visref.run_folder.read import read_run


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("crops") / "run"
    return write_run(folder, [("one", Scripted((WALL,))), ("none", Scripted(()))], frames=2)


def images(folder: Path) -> list[dict[str, str]]:
    page = page_html([read_run(folder)], [], folder)
    return [attrs for attrs, _ in Reader(page).find("img") if "loading" in attrs]


def test_every_convicted_object_that_is_listed_has_what_ought_to_be_seen_and_what_was_drawn(run):
    found = images(run)
    # Two objects of the one culler, three of the other.
    assert len(found) == 2 * (2 + len(VISIBLE))
    for ought, drawn in zip(found[::2], found[1::2], strict=True):
        assert ought["alt"].startswith("What ought to be seen around pixel (")
        assert drawn["alt"].startswith("What was drawn around pixel (")
        name = ought["alt"].split(": ", 1)[1].split(", in vermilion")[0]
        assert name in drawn["alt"]
        for image in (ought, drawn):
            kind, _, content = image["src"].partition(",")
            assert kind == "data:image/png;base64"
            picture = Image.open(io.BytesIO(base64.b64decode(content)))
            assert picture.size == (int(image["width"]), int(image["height"]))
        assert ought["src"] != drawn["src"]
    assert any("alert" in image["alt"] for image in found)
    assert NASTY not in page_html([read_run(run)], [], run)


def test_pictures_end_where_the_budget_does_and_the_worst_come_first(run, monkeypatch):
    every = images(run)
    size = len(every[0]["src"]) + len(every[1]["src"])
    monkeypatch.setattr(crops, "MAX_CROP_BYTES", size)
    assert images(run) == every[:2]
    monkeypatch.setattr(crops, "MAX_CROP_BYTES", 10**9)
    monkeypatch.setattr(crops, "MAX_CROPPED", 3)
    assert images(run) == every[:6]
    monkeypatch.setattr(crops, "MAX_CROP_BYTES", size - 1)
    assert images(run) == []


def test_a_page_never_carries_more_than_its_budget(run):
    budget = crops.CropBudget()
    (file,) = (run / "witnesses").glob("none*.jsonl")
    witness = json.loads(file.read_text().splitlines()[0])
    shown = [budget.crops(witness) for _ in range(2 * crops.MAX_CROPPED)]
    assert sum(map(bool, shown)) <= crops.MAX_CROPPED
    assert sum(len(crop.uri) for pair in shown for crop in pair) <= crops.MAX_CROP_BYTES
    assert shown[0]


def test_witnesses_without_surroundings_have_no_pictures(run, tmp_path):
    copy = write_run(tmp_path / "run", [("one", Scripted((WALL,)))], frames=1)
    (file,) = (copy / "witnesses").glob("*.jsonl")
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    for line in lines:
        del line["surroundings"]
    file.write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert images(copy) == []


def test_the_page_tells_the_plain_facts_of_each_convicted_object(run):
    page = Reader(page_html([read_run(run)], [], run))
    told = [text for attrs, text in page.find("p") if attrs.get("class") == "known"]
    assert len(told) == 2 + len(VISIBLE)
    for text in told:
        assert "image's edge" in text or "image’s edge" in text
        assert "from the eye" in text
