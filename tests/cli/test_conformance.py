"""`visref conformance` as an engine's author uses it: the table, the files, the exit status."""

from __future__ import annotations

import json
import re
import shutil
import xml.etree.ElementTree as ET

import jsonschema
import pytest

from visref.cli.main import main
from visref.conformance.classes import CLASSES
from visref.conformance.files import EXPECTED, MANIFEST, write_suite
from visref.schemas import schema

# What lists of objects can answer; clusters ask for units.
OBJECTS = ",".join(name for name in CLASSES if name != "clusters")


@pytest.fixture(scope="module")
def suite(tmp_path_factory):
    folder = tmp_path_factory.mktemp("written") / "suite"
    write_suite(folder)
    return folder


def cases_of(suite):
    return json.loads((suite / MANIFEST).read_text())["cases"]


def all_of(case, row):
    return list(range(case["objects"]))


def visible(case, row):
    return [*row["visible"], *row["perhaps"]]


def nothing(case, row):
    return []


def record(suite, folder, drawn, only=None):
    """What an engine writes that draws what `drawn` says of a case and a row of expected.json."""
    expected = json.loads((suite / EXPECTED).read_text())["cases"]
    folder.mkdir(exist_ok=True)
    for case in cases_of(suite):
        if case["units"] is not None or (only is not None and case["name"] not in only):
            continue
        lines = {}
        for row in expected[case["name"]]:
            line = lines.setdefault(row["frame"], {"frame": row["frame"]})
            if "view" in row:
                line.setdefault("visible", {})[row["view"]] = drawn(case, row)
            else:
                line["visible"] = drawn(case, row)
        text = "".join(f"{json.dumps(line)}\n" for line in lines.values())
        (folder / f"{case['name']}.jsonl").write_text(text)
    return folder


@pytest.fixture(scope="module")
def right(suite, tmp_path_factory):
    """The recordings of an engine that draws what is visible."""
    return record(suite, tmp_path_factory.mktemp("recorded") / "right", visible)


@pytest.fixture
def recordings(right, tmp_path):
    """A copy of these, to be spoilt."""
    return shutil.copytree(right, tmp_path / "engine")


def results(tmp_path, *arguments):
    """Exit status, and the results by case."""
    file = tmp_path / "results.json"
    status = main(["conformance", *map(str, arguments), "--json", str(file)])
    written = json.loads(file.read_text())
    jsonschema.validate(written, schema("conformance_results"))
    assert written["exit_status"] == status
    return status, {one["name"]: one for one in written["cases"]}


def ways(found):
    return {one["result"] for one in found.values()}


def test_write_says_what_to_do_with_it(tmp_path, capsys):
    folder = tmp_path / "suite"
    assert main(["conformance", "--write", str(folder), "--seed", "3"]) == 0
    assert json.loads((folder / MANIFEST).read_text())["seed"] == 3
    said = capsys.readouterr().out
    count = len(cases_of(folder))
    assert f"{count} cases in {folder}; {folder / MANIFEST} lists them." in said
    assert f"visref conformance --recordings DIR --suite {folder}" in said


def test_suite_of_another_seed_is_judged_as_what_it_is(tmp_path, capsys):
    suite = tmp_path / "suite"
    write_suite(suite, 3)
    folder = record(suite, tmp_path / "engine", visible, only=["crowd", "slivers"])
    arguments = ("--recordings", folder, "--only", "crowd", "--only", "slivers")
    for more in (("--suite", suite), ("--seed", 3)):
        status, found = results(tmp_path, *arguments, *more)
        assert (status, ways(found)) == (0, {"passed"})
    shutil.copy(suite / MANIFEST, folder)
    status, found = results(tmp_path, *arguments)
    assert (status, ways(found)) == (0, {"passed"})
    # Without a word of the seed it would be taken for another's.
    (folder / MANIFEST).unlink()
    assert results(tmp_path, *arguments)[0] == 1


def test_engine_that_draws_everything_passes_as_conservative(suite, tmp_path):
    folder = record(suite, tmp_path / "engine", all_of)
    status, found = results(tmp_path, "--recordings", folder, "--suite", suite, "--can", OBJECTS)
    assert status == 0
    assert ways(found) == {"passed", "not run"}
    assert [name for name, one in found.items() if one["result"] == "not run"] == [
        case["name"] for case in cases_of(suite) if "clusters" in case["classes"]
    ]


