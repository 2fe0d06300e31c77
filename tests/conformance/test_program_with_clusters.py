"""A program tells clusters by a recording, and is judged by them."""

from __future__ import annotations

import sys

from visref.conformance.files import written_cases
from visref.conformance.suite import Judged, judged_on
from visref.plug_ins.command import Command, CommandCuller

# Each triangle is a cluster of its own; those from FIRST on are drawn.
_PROGRAM = """
import json, os, struct, sys
scene, path, out = sys.argv[1:4]
data = open(scene, "rb").read()
gltf = json.loads(data[20 : 20 + struct.unpack("<I", data[12:16])[0]])
head = json.load(open(path))
frames = head.pop("frames")
head.update(format="visref-recording", units="units.csv")
clusters = []
for number, node in enumerate(gltf["nodes"]):
    primitives = gltf["meshes"][node["mesh"]]["primitives"]
    size = sum(gltf["accessors"][p["indices"]]["count"] // 3 for p in primitives)
    clusters += [(number, k) for k in range(size)]
with open(os.path.join(os.path.dirname(out), "units.csv"), "w") as file:
    print("unit,object,first_triangle,triangle_count", file=file)
    for unit, (number, k) in enumerate(clusters):
        print(f"{unit},{number},{k},1", file=file)
with open(out, "w") as file:
    print(json.dumps(head), file=file)
    for number, frame in enumerate(frames):
        drawn = list(range(FIRST, len(clusters)))
        print(json.dumps({**frame, "frame": number, "visible": drawn}), file=file)
"""


def judged(first: int, folder) -> Judged:
    (case,) = [one for one in written_cases() if one.name == "half_of_a_wall_of_two_clusters"]
    program, scene = folder / "engine.py", folder / "scene.glb"
    program.write_text(_PROGRAM.replace("FIRST", str(first)))
    scene.write_bytes(case.files["scene.glb"])
    command = Command.parse(f"{sys.executable} {program} {{scene}} {{path}} {{recording}}")
    return judged_on(
        lambda: CommandCuller(command, scene, case.path, time_limit_s=60.0), case.case, case.truths
    )


def test_a_program_that_draws_all_clusters_passes_by_units_of_its_own(tmp_path):
    found = judged(0, tmp_path)
    assert (found.problems, found.unit_kind) == ((), "unit")


def test_a_cluster_that_is_left_out_convicts_though_its_object_shows(tmp_path):
    problem = judged(1, tmp_path).problems[0]
    assert "'wall' (object 0) lost" in problem
    assert "witness: pixel (" in problem
