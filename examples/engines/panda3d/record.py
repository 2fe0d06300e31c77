"""Panda3D draws a scene along a camera path, and records what was in its draw list.

    python record.py SCENE.glb PATH.json RECORDING.jsonl [--occluders N] [--bounds sphere|box|best]
        [--no-culling] [--pictures DIR]
    python record.py --suite SUITE OUT        every case of `visref conformance --write SUITE`

After each frame the *cull result* is asked for, the list of Geoms that Panda hands to its draw
traversal (`DisplayRegion.make_cull_result_graph`). To know them again there, each object has a
flat colour of its own, without light and texture; no culling looks at a colour. So the frame buffer
is an item buffer as well, which `--pictures` keeps.

--occluders N: the N largest upright rectangles of opaque objects become OccluderNodes, as Panda
culls by what is marked as an occluder alone. Needs panda3d and panda3d-gltf (the extra `engines`);
the recorder is ../../../recorders/python.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import struct
import sys
import tempfile
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

from panda3d import core

core.load_prc_file_data(
    "",
    "window-type offscreen\nload-display p3headlessgl\naudio-library-name null\n"
    "notify-level error\ngl-coordinate-system default\nsync-video false\n",
)

import gltf  # noqa: E402 (it reads the configuration above)

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "recorders" / "python"))
from visref_recorder import Recorder, from_panda3d  # noqa: E402

Json = dict[str, Any]
# Cosine of an angle that is right but for the rounding of float32 corners.
RIGHT_ANGLE = 1e-5


def read_glb(file: Path) -> tuple[Json, bytes]:
    """The JSON of a GLB, and the bytes of its other chunks."""
    data = file.read_bytes()
    magic, version, _, length, kind = struct.unpack_from("<IIIII", data)
    if (magic, version, kind) != (0x46546C67, 2, 0x4E4F534A):
        raise SystemExit(f"{file} is no GLB of version 2")
    return json.loads(data[20 : 20 + length]), data[20 + length :]


def write_glb(file: Path, document: Json, rest: bytes) -> None:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<IIIII", 0x46546C67, 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    file.write_bytes(head + text + rest)


def rows(matrix: Iterable[Iterable[float]]) -> core.LMatrix4:
    """Panda's matrix of a glTF one: (x, y, z) there is (x, -z, y) here, on both sides, and vectors
    are rows."""
    (xx, xy, xz, xw), (yx, yy, yz, yw), (zx, zy, zz, zw), _ = (list(row) for row in matrix)
    columns = (xx, -zx, yx, 0, -xz, zz, -yz, 0, xy, -zy, yy, 0, xw, -zw, yw, 1)
    return core.LMatrix4(*columns)


class Panda:
    """One scene in Panda3D, seen through one off-screen buffer."""

    def __init__(self, scene: Path, options: argparse.Namespace) -> None:
        document, rest = read_glb(scene)
        self.names = [node.get("name", "") for node in document.get("nodes", ())]
        self.hides = [hides(document, node) for node in document.get("nodes", ())]
        self.root = core.NodePath("render")
        self._load(document, rest)
        self.objects = dict(self._objects())
        self.by_colour: dict[tuple[int, ...], int] = {}
        self.rest = {node: one.get_mat() for node, one in self.objects.items()}
        for node, one in self.objects.items():
            one.set_light_off(1)
            one.set_texture_off(1)
            one.set_transparency(core.TransparencyAttrib.M_none, 1)
            colour = colour_of(node)
            one.set_color(*(part / 255 for part in colour), 1, 1)
            self.by_colour[colour] = node
        self.walls: list[tuple[int, core.NodePath]] = []
        for node, quad in self._largest_walls(options.occluders):
            occluder = core.OccluderNode("wall")
            occluder.set_vertices(*quad)
            occluder.set_double_sided(True)
            self.walls.append((node, self.objects[node].attach_new_node(occluder)))
        if options.no_culling:
            self.root.node().set_bounds(core.OmniBoundingVolume())
            self.root.node().set_final(True)
        self._open()

    def _load(self, document: Json, rest: bytes) -> None:
        """By panda3d-gltf. Nodes are called by their number, since names need not be unique; what
        the file animates stands still."""
        for number, node in enumerate(document.get("nodes", ())):
            node["name"] = str(number)
        self.animated = document.pop("animations", None) is not None
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "scene.glb")
            write_glb(file, document, rest)
            core.NodePath(gltf.load_model(str(file))).reparent_to(self.root)

    def _objects(self) -> Iterator[tuple[int, core.NodePath]]:
        for drawn in self.root.find_all_matches("**/+GeomNode"):
            yield int(drawn.parent.name), drawn.parent

    def _open(self) -> None:
        self.engine = core.GraphicsEngine.get_global_ptr()
        pipe = core.GraphicsPipeSelection.get_global_ptr().make_default_pipe()
        wanted = core.FrameBufferProperties()
        wanted.set_rgba_bits(8, 8, 8, 8)
        wanted.set_depth_bits(24)
        wanted.set_multisamples(0)
        size = core.WindowProperties.size(64, 48)
        refuse = core.GraphicsPipe.BF_refuse_window
        self.buffer = self.engine.make_output(pipe, "view", 0, wanted, size, refuse)
        if self.buffer is None:
            raise SystemExit("Panda3D opens no off-screen buffer here")
        self.buffer.set_clear_color((0, 0, 0, 1))
        self.lens: core.Lens = core.PerspectiveLens()
        self.camera = self.root.attach_new_node(core.Camera("camera", self.lens))
        self.region = self.buffer.make_display_region()
        self.region.camera = self.camera

    def _largest_walls(self, most: int) -> Iterator[tuple[int, list[core.LPoint3]]]:
        """The largest upright rectangles of opaque objects: two triangles that follow one
        another in a Geom, lie in one plane and share an edge."""
        found = []
        for node, one in self.objects.items() if most else ():
            if self.hides[node]:
                for quad in rectangles(one):
                    area = (quad[1] - quad[0]).cross(quad[3] - quad[0]).length()
                    found.append((-area, node, quad))
        for _, node, quad in sorted(found, key=lambda wall: wall[:2])[:most]:
            yield node, quad

    def pose(self, frame: Json) -> None:
        """Objects stand as the frame says, and those that are absent are hidden."""
        gone = set()
        for node, one in self.objects.items():
            one.set_mat(self.rest[node])
            one.show()
        for name, matrix in frame.get("world_from_object", {}).items():
            self.objects[self.node(name)].set_mat(self.root, rows(matrix))
        for name in frame.get("absent", ()):
            if (node := self.node(name)) in self.objects:
                self.objects[node].hide()
                gone.add(node)
        self.root.clear_occluder()
        for node, wall in self.walls:  # what is hidden would still hide
            if node not in gone:
                self.root.set_occluder(wall)

    def node(self, name: str) -> int:
        found = [number for number, one in enumerate(self.names) if one == name]
        if len(found) != 1:
            raise SystemExit(f"{len(found)} nodes of the scene are called '{name}'")
        return found[0]

    def look(self, view: Json) -> None:
        """The film is measured in pixels in perspective, and else in the world's units."""
        width, height = view["width"], view["height"]
        if view.get("clip_plane") is not None:
            raise SystemExit("clip planes are not tried")
        if "ymag" in view:
            self.lens = core.OrthographicLens()
            unit = 2 * view["ymag"] / height
        else:
            self.lens = core.PerspectiveLens()
            unit = 1.0
            self.lens.set_focal_length(height / 2 / math.tan(view["yfov"] / 2))
        self.lens.set_film_size(width * unit, height * unit)
        shift = view.get("shift_x_px", 0.0) * unit, -view.get("shift_y_px", 0.0) * unit
        self.lens.set_film_offset(*shift)
        far = view.get("far")
        self.lens.set_near_far(view["near"], math.inf if far is None else far)
        self.camera.node().set_lens(self.lens)
        self.camera.set_mat(rows(view["world_from_camera"]))
        self.buffer.set_size(width, height)

    def drawn(self) -> list[int]:
        """The glTF nodes in the draw list of the view that is looked through; and the picture is
        made."""
        self.engine.render_frame()
        found = set()
        for one in core.NodePath(self.region.make_cull_result_graph()).find_all_matches(
            "**/+GeomNode"
        ):
            for index in range(one.node().get_num_geoms()):
                state = one.node().get_geom_state(index)
                attrib = state.get_attrib(core.ColorAttrib) or one.get_net_state().get_attrib(
                    core.ColorAttrib
                )
                found.add(self.by_colour[tuple(round(part * 255) for part in attrib.color.xyz)])
        return sorted(found)

    def picture(self) -> core.PNMImage:
        image = core.PNMImage()
        self.buffer.get_screenshot(image)
        return image