def test_engine_that_draws_what_is_visible_passes_as_exact(suite, right, tmp_path):
    arguments = ("--recordings", right, "--suite", suite, "--can", OBJECTS, "--promise")
    for promise in ("conservative", "exact", "aggressive"):
        status, found = results(tmp_path, *arguments, promise)
        assert (status, ways(found)) == (0, {"passed", "not run"}), promise


def test_engine_that_draws_everything_is_convicted_of_less_than_all_promises(suite, tmp_path):
    folder = record(suite, tmp_path / "engine", all_of, only=["walk_through_a_city"])
    arguments = ("--recordings", folder, "--only", "walk_through_a_city", "--promise", "exact")
    status, found = results(tmp_path, *arguments)
    assert status == 1
    assert "DRAWN_HIDDEN" in found["walk_through_a_city"]["problems"][0]


def test_engine_that_draws_nothing_fails_every_case(suite, tmp_path):
    folder = record(suite, tmp_path / "engine", nothing)
    status, found = results(tmp_path, "--recordings", folder, "--suite", suite, "--can", OBJECTS)
    assert status == 1
    assert ways(found) == {"failed", "not run"}
    for one in found.values():
        if one["result"] == "failed":
            assert one["missed"] > 0
            assert one["problems"][0].startswith("MISSED_OBJECT")


def test_one_visible_object_left_out_fails_its_case_alone_with_its_witness(
    suite, recordings, tmp_path, capsys
):
    file = recordings / "crowd.jsonl"
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    lost = lines[1]["visible"].pop(0)
    file.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    status, found = results(
        tmp_path, "--recordings", recordings, "--suite", suite, "--can", OBJECTS
    )
    assert status == 1
    failed = [one for one in found.values() if one["result"] == "failed"]
    assert [one["name"] for one in failed] == ["crowd"]
    expected = json.loads((suite / EXPECTED).read_text())["cases"]["crowd"]
    samples = expected[1]["visible"][lost]
    (problem,) = failed[0]["problems"]
    assert re.fullmatch(
        rf"MISSED_OBJECT: frame 1 \(64 x 48\): '{lost}' \(object \d+\) lost {samples} of its "
        rf"{samples} samples; witness: pixel \(\d+, \d+\), triangle \d+ at depth [\d.]+",
        problem,
    )
    said = capsys.readouterr().out
    assert re.search(rf"^crowd +failed +{re.escape(problem)}$", said, re.MULTILINE)
    assert re.search(r"^\d+ cases: \d+ passed, 1 failed, 3 not run\.$", said, re.MULTILINE)
    assert "What was not run, or was measured alone, has not passed." in said


def test_one_view_of_several_is_judged_by_itself(suite, recordings, tmp_path):
    """What the left eye alone sees, drawn for the right alone."""
    file = recordings / "two_eyes.jsonl"
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    for line in lines:
        line["visible"]["left"], line["visible"]["right"] = (
            line["visible"]["right"],
            line["visible"]["left"],
        )
    file.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    status, found = results(tmp_path, "--recordings", recordings, "--only", "two_eyes")
    assert status == 1
    assert "view 'left'" in found["two_eyes"]["problems"][0]


def test_missing_recording_is_a_failure_where_the_engine_is_made_for_it(
    suite, recordings, tmp_path
):
    (recordings / "two_eyes.jsonl").unlink()
    arguments = ("--recordings", recordings, "--suite", suite, "--can")
    status, found = results(tmp_path, *arguments, OBJECTS)
    assert status == 1
    assert found["two_eyes"]["problems"] == [
        "there is no recording of it: two_eyes.jsonl is missing"
    ]
    assert [n for n, one in found.items() if one["result"] == "failed"] == ["two_eyes"]
    status, found = results(tmp_path, *arguments, OBJECTS.replace(",views", ""))
    assert status == 0
    assert found["two_eyes"]["result"] == "not run"
    assert found["two_eyes"]["reason"] == "the engine is not made for views"


def test_what_an_engine_cannot_is_not_run_though_it_was_recorded(right, tmp_path):
    status, found = results(tmp_path, "--recordings", right, "--can", "plain")
    assert status == 0
    for one in found.values():
        assert one["result"] == ("not run" if one["classes"] else "passed")


