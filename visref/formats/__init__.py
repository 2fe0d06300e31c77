"""Scenes from files.

`load_scene` and `load_path` read files, `scene_from_trimesh` takes what trimesh has read. A
reader of another format is a `Reader`: a function from the file's path to a `Placed`, named
after the file's extension in the entry-point group `visref.scene_formats`:

    [project.entry-points."visref.scene_formats"]
    msh = "my_package:read_msh"

    def read_msh(path):
        placed = Placed()
        placed.meshes.append(Mesh.plain(positions, triangles))   # (v, 3) floats, (t, 3) integers
        placed.add("chair", 0, world_from_object)                # (4, 4) float64
        return placed

An object's id is its place in the order of `add`. The same mesh may be placed many times.
"""

from visref.formats.loading import (
    GLTF,
    Reader,
    known_extensions,
    load_path,
    load_scene,
    scene_from_trimesh,
)
from visref.formats.placed import NO_MESH, Mesh, Placed

__all__ = [
    "GLTF",
    "NO_MESH",
    "Mesh",
    "Placed",
    "Reader",
    "known_extensions",
    "load_path",
    "load_scene",
    "scene_from_trimesh",
]