def colour_of(node: int) -> tuple[int, ...]:
    """Red, green and blue of 0 to 255: another for each node, none of them the background's black,
    and of neighbours unlike (an odd factor permutes the numbers of 24 bits)."""
    number = (node + 1) * 0x9E3779 & 0xFFFFFF
    return tuple(number.to_bytes(3, "big"))


def hides(document: Json, node: Json) -> bool:
    """Whether nothing of the node's mesh is masked, blended, glass, or unseen from behind."""
    if "mesh" not in node:
        return False
    one_sided = os.environ.get("VISREF_CULL_BACKFACES") == "1"
    for primitive in document["meshes"][node["mesh"]]["primitives"]:
        material = document["materials"][primitive["material"]] if "material" in primitive else {}
        if one_sided and not material.get("doubleSided", False):
            return False
        if material.get("alphaMode", "OPAQUE") != "OPAQUE":
            return False
        if "KHR_materials_transmission" in material.get("extensions", {}):
            return False
    return True


def rectangles(one: core.NodePath) -> Iterator[list[core.LPoint3]]:
    for child in one.find_all_matches("+GeomNode"):
        node = child.node()
        for geom in map(node.get_geom, range(node.get_num_geoms())):
            places = core.GeomVertexReader(geom.get_vertex_data(), "vertex")
            triangles = []
            for primitive in primitives(geom.decompose()):
                for index in range(0, primitive.get_num_vertices(), 3):
                    corners = []
                    for corner in range(3):
                        places.set_row(primitive.get_vertex(index + corner))
                        corners.append(core.LPoint3(places.get_data3()))
                    triangles.append(corners)
            for first, second in pairwise(triangles):
                if quad := joined(first, second):
                    yield quad


