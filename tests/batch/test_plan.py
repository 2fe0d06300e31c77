"""A batch's file is read into jobs, or refused with the place; the schema refuses the same."""

from __future__ import annotations

import tomllib

import jsonschema
import pytest

from visref.batch import read_batch, worst
from visref.batch.plan import OPTIONS, jobs_of
from visref.errors import InputError
from visref.schemas import schema

GOOD = """
[options]
engine = "embree"
pictures = 2
lenient = true
time_limit = 5

[[job]]
name = "mine"
scene = "-odd.glb"
cullers = ["none"]
pictures = 0
truth = "truth.parquet"

[[matrix]]
scenes = ["a/room.glb", "b/room.glb", "city:scale=0.05,frames=2"]
paths = ["walk.path.json", "fly.json"]
cullers = ["frustum", "occlusion-query"]
lenient = false
"""


def test_jobs_are_those_of_job_and_each_scene_on_each_path():
    first, *others = jobs_of(tomllib.loads(GOOD))
    assert first.name == "mine"
    assert first.path is None
    assert first.arguments == [
        "--culler=none", "--engine=embree", "--truth=truth.parquet", "--pictures=0",
        "--time-limit=5", "--lenient", "--", "-odd.glb",
    ]  # fmt: skip
    assert [(job.scene, job.path) for job in others] == [
        (scene, path)
        for scene in ("a/room.glb", "b/room.glb", "city:scale=0.05,frames=2")
        for path in ("walk.path.json", "fly.json")
    ]
    assert {job.cullers for job in others} == {("frustum", "occlusion-query")}
    assert [job.name for job in others] == [
        "a-room-walk", "a-room-fly", "b-room-walk", "b-room-fly",
        "city-scale-0.05-frames-2-walk", "city-scale-0.05-frames-2-fly",
    ]  # fmt: skip
    assert others[0].options == ("--engine=embree", "--pictures=2", "--time-limit=5")


def test_jobs_without_a_name_are_told_apart():
    one = {"scene": "s.glb", "cullers": ["none"]}
    jobs = jobs_of({"job": [one, {**one, "name": "s"}, one]})
    assert [job.name for job in jobs] == ["s-2", "s", "s-3"]


JOB = {"scene": "s.glb", "cullers": ["none"]}
MATRIX = {"scenes": ["s.glb"], "cullers": ["none"]}
BAD = {
    "this is no table": [],
    "it asks for nothing": {},
    "jobs: nobody knows this field; did you mean 'job'": {"jobs": [JOB]},
    "job: it is no list of tables": {"job": JOB},
    "options: it is no table": {"options": [], "job": [JOB]},
    "options.truth: nobody knows": {"options": {"truth": "t"}, "job": [JOB]},
    "options.pictures: it is not a whole number": {"options": {"pictures": True}, "job": [JOB]},
    "job[0].scene: it is missing": {"job": [{"cullers": ["none"]}]},
    "job[0].scene: it is no text": {"job": [{**JOB, "scene": ""}]},
    "job[0].path: it is no text": {"job": [{**JOB, "path": 3}]},
    "job[1].cullers: it is missing": {"job": [JOB, {"scene": "t.glb"}]},
    "job[0].cullers: it is no list": {"job": [{**JOB, "cullers": "none"}]},
    "job[0].cullers[1]: it is no text": {"job": [{**JOB, "cullers": ["none", 1]}]},
    "job[0].cullers: 'none' is in it twice": {"job": [{**JOB, "cullers": ["none", "none"]}]},
    "job[0].name: it is no name": {"job": [{**JOB, "name": "../up"}]},
    "job[0].culler: nobody knows this field; did you mean 'cullers'": {
        "job": [{**JOB, "culler": "none"}]
    },
    "job[0].frames: it is not a text": {"job": [{**JOB, "frames": 3}]},
    "job[0].time_limit: it is not a number": {"job": [{**JOB, "time_limit": "3"}]},
    "job[0].lenient: it is not true or false": {"job": [{**JOB, "lenient": 1}]},
    "matrix[0].scenes: it is no list": {"matrix": [{**MATRIX, "scenes": []}]},
    "matrix[0].paths[0]: it is no text": {"matrix": [{**MATRIX, "paths": [""]}]},
    "matrix[0].name: nobody knows": {"matrix": [{**MATRIX, "name": "x"}]},
}


@pytest.mark.parametrize("problem", BAD)
def test_what_is_wrong_is_named_with_its_place_and_the_schema_refuses_it_too(problem):
    with pytest.raises(InputError) as refused:
        jobs_of(BAD[problem])
    assert problem in str(refused.value)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(BAD[problem], schema("batch"))


def test_what_is_read_fits_the_schema():
    jsonschema.validate(tomllib.loads(GOOD), schema("batch"))


def test_the_schema_knows_each_option():
    properties = schema("batch")["properties"]
    assert {*properties["options"]["properties"]} == {*OPTIONS} - {"truth"}
    assert {*properties["job"]["items"]["properties"]} >= {*OPTIONS}


def test_two_jobs_of_one_name_are_refused():
    job = {**JOB, "name": "twice"}
    with pytest.raises(InputError, match=r"job\[0\]\.name: two jobs are named 'twice'"):
        jobs_of({"job": [job, job]})


@pytest.mark.parametrize(
    ("text", "problem"),
    [(b"[[job]", "not valid TOML"), (b"\xff\xfe", "not UTF-8"), (b"job = 1", "no list of tables")],
)
def test_a_file_that_is_no_batch_is_named(text, problem, tmp_path):
    file = tmp_path / "b.toml"
    file.write_bytes(text)
    with pytest.raises(InputError, match=problem) as refused:
        read_batch(file)
    assert str(refused.value).startswith(str(file))


def test_every_option_of_a_job_is_one_of_run():
    import argparse

    from visref.cli.run import add_arguments

    parser = argparse.ArgumentParser()
    add_arguments(parser)
    known = {name for action in parser._actions for name in action.option_strings}
    assert {f"--{name.replace('_', '-')}" for name in OPTIONS} <= known


@pytest.mark.parametrize(
    ("statuses", "status"),
    [([], 0), ([0, 0], 0), ([0, 3], 3), ([3, 1, 0], 1), ([1, 2, 3], 2), ([2, 137], 70), ([70], 70)],
)
def test_the_status_of_a_batch_is_the_worst(statuses, status):
    assert worst(statuses) == status