def test_lists_of_objects_are_no_answer_to_a_case_about_clusters(suite, tmp_path):
    name = "half_of_a_wall_of_two_clusters"
    folder = tmp_path / "engine"
    folder.mkdir()
    (folder / f"{name}.jsonl").write_text(
        "".join(f'{{"frame": {k}, "visible": [0, 1, 2]}}\n' for k in range(3))
    )
    arguments = ("--recordings", folder, "--only", name)
    status, found = results(tmp_path, *arguments)
    assert (status, found[name]["result"]) == (3, "not run")
    assert found[name]["reason"] == "it lists objects, and the case is about clusters"
    status, found = results(tmp_path, *arguments, "--can", "clusters")
    assert (status, found[name]["result"]) == (1, "failed")


def test_where_nothing_is_run_nothing_is_judged(right, tmp_path):
    arguments = ("--recordings", right, "--can", "plain", "--only", "two_eyes")
    assert results(tmp_path, *arguments)[0] == 3


# What is expected to fail.


def test_expected_failure_is_as_it_should_be_and_an_unexpected_pass_is_not(
    recordings, tmp_path, capsys
):
    (recordings / "crowd.jsonl").unlink()
    file = tmp_path / "expected.toml"
    file.write_text('can = []\n[[expect]]\ncase = "crowd"\nreason = "too many boxes"\n')
    arguments = ("--recordings", recordings, "--expected", file)
    status, found = results(tmp_path, *arguments)
    assert status == 0
    assert found["crowd"]["result"] == "expected failure"
    assert found["crowd"]["reason"] == "too many boxes"
    assert "1 expected failure" in capsys.readouterr().out
    with file.open("a") as more:
        more.write('[[expect]]\ncase = "slivers"\nreason = "they flicker"\n')
    status, found = results(tmp_path, *arguments)
    assert status == 1
    assert found["slivers"]["result"] == "unexpected pass"
    said = capsys.readouterr().out
    assert re.search(r"slivers +unexpected pass +expected to fail because: they flicker", said)


EXPECTATIONS = {
    "a misspelt case": ('[[expect]]\ncase = "glas"\nreason = "r"', r"did you mean 'glass'\?"),
    "a stale case": (
        '[[expect]]\ncase = "qqq"\nreason = "r"',
        r"expect\[0\]: there is no case 'qqq'",
    ),
    "no reason": ('[[expect]]\ncase = "glass"', "case 'glass' has no reason"),
    "an empty reason": ('[[expect]]\ncase = "glass"\nreason = " "', "case 'glass' has no reason"),
    "no case": ('[[expect]]\nreason = "r"', "it names no case"),
    "a case twice": ('[[expect]]\ncase = "glass"\nreason = "r"\n' * 2, r"expect\[1\].* twice"),
    "another key": ('[[expect]]\ncase = "glass"\nraeson = "r"', r"did you mean 'reason'\?"),
    "another table": ("[[expects]]\n", r"did you mean 'expect'\?"),
    "an unknown class": ('can = ["view"]', r"can: there is no class 'view'; did you mean 'views'"),
    "a class that is no list": ('can = "views"', "can: it is no list of classes"),
    "one table": ('expect = "glass"', r"expect: it is no list of tables"),
    "no TOML": ("can = [", "not valid TOML"),
    "no text": (b"\xff\xfe", "not UTF-8"),
    "nothing": ("", "the file is empty"),
}


@pytest.mark.parametrize("name", EXPECTATIONS)
def test_wrong_expectations_are_bad_input(right, tmp_path, capsys, name):
    text, told = EXPECTATIONS[name]
    file = tmp_path / "expected.toml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert main(["conformance", "--recordings", str(right), "--expected", str(file)]) == 2
    said = capsys.readouterr().err
    assert re.search(told, said)
    assert said.startswith(f"error: {file}")
    assert said.count("\n") == 1


# Bad input.


def spoilt(change):
    def spoil(folder, suite):
        change(folder)
        return ()

    return spoil


def of_another_seed(folder, suite):
    manifest = json.loads((suite / MANIFEST).read_text()) | {"seed": 5}
    (folder / MANIFEST).write_text(json.dumps(manifest))
    return ()