def primitives(geom: core.Geom) -> Iterator[core.GeomPrimitive]:
    return map(geom.get_primitive, range(geom.get_num_primitives()))


def joined(first: list[core.LPoint3], second: list[core.LPoint3]) -> list[core.LPoint3] | None:
    """The upright rectangle of two triangles, its corners in order."""
    shared = [corner for corner in first if corner in second]
    if len(shared) != 2:
        return None
    (one,) = (corner for corner in first if corner not in shared)
    (other,) = (corner for corner in second if corner not in shared)
    if one + other != shared[0] + shared[1]:  # the diagonals do not halve each other
        return None
    across, along = shared[0] - one, shared[1] - one
    if abs(across.dot(along)) > RIGHT_ANGLE * across.length() * along.length():
        return None
    return [one, shared[0], other, shared[1]] if across.cross(along).z == 0 else None


def record(scene: Path, path: Path, recording: Path, options: argparse.Namespace) -> None:
    told = json.loads(path.read_text(encoding="utf-8"))
    top = {key: value for key, value in told.items() if key != "frames"}
    panda = Panda(scene, options)
    first = views_of(top, told["frames"][0])[0][1]
    with Recorder(str(recording), first["width"], first["height"]) as r:
        for number, frame in enumerate(told["frames"]):
            if panda.animated and ("time_s" in frame or "fps" in top):
                raise SystemExit(f"{scene} is animated, and here it stands still")
            panda.pose(frame)
            r.begin_frame(number)
            if frame.get("cut"):
                r.cut()
            for name, matrix in frame.get("world_from_object", {}).items():
                r.pose(name, matrix)
            for name in frame.get("absent", ()):
                r.absent(name)
            for name, view in views_of(top, frame):
                panda.look(view)
                tell_drawn(r, panda, name)
                tell_camera(r, panda, view, name)
                if options.pictures:
                    options.pictures.mkdir(parents=True, exist_ok=True)
                    file = options.pictures / "-".join([f"{number:03}", *([name] if name else [])])
                    panda.picture().write(core.Filename.from_os_specific(f"{file}.png"))
            r.end_frame()