def of_an_edited_file(folder, suite):
    copied = shutil.copytree(suite, folder.parent / "edited")
    file = copied / "glass" / "scene.glb"
    file.write_bytes(file.read_bytes() + b" ")
    return "--suite", copied


def of_a_suite_without_a_file(folder, suite):
    copied = shutil.copytree(suite, folder.parent / "less")
    (copied / "glass" / "path.json").unlink()
    return "--suite", copied


WRONG = {
    "an edited scene": (of_an_edited_file, "glass/scene.glb: the file is not as it was written"),
    "a path that is gone": (of_a_suite_without_a_file, "glass/path.json: cannot read the file"),
    "the suite itself": (
        spoilt(lambda d: (d / EXPECTED).write_text("{}")),
        "engine: this is the suite itself; give the recordings a folder of their own",
    ),
    "a misspelt name": (
        spoilt(lambda d: (d / "crowd.jsonl").rename(d / "crwod.jsonl")),
        r"crwod.jsonl: it is of no case of the suite; did you mean 'crowd'\?",
    ),
    "a file of none": (
        spoilt(lambda d: (d / "notes.txt").write_text("hello")),
        r"notes.txt: it is of no case of the suite; take it out",
    ),
    "a folder": (spoilt(lambda d: (d / "more").mkdir()), r"more: it is of no case"),
    "a folder with a case's name": (
        spoilt(lambda d: (d / "crowd.csv").mkdir()),
        r"crowd.jsonl: there is crowd.csv too; keep one",
    ),
    "two of one case": (
        spoilt(lambda d: (d / "crowd.csv").write_text("frame,object_id\n0,1\n")),
        r"crowd.jsonl: there is crowd.csv too; keep one",
    ),
    "a recording of another case": (
        spoilt(lambda d: shutil.copy(d / "rolled_and_pitched_camera.jsonl", d / "crowd.jsonl")),
        r"crowd.jsonl: line 1.*the scene has no object named 'ground'",
    ),
    "a recording of a longer path": (
        spoilt(lambda d: shutil.copy(d / "fast_turn.jsonl", d / "jump_cuts.jsonl")),
        r"jump_cuts.jsonl: line 6.*frame 5 is not on the path \(0…4\)",
    ),
    "an empty file": (
        spoilt(lambda d: (d / "crowd.jsonl").write_text("")),
        r"crowd.jsonl: frame: 3 of 3 frames are missing: 0, 1, 2",
    ),
    "no JSON": (spoilt(lambda d: (d / "crowd.jsonl").write_text("{\n")), r"crowd.jsonl: line 1"),
    "another seed": (of_another_seed, r"manifest.json: cases: its case '\w+' is not the one of"),
    "a seed that is not the suite's": (
        lambda d, suite: ("--suite", suite, "--seed", 4),
        r"manifest.json: seed: the suite was written with seed 0, and 4 was asked for",
    ),
    "no suite": (lambda d, suite: ("--suite", d), r"manifest.json: cannot read the file"),
    "an unknown case": (lambda d, suite: ("--only", "crwod"), r"--only: .* did you mean 'crowd'"),
    "an unknown class": (lambda d, suite: ("--can", "view"), r"--can view: .*did you mean 'views'"),
    "a culler's option": (lambda d, suite: ("--write", d), "not allowed with argument"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_input_is_refused_in_one_line(suite, recordings, capsys, name):
    spoil, told = WRONG[name]
    more = map(str, spoil(recordings, suite))
    arguments = ["conformance", "--recordings", str(recordings), *more]
    if "not allowed" in told:
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 2
        return
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert re.search(told, said.err), said.err
    assert said.err.count("\n") == 1
    assert said.out == ""


def test_a_folder_without_recordings_is_refused(tmp_path, capsys):
    assert main(["conformance", "--recordings", str(tmp_path)]) == 2
    assert "there is no recording in it" in capsys.readouterr().err
    assert main(["conformance", "--recordings", str(tmp_path / "absent")]) == 2
    assert "cannot read the folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        ("--write", "{}", "--can", "views"),
        ("--write", "{}", "--suite", "{}"),
        ("--write", "{}", "--junit", "{}/results.xml"),
        ("--culler", "none", "--suite", "{}"),
        ("--culler", "none", "--promise", "exact"),
    ],
)
def test_an_option_that_would_do_nothing_is_refused(tmp_path, capsys, arguments):
    folder = tmp_path / "folder"
    assert main(["conformance", *(one.format(folder) for one in arguments)]) == 2
    assert re.search(rf"{arguments[2]} does not go with {arguments[0]}", capsys.readouterr().err)
    assert not folder.exists()