def views_of(top: Json, frame: Json) -> list[tuple[str | None, Json]]:
    views = frame.get("views", {None: {}})
    return [(name, {**top, **frame, **fields}) for name, fields in views.items()]


def tell_drawn(r: Recorder, panda: Panda, name: str | None) -> None:
    """By name where all nodes have names of their own, and else by number."""
    drawn = panda.drawn()
    if "" not in panda.names and len(set(panda.names)) == len(panda.names):
        r.visible([panda.names[node] for node in drawn], name)
    else:
        r.visible_nodes(drawn, name)


def tell_camera(r: Recorder, panda: Panda, view: Json, name: str | None) -> None:
    """As Panda has it, but for the film's offset, which is in pixels in the path."""
    lens = panda.lens
    r.camera(*from_panda3d(panda.camera.get_mat(panda.root)), name)
    r.field("width", panda.buffer.get_fb_x_size(), name)
    r.field("height", panda.buffer.get_fb_y_size(), name)
    r.field("near", lens.near, name)
    r.field("far", lens.far, name)
    if lens.is_perspective():
        r.field("yfov", math.radians(lens.get_vfov()), name)
    else:
        r.field("ymag", lens.film_size.y / 2, name)
    for field in ("shift_x_px", "shift_y_px"):
        if field in view:
            r.field(field, view[field], name)


def record_suite(suite: Path, out: Path, options: argparse.Namespace) -> None:
    """Each case in a process of its own; what cannot be recorded is told, and leaves no file."""
    out.mkdir(parents=True, exist_ok=True)
    os.environ["VISREF_CULL_BACKFACES"] = "1"
    for case in json.loads((suite / "manifest.json").read_text(encoding="utf-8"))["cases"]:
        child = os.fork()
        if child == 0:
            recording = out / f"{case['name']}.jsonl"
            try:
                record(suite / case["scene"], suite / case["path"], recording, options)
            except (Exception, SystemExit) as problem:
                print(f"{case['name']}: {problem}", file=sys.stderr)
                recording.unlink(missing_ok=True)
            os._exit(0)
        os.waitpid(child, 0)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--suite", action="store_true", help="two folders: the suite, and OUT")
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--occluders", type=int, default=0, metavar="N")
    parser.add_argument("--bounds", default="sphere", choices=("sphere", "box", "best"))
    parser.add_argument("--no-culling", action="store_true")
    parser.add_argument("--pictures", type=Path, metavar="DIR")
    options = parser.parse_args()
    if len(options.files) != (2 if options.suite else 3):
        parser.error("which files?")
    core.load_prc_file_data("", f"bounds-type {options.bounds}")
    try:
        (record_suite if options.suite else record)(*options.files, options)
    except OSError as problem:
        raise SystemExit(f"{problem.filename}: {problem.strerror}") from None


if __name__ == "__main__":
    main()