def test_classes_are_said_once(right, tmp_path, capsys):
    file = tmp_path / "expected.toml"
    file.write_text("can = []\n")
    arguments = ["conformance", "--recordings", str(right), "--expected", str(file)]
    assert main([*arguments, "--can", "views"]) == 2
    assert "say it in one of them" in capsys.readouterr().err


# Reports.


def test_junit_has_each_case_and_passes_none_that_was_not_run(recordings, tmp_path):
    (recordings / "glass.jsonl").unlink()
    (recordings / "crowd.jsonl").unlink()
    file, junit = tmp_path / "expected.toml", tmp_path / "results.xml"
    file.write_text(
        'can = ["blending", "masks"]\n'
        '[[expect]]\ncase = "crowd"\nreason = "too many"\n'
        '[[expect]]\ncase = "slivers"\nreason = "they flicker"\n'
    )
    arguments = ("--recordings", recordings, "--expected", file, "--junit", junit)
    status, found = results(tmp_path, *arguments)
    assert status == 1
    (suite,) = ET.parse(junit).getroot()
    cases = {case.get("name"): case for case in suite.iter("testcase")}
    assert list(cases) == list(found)
    assert suite.get("name") == "engine"
    assert int(suite.get("tests")) == len(found)
    assert int(suite.get("failures")) == 2
    skipped = [name for name, case in cases.items() if case.find("skipped") is not None]
    assert int(suite.get("skipped")) == len(skipped)
    assert skipped == [
        name for name, one in found.items() if one["result"] in ("not run", "expected failure")
    ]
    assert cases["glass"].find("failure").get("type") == "failed"
    assert "glass.jsonl is missing" in cases["glass"].find("failure").text
    assert cases["slivers"].find("failure").get("type") == "unexpected_pass"
    assert "they flicker" in cases["slivers"].find("failure").get("message")
    assert cases["crowd"].find("skipped").get("message") == "expected failure: too many"
    assert "not made for views" in cases["two_eyes"].find("skipped").get("message")
    assert "trap: " in cases["glass"].find("system-out").text


def test_results_do_not_replace_what_is_no_result(right, tmp_path, capsys):
    file = tmp_path / "notes.txt"
    file.write_text("mine")
    for option in ("--junit", "--json"):
        arguments = [
            "conformance",
            "--recordings",
            str(right),
            "--only",
            "crowd",
            option,
            str(file),
        ]
        assert main(arguments) == 2
        assert file.read_text() == "mine"


# Cullers.


def test_wrong_culler_of_somebody_elses_is_convicted_in_a_process_of_its_own(tmp_path, capsys):
    name = "tests.wrong_cullers.frustum:CornersOnly"
    arguments = ("--culler", name, "--only", "walk_through_a_city", "--only", "sliding_door")
    status, found = results(tmp_path, *arguments)
    assert status == 1
    assert found["walk_through_a_city"]["problems"][0].startswith("MISSED_OBJECT: frame 1")
    assert found["sliding_door"]["result"] == "not run"
    assert found["sliding_door"]["reason"].startswith(f"'{name}' has no update()")


def test_right_culler_passes_and_the_contract_is_asked_too(tmp_path):
    cases = ("peeking_by_a_pixel", "answers_repeat", "close_at_any_time", "empty_scene")
    only = [word for name in cases for word in ("--only", name)]
    status, found = results(tmp_path, "--culler", "tests.wrong_cullers.frustum:Frustum", *only)
    assert status == 0
    assert {name: one["result"] for name, one in found.items()} == dict.fromkeys(
        ("peeking_by_a_pixel", "empty_scene", "answers_repeat", "close_at_any_time"), "passed"
    )


def test_unknown_culler_is_bad_input(capsys):
    assert main(["conformance", "--culler", "frustrum"]) == 2
    assert "did you mean 'frustum'" in capsys.readouterr().err
