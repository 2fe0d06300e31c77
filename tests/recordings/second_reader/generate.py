"""Seeded recordings for readers of visref's format: right ones, and every third wrong in one way.

`generate(seed, folder)` gives the recording's file, and the objects and groups of its scene. Beside
the recording it writes about.json: what it meant, known without reading anything back.
"""

import json
import math
import os
import random

import numpy as np

BASES = [
    "chair",
    "table",
    "lamp",
    "wall",
    "Stuhl-Ä",
    "crate",
    "x y",
    "12",
    "tree",
    'quo"te',
    "chair#2",
]


# ---------------------------------------------------------------- the scene
def scene(r):
    objects, groups, taken, node = [], [], set(), 0
    folders = ["", "house", "house/kitchen", "yard"]

    def add(given, path, node):
        name, k = given, 2
        while name in taken:
            name, k = f"{given}#{k}", k + 1
        taken.add(name)
        objects.append(
            {
                "id": len(objects),
                "given_name": given,
                "name": name,
                "path": path,
                "node": node,
                "triangles": r.choice([0, 1, 1, 2, 3, 5, 12]),
            }
        )

    paths = set()
    for _ in range(r.randint(3, 12)):
        given, folder = r.choice(BASES), r.choice(folders)
        path = f"{folder}/{given}".lstrip("/")
        if path in paths:
            continue
        paths.add(path)
        node += r.randint(1, 3)
        if given == "tree" or r.random() < 0.15:  # instances: one node, a group of its name
            first = len(objects)
            for _ in range(r.randint(2, 4)):
                add(given, path, node)
            groups.append(
                {"name": given, "path": path, "objects": list(range(first, len(objects)))}
            )
        else:
            add(given, path, node)
    if all(o["triangles"] == 0 for o in objects):
        objects[0]["triangles"] = 2
    return objects, groups


def spellings(objects, groups):
    """Texts that are certain to mean one thing, by thing: ("o", id) or ("g", index)."""
    given, path, gname, gpath = {}, {}, {}, {}
    for o in objects:
        for t in {o["given_name"], o["name"]}:
            given.setdefault(t, set()).add(o["id"])
        path.setdefault(o["path"], set()).add(o["id"])
    for i, g in enumerate(groups):
        gname.setdefault(g["name"], set()).add(i)
        gpath.setdefault(g["path"], set()).add(i)
    out = {}
    for o in objects:
        texts = [
            t
            for t in (o["given_name"], o["name"])
            if given[t] == {o["id"]} and t not in gname and t not in path
        ]
        texts += [o["name"]] * (given[o["name"]] == {o["id"]} and o["name"] not in gname)
        if path[o["path"]] == {o["id"]} and o["path"] not in gpath:
            texts.append("/" + o["path"])
            if o["path"] not in given and o["path"] not in gname:
                texts.append(o["path"])
        out["o", o["id"]] = texts
    for i, g in enumerate(groups):
        texts = [f"group:{g['name']}"] * (len(gname[g["name"]]) == 1)
        texts += ["/" + g["path"]] * (len(gpath[g["path"]]) == 1)
        if len(gname[g["name"]]) == 1 and given.get(g["name"], set()) == set(g["objects"]):
            texts.append(g["name"])
        out["g", i] = texts
    return out


# ---------------------------------------------------------------- cameras
def rotation(r):
    q = np.array([r.gauss(0, 1) for _ in range(4)])
    q /= np.linalg.norm(q)
    x, y, z, w = q
    return q, np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def written(r, m, digits=False):
    m = np.array(m)
    if digits:
        m = np.array([[float(f"{v:.6g}") for v in row] for row in m])
    k = r.randrange(3)
    if k == 0:
        return m.tolist()
    return {"row_major": m.ravel().tolist()} if k == 1 else {"column_major": m.T.ravel().tolist()}


def camera(r, size, allow_ortho, allow_clip=True):
    """-> (fields, pose truth, lens truth or None where the header's counts)"""
    q, rot = rotation(r)
    e = np.array([r.uniform(-50, 50) for _ in range(3)])
    if r.random() < 0.05:
        e = e * 1e5
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rot, e
    form = r.choice(["wfc", "wfc", "cfw", "clip", "clip", "look", "quat"])
    digits = r.random() < 0.3
    if form == "clip" and not allow_clip:
        form = "wfc"
    if form == "wfc":
        return {"world_from_camera": written(r, pose, digits)}, pose, None
    if form == "cfw":
        return {"camera_from_world": written(r, np.linalg.inv(pose), digits)}, pose, None
    if form == "quat":
        q = [float(f"{v:.6g}") for v in q] if digits else q.tolist()
        return {"position": e.tolist(), "rotation": q}, pose, None
    if form == "look":
        f = {
            "eye": e.tolist(),
            "target": (e - rot[:, 2] * r.uniform(0.5, 20)).tolist(),
            "up": rot[:, 1].tolist(),
        }
        if r.random() < 0.3:
            del f["up"]
            right = np.cross([0, 1, 0], rot[:, 2])
            right /= np.linalg.norm(right)
            pose[:3, :3] = np.stack([right, np.cross(rot[:, 2], right), rot[:, 2]], 1)
        return f, pose, None
    # clip_from_world
    w, h = size
    near, far = r.choice([0.01, 0.1, 1.0]), r.choice([20.0, 1000.0, math.inf])
    depth, down = r.choice(["-1..1", "0..1", "1..0"]), r.random() < 0.4
    sx, sy = (r.uniform(-3, 3), r.uniform(-3, 3)) if r.random() < 0.5 else (0.0, 0.0)
    yfov = r.uniform(0.4, 2.0)
    c = 1 / math.tan(yfov / 2)
    p = np.zeros((4, 4))
    p[0, 0], p[1, 1], p[0, 2], p[1, 2], p[3, 2] = c * h / w, c, 2 * sx / w, -2 * sy / h, -1
    inv = 0.0 if math.isinf(far) else 1 / far
    lo, hi = {"-1..1": (-1, 1), "0..1": (0, 1), "1..0": (1, 0)}[depth]
    B = (lo - hi) / (1 / near - inv)  # A' + B / t : lo at near, hi at far
    A = hi - B * inv
    p[2, 2], p[2, 3] = -A, B
    ortho = allow_ortho and r.random() < 0.25
    if ortho:  # near and far by the matrix alone, from the eye on the near plane: near 0 (Q22)
        ymag, far = r.choice([0.5, 3.0, 40.0]), r.choice([20.0, 1000.0])
        near = sx = sy = 0.0
        p = np.diag([h / (w * ymag), 1 / ymag, -(hi - lo) / far, 1.0])
        p[2, 3] = lo
    if down:
        p[1] *= -1
    m = p @ np.linalg.inv(pose)
    if r.random() < 0.2:
        m = m * r.choice([2.0, 0.5, 3.0])
    f = {
        "clip_from_world": written(r, m, digits and depth != "x" and np.abs(e).max() < 100),
        "clip_depth": depth,
    }
    if down or r.random() < 0.3:
        f["clip_y"] = "down" if down else "up"
    if ortho:
        return f, pose, {"ymag": ymag, "near": 0.0, "far": far, "digits": digits}
    return (
        f,
        pose,
        {
            "yfov": yfov,
            "shift": [sx, sy],
            "near": near,
            "far": far if math.isfinite(far) else None,
            "digits": digits,
        },
    )


# ---------------------------------------------------------------- a valid recording
def build(r, folder):
    objects, groups = scene(r)
    len(objects)
    header = {"format": "visref-recording", "version": 1}
    size = (r.choice([640, 1280, 333]), r.choice([480, 720, 1]) or 480)
    if size[1] == 1 and r.random() < 0.7:
        size = (size[0], 480)
    header.update(width=size[0], height=size[1])
    # near and far are not in the header where matrices will say them
    clip_says = r.random() < 0.4
    if not clip_says:
        header["near"], header["far"] = (
            r.choice([0.1, 1e-3, 1, 1e-30]),
            r.choice([500, None, 1e30, 1e300]),
        )
        if r.random() < 0.1:
            del header["far"]
    ortho = r.random() < 0.25
    if ortho:
        header["ymag"] = r.choice([5, 0.25, 1e4])
        if r.random() < 0.5:
            header["yfov"] = None
    else:
        header["yfov"] = r.choice([1.0472, 0.01, 3.1])
        if r.random() < 0.2:
            header["ymag"] = None
    if r.random() < 0.3 and not clip_says:
        header["shift_x_px"] = r.uniform(-1, 1)
    if r.random() < 0.2:
        header["clip_plane"] = r.choice([None, [0, 1, 0, 0.5], [1e-3, 2, 3, -1e9]])
    fps = r.choice([None, None, 60, 29.97, "null"])
    if fps is not None:
        header["fps"] = None if fps == "null" else fps
        fps = None if fps == "null" else fps
    if r.random() < 0.2:
        header["animation"] = r.choice([None, "walk"])
    if r.random() < 0.25:
        header["engine"] = {"name": "tëst", "deep": [1, [2, {"far": None}]]}
    spell = spellings(objects, groups)
    entries = {}  # entry as written (json text) -> ids
    for o in objects:
        entries[json.dumps(o["id"])] = [o["id"]]
        for t in spell["o", o["id"]]:
            entries[json.dumps(t)] = [o["id"]]
    for i, g in enumerate(groups):
        for t in spell["g", i]:
            entries[json.dumps(t)] = g["objects"]
    textual = {k: v for k, v in entries.items() if k.startswith('"')}
    # groups of the recording's own
    if r.random() < 0.4:
        own = {}
        for name in r.sample(["batch", "Batch 2", "b/c", objects[0]["name"]], r.randint(1, 3)):
            if any(g["name"] == name or g["path"] == name for g in groups):
                continue
            picked = r.sample(sorted(entries), r.randint(1, min(3, len(entries))))
            ids = sorted({i for k in picked for i in entries[k]})
            own[name] = [json.loads(k) for k in picked]
            textual[json.dumps("group:" + name)] = entries[json.dumps("group:" + name)] = ids
            if all(name not in (o["given_name"], o["name"], o["path"]) for o in objects):
                textual[json.dumps(name)] = entries[json.dumps(name)] = ids
        if own:
            header["groups"] = own
    # units
    units = None
    if r.random() < 0.3:
        rows, units, plain = [], [], dict(textual)
        for g in [k for k in plain if len(plain[k]) != 1 or json.loads(k).startswith("group:")]:
            del plain[g]
        group_texts = {json.dumps(t) for i in range(len(groups)) for t in spell["g", i]} | {
            json.dumps(t) for t in header.get("groups", {})
        }
        names_of = {
            o["id"]: [
                json.loads(k) for k, v in plain.items() if v == [o["id"]] and k not in group_texts
            ]
            for o in objects
        }
        for o in objects:
            t = 0
            while t < o["triangles"]:
                c = r.randint(1, o["triangles"] - t)
                if units and r.random() < 0.2:
                    u = r.randrange(len(units))
                else:
                    u = len(units)
                    units.append(set())
                rows.append([u, o["id"], t, c])
                units[u] |= {(o["id"], k) for k in range(t, t + c)}
                t += c
            if o["triangles"] and r.random() < 0.3:  # overlap
                units.append({(o["id"], 0)})
                rows.append([len(units) - 1, o["id"], 0, 1])
        r.shuffle(rows)
        sub = r.choice(["", "", "sub/"])
        if sub:
            os.makedirs(os.path.join(folder, "sub"), exist_ok=True)
        if r.random() < 0.5:
            header["units"] = sub + "meshlets.csv"
            for row in rows:
                free = [t for t in names_of[row[1]] if not t.isdigit()]
                if free and r.random() < 0.5:
                    row[1] = r.choice(free)
            _csv(os.path.join(folder, header["units"]), rows, r.random() < 0.3)
        else:
            header["units"] = sub + "meshlets.parquet"
            by_name = r.random() < 0.5 and all(names_of[row[1]] for row in rows)
            if by_name:
                for row in rows:
                    row[1] = r.choice(names_of[row[1]])
            _parquet(os.path.join(folder, header["units"]), rows)
    elif r.random() < 0.1:
        header["units"] = None
    # frames
    number, lines, truth = r.choice([0, 0, 0, 7, 2147483000]), [], []
    count, before = r.randint(1, 6), None
    multi = r.random() < 0.35
    for _ in range(count):
        line, meant = {"frame": number}, {"number": number}
        meant["cut"] = before is not None and number != before + 1
        if r.random() < 0.15:
            line["cut"] = r.random() < 0.5
            meant["cut"] = meant["cut"] or line["cut"]
        if r.random() < 0.3:
            line["time_s"] = r.choice([None, 0, -1.5, 1e-9, 12.25])
        meant["time_s"] = (
            line.get("time_s")
            if line.get("time_s") is not None
            else (number / fps if fps else None)
        )
        if r.random() < 0.1:
            line["animation"] = r.choice(["run", None])

        def fill(target):
            for _ in range(100):
                f, pose, lens = camera(r, size, clip_says, allow_clip="shift_x_px" not in target)
                if lens is None and clip_says:  # nobody else says near and far
                    if r.random() < 0.5:
                        f.update(near=0.5, far=r.choice([None, 77]))
                        lens = {"near": 0.5, "far": f["far"]}
                    else:
                        continue
                elif lens and not clip_says:
                    lens = dict(lens, near=header["near"], far=header.get("far"))
                elif lens is None:
                    lens = {"near": header["near"], "far": header.get("far")}
                break
            if (
                "clip_from_world" in f and "clip_y" in line
            ):  # else a view would take the frame's (Q23)
                f.setdefault("clip_y", "up")
            if "clip_from_world" not in f and r.random() < 0.15:
                f["yfov"] = 0.9
                lens["yfov"] = 0.9
                lens["other"] = "ymag"
            if r.random() < 0.1:
                f["clip_plane"] = [0, 0, 1, 4.5]
            target.update(f)
            return pose.tolist(), lens

        views = [""]
        if multi and r.random() < 0.8:
            views = r.choice([["left", "right"], ["px", "nx", "py", "ny", "pz", "nz"], ["mirror"]])
            line["views"], meant["views"], meant["lens"] = {}, {}, {}
            shared = len(views) > 1 and r.random() < 0.3
            if shared:  # the frame's camera, views that only shift or override
                pose, lens = fill(line)
                shared = "clip_from_world" not in line
            for v in views:
                if shared:
                    line["views"][v] = {"shift_x_px": r.uniform(-1, 1)} if r.random() < 0.7 else {}
                    meant["views"][v], meant["lens"][v] = pose, lens
                else:
                    line["views"][v] = {}
                    meant["views"][v], meant["lens"][v] = fill(line["views"][v])
                if r.random() < 0.1:
                    line["views"][v]["comment"] = None
        else:
            pose, lens = fill(line)
            meant["views"], meant["lens"] = {"": pose}, {"": lens}
        gone = set()
        if r.random() < 0.25 and textual:
            picked = r.sample(sorted(textual), 1)
            line["absent"] = [json.loads(k) for k in picked]
            gone = {i for k in picked for i in textual[k]}
        elif r.random() < 0.1:
            line["absent"] = []
        if r.random() < 0.2 and textual:
            m = np.eye(4)
            m[:3] = [[r.uniform(-2, 2) for _ in range(4)] for _ in range(3)]
            if r.random() < 0.2:
                m[:3] = np.diag([1e-20, 1e-20, 1e-20, 0])[:3] + 0
                m[:3, :3] = np.eye(3) * 1e-20
            line["world_from_object"] = {json.loads(r.choice(sorted(textual))): written(r, m)}
        usable = [
            i for i in range(len(groups)) if spell["g", i] and spell["g", i][0].startswith("group:")
        ]
        if usable and r.random() < 0.15:
            line["levels"] = {groups[r.choice(usable)]["name"]: r.choice([0, 0])}
        if r.random() < 0.2:
            line["stats"] = {
                "ms": {"cull": r.uniform(0, 3), "draw": 0},
                "queries": r.randrange(100),
                "draw_calls": 2**62,
            }
            if r.random() < 0.3:
                line["stats"] = {}
        if r.random() < 0.15:
            line["surprise"] = r.choice([None, [], {"a": {"b": "🙂"}}, 1e300, "x"])
        nodes = units is None and r.random() < 0.15
        per_view = r.random() < (0.5 if len(views) > 1 else 0.15)
        sets, meant["drawn"] = {}, {}
        for v in views if per_view else [""]:
            items, refs = [], set()
            for _ in range(r.choice([0, 1, 2, 4, 7])):
                if units is not None:
                    u = r.randrange(len(units))
                    items.append(u)
                    refs |= units[u]
                    continue
                if nodes:
                    node = r.choice(objects)["node"]
                    items.append(node)
                    ids = [o["id"] for o in objects if o["node"] == node]
                else:
                    k = r.choice(sorted(entries))
                    items.append(json.loads(k))
                    ids = entries[k]
                refs |= {(i, t) for i in ids for t in range(objects[i]["triangles"])}
            if items and r.random() < 0.2:
                items.append(items[0])
            sets[v] = items
            meant["drawn"][v] = sorted(x for x in refs if x[0] not in gone)
        line["visible_nodes" if nodes else "visible"] = sets if per_view else sets[""]
        if r.random() < 0.15:
            box = [[-1, -1e-300, -1e10], [1, 0, 2]]
            line["bounds"] = (
                {str(r.randrange(len(units))): box}
                if units is not None
                else {json.loads(r.choice(sorted(textual))): box}
                if textual
                else {}
            )
        if r.random() < 0.3:
            items = list(line.items())
            r.shuffle(items)
            line = dict(items)
        lines.append(line)
        truth.append(meant)
        before = number
        number += r.choice([1, 1, 1, 2, 9])
    return header, lines, truth, objects, groups, units


def _csv(path, rows, bom=False):
    with open(path, "w", encoding="utf-8-sig" if bom else "utf-8", newline="") as f:
        import csv

        w = csv.writer(f)
        w.writerow(["unit", "object", "first_triangle", "triangle_count"])
        w.writerows(rows)


def _parquet(path, rows):
    import pyarrow as pa
    import pyarrow.parquet as pq

    cols = list(zip(*rows, strict=False)) if rows else [[], [], [], []]
    kind = pa.string() if any(isinstance(x, str) for x in cols[1]) else pa.int32()
    pq.write_table(
        pa.table(
            {
                "unit": pa.array(cols[0], pa.int32()),
                "object": pa.array(cols[1], kind),
                "first_triangle": pa.array(cols[2], pa.int32()),
                "triangle_count": pa.array(cols[3], pa.int32()),
            }
        ),
        path,
    )


# ---------------------------------------------------------------- one way to be wrong
def mutations(header, lines, objects, groups, units, folder, r):
    """name -> function that changes header and lines in place (or returns raw text changes)"""
    last, any_ = lines[-1], r.choice(lines)
    out = {}

    def put(name):
        return lambda f: out.__setitem__(name, f)

    def camera_of(line):
        return next(iter(line["views"].values())) if "views" in line else line

    def drop_camera(line):
        for p in [header, line, *list(line.get("views", {}).values())]:
            for k in (
                "world_from_camera",
                "camera_from_world",
                "clip_from_world",
                "eye",
                "target",
                "position",
                "rotation",
                "up",
            ):
                p.pop(k, None)

    def set_camera(line, f):
        drop_camera(line)
        f = dict(f)
        line.update(f, near=0.1, far=10, yfov=1.0)
        for v in line.get("views", {}).values():
            for k in ("near", "far", "yfov", "ymag"):
                v.pop(k, None)
        line["ymag"] = None

    eye4 = np.eye(4)
    put("format")(lambda: header.update(format="visref-path"))
    put("version 2")(lambda: header.update(version=2))
    put("no version")(lambda: header.pop("version"))
    put("width 0")(lambda: header.update(width=0))
    put("width 1.5")(lambda: header.update(width=1.5))
    put("width null")(lambda: header.update(width=None))
    put("yfov pi")(lambda: header.update(yfov=3.15))
    put("yfov negative")(lambda: header.update(yfov=-1))
    put("ymag zero")(lambda: header.update(ymag=0))
    put("fps zero")(lambda: header.update(fps=0))
    put("near text")(lambda: any_.update(near="0.1"))
    put("far NaN")(lambda: any_.update(far=math.nan))
    put("infinite number")(lambda: any_.update(shift_x_px=math.inf))
    put("huge integer")(lambda: any_.update(shift_y_px=10**400))
    put("clip_plane 3")(lambda: any_.update(clip_plane=[0, 1, 0]))
    put("no frame number")(lambda: any_.pop("frame"))
    put("frame negative")(lambda: lines[0].update(frame=-1))
    put("frame true")(lambda: lines[0].update(frame=True))
    put("frame too large")(lambda: last.update(frame=2147483648))
    put("frame twice")(lambda: lines.append(dict(last)))
    put("frames descend")(lambda: lines.append(dict(lines[0])))
    put("no visible")(lambda: (any_.pop("visible", 0), any_.pop("visible_nodes", 0)))
    put("both visible")(lambda: any_.update(visible=[], visible_nodes=[]))
    put("visible null")(lambda: (any_.pop("visible_nodes", 0), any_.update(visible=None)))
    put("visible a number in a list")(
        lambda: (any_.pop("visible_nodes", 0), any_.update(visible=[0.5]))
    )
    put("visible too large id")(
        lambda: (any_.pop("visible_nodes", 0), any_.update(visible=[10**6]))
    )
    put("visible negative")(lambda: (any_.pop("visible_nodes", 0), any_.update(visible=[-1])))
    put("visible unknown name")(
        lambda: (any_.pop("visible_nodes", 0), any_.update(visible=["no such thing"]))
    )
    put("visible of unknown view")(
        lambda: (
            any_.pop("visible_nodes", 0),
            any_.update(visible={**{v: [] for v in any_.get("views", {"": 0})}, "nowhere": []}),
        )
    )
    put("visible lacks a view")(
        lambda: (any_.pop("visible_nodes", 0), any_.update(visible={"nowhere": []}))
    )
    put("no views")(lambda: any_.update(views={}))
    put("absent a text")(lambda: any_.update(absent=objects[0]["name"]))
    put("absent unknown")(lambda: any_.update(absent=["no such thing"]))
    put("absent an id")(lambda: any_.update(absent=[0]))
    put("levels unknown")(lambda: any_.update(levels={"no such group": 1}))
    put("world_from_object singular")(
        lambda: any_.update(
            world_from_object={"/" + _sure(objects): np.diag([1.0, 1, 0, 1]).tolist()}
        )
    )
    put("world_from_object projective")(
        lambda: any_.update(
            world_from_object={
                "/" + _sure(objects): [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1]]
            }
        )
    )
    put("world_from_object 3 rows")(
        lambda: any_.update(world_from_object={"/" + _sure(objects): eye4[:3].tolist()})
    )
    put("world_from_object unknown")(
        lambda: any_.update(world_from_object={"no such thing": eye4.tolist()})
    )
    put("stats unknown")(lambda: any_.update(stats={"triangels": 3}))
    put("stats negative")(lambda: any_.update(stats={"ms": {"x": -1}}))
    put("stats fraction")(lambda: any_.update(stats={"queries": 1.5}))
    put("bounds one corner")(
        lambda: any_.update(
            bounds={("0" if units is not None else "/" + _sure(objects)): [[0, 0, 0]]}
        )
    )
    put("bounds unknown")(lambda: any_.update(bounds={"no such thing": [[0, 0, 0], [1, 1, 1]]}))
    put("bounds turned round")(
        lambda: any_.update(
            bounds={("0" if units is not None else "/" + _sure(objects)): [[1, 0, 0], [0, 1, 1]]}
        )
    )
    put("cut 1")(lambda: any_.update(cut=1))
    put("group empty")(lambda: header.update(groups={"fresh": []}))
    put("group unknown member")(
        lambda: header.update(groups={**header.get("groups", {}), "fresh": ["no such thing"]})
    )
    put("group too large id")(
        lambda: header.update(groups={**header.get("groups", {}), "fresh": [10**6]})
    )
    put("groups in a circle")(
        lambda: header.update(groups={**header.get("groups", {}), "fresh": ["group:fresh"]})
    )
    put("no camera")(lambda: drop_camera(any_))
    put("matrix scaled")(
        lambda: set_camera(any_, {"world_from_camera": np.diag([2.0, 2, 2, 1]).tolist()})
    )
    put("matrix mirrored")(
        lambda: set_camera(any_, {"world_from_camera": np.diag([1.0, 1, -1, 1]).tolist()})
    )
    put("matrix off by 1e-3")(
        lambda: set_camera(any_, {"camera_from_world": np.diag([1.001, 1, 1, 1]).tolist()})
    )
    put("matrix of 15")(lambda: set_camera(any_, {"world_from_camera": {"row_major": [0.0] * 15}}))
    put("matrix by unknown order")(
        lambda: set_camera(any_, {"world_from_camera": {"columns": eye4.ravel().tolist()}})
    )
    put("matrix transposed")(
        lambda: set_camera(
            any_, {"world_from_camera": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [3, 4, 5, 1]]}
        )
    )
    put("two forms")(
        lambda: set_camera(
            any_, {"world_from_camera": eye4.tolist(), "eye": [0, 0, 0], "target": [0, 0, 1]}
        )
    )
    put("eye at target")(lambda: set_camera(any_, {"eye": [1, 2, 3], "target": [1, 2, 3]}))
    put("up along the view")(lambda: set_camera(any_, {"eye": [1, 2, 3], "target": [1, 5, 3]}))
    put("no target")(lambda: set_camera(any_, {"eye": [1, 2, 3]}))
    put("quaternion of length 1.01")(
        lambda: set_camera(any_, {"position": [1, 2, 3], "rotation": [0, 0, 0, 1.01]})
    )
    put("yfov and ymag")(
        lambda: (set_camera(any_, {"world_from_camera": eye4.tolist()}), any_.update(ymag=3))
    )
    put("unknown clip_depth")(lambda: any_.update(clip_depth="0-1"))
    put("far before near")(
        lambda: (set_camera(any_, {"world_from_camera": eye4.tolist()}), any_.update(near=5, far=4))
    )
    put("shift null")(lambda: any_.update(shift_x_px=None))
    counts = {}
    for o in objects:
        counts[o["given_name"]] = counts.get(o["given_name"], 0) + 1
    many = [
        k
        for k, c in counts.items()
        if c > 1 and all(g["name"] != k for g in groups) and k not in header.get("groups", {})
    ]
    if many and units is None:
        put("ambiguous name")(
            lambda: (any_.pop("visible_nodes", 0), any_.update(visible=[r.choice(many)]))
        )
    if groups:
        put("own group named as the scene's")(
            lambda: header.update(groups={groups[0]["name"]: [0]})
        )
    if units is None:
        put("node that is no object's")(
            lambda: (any_.pop("visible", 0), any_.update(visible_nodes=[10**6]))
        )
        for bad in ("/etc/passwd.csv", "../meshlets.csv", "missing.csv", "units.txt", ""):
            put(f"units {bad!r}")(
                lambda bad=bad: (
                    _csv(os.path.join(folder, "units.txt"), [[0, 0, 0, 1]]),
                    header.update(units=bad),
                )
            )
    full = []
    for o in objects:
        if o["triangles"]:
            full.append([len(full), o["id"], 0, o["triangles"]])

    def with_units(change):
        def f():
            rows = [list(x) for x in full]
            rows = change(rows) or rows
            _csv(os.path.join(folder, "bad.csv"), rows)
            header["units"] = "bad.csv"
            for line in lines:
                line.pop("visible_nodes", 0)
                line.pop("bounds", 0)
                line["visible"] = []

        return f

    out["units miss an object"] = with_units(
        lambda t: t[:-1] if len(t) > 1 else [[0, t[0][1], 1, max(1, t[0][3] - 1)]]
    )
    out["units not dense"] = with_units(lambda t: t[-1].__setitem__(0, len(t)))
    out["units beyond the object"] = with_units(lambda t: t[0].__setitem__(3, t[0][3] + 1))
    out["units empty row"] = with_units(lambda t: [*t, [0, t[0][1], 0, 0]])
    out["units unknown object"] = with_units(lambda t: [*t, [0, 10**6, 0, 1]])
    out["units negative first"] = with_units(lambda t: [*t, [0, t[0][1], -1, 1]])
    out["units with nodes"] = lambda: (
        with_units(lambda t: t)(),
        any_.pop("visible"),
        any_.update(visible_nodes=[]),
    )
    out["units and a name"] = lambda: (
        with_units(lambda t: t)(),
        any_.update(visible=[objects[0]["name"]]),
    )
    out["units number too large"] = lambda: (
        with_units(lambda t: t)(),
        any_.update(visible=[len(full)]),
    )
    # of the text
    for k in (
        "torn line inside",
        "torn header",
        "header only",
        "header and a torn frame",
        "empty file",
        "bad utf-8",
        "a list as a line",
        "trailing comma",
        "two values on a line",
        "torn line that ends with a newline",
    ):
        out[k] = lambda: None
    return out


def _sure(objects):
    paths = [o["path"] for o in objects]
    return next((p for p in paths if paths.count(p) == 1), paths[0])


def generate(seed, folder):
    r = random.Random(seed)
    os.makedirs(folder, exist_ok=True)
    header, lines, truth, objects, groups, units = build(r, folder)
    valid, mutation = seed % 3 != 2, None
    if not valid:
        ways = mutations(header, lines, objects, groups, units, folder, r)
        keys = sorted(ways)
        mutation = keys[seed // 3 * 37 % len(keys)]
        ways[mutation]()
    text = [json.dumps(x, ensure_ascii=r.random() < 0.5) for x in [header, *lines]]
    if valid and r.random() < 0.2:  # a key twice counts as it stood last
        text[-1] = (
            text[-1].replace("{", '{"frame": "nonsense", "stats": 3, ', 1)
            if '"stats"' in text[-1]
            else text[-1].replace("{", '{"frame": -5, ', 1)
        )
    end, cut_off = "\n", False
    if mutation == "torn line inside":
        text.insert(1, text[-1][: len(text[-1]) // 2])
    elif mutation == "torn header":
        text, end = [text[0][:-3]], ""
    elif mutation == "header only":
        text = text[:1]
    elif mutation == "header and a torn frame":
        text, end = [text[0], text[1][:-2]], ""
    elif mutation == "empty file":
        text = [""]
    elif mutation == "a list as a line":
        text.append("[1, 2]")
    elif mutation == "trailing comma":
        text[-1] = text[-1][:-1] + ",}"
    elif mutation == "two values on a line":
        text[-1] += " {}"
    elif mutation == "torn line that ends with a newline":
        text.append('{"frame": 2147483647, "vis')
    elif valid:
        k = r.random()
        if k < 0.2:
            cut_off, end = True, ""
            torn = json.dumps({**lines[-1], "frame": lines[-1]["frame"] + 1})
            text.append(torn[: r.randint(1, len(torn) - 1)])
        elif k < 0.35:
            end = ""
    newline = r.choice(["\n", "\n", "\n", "\r\n"])
    if r.random() < 0.2:
        text.insert(r.randrange(len(text)), r.choice(["", "  "]))
    data = (newline.join(text) + (newline if end else "")).encode()
    if valid and cut_off and r.random() < 0.4:
        data += b'"\xc3'  # torn in the midst of a character
    if mutation == "bad utf-8":
        data = data.replace(b'"frame"', b'"caf\xe9": 1, "frame"', 1)
    if r.random() < 0.15:
        data = b"\xef\xbb\xbf" + data
    path = os.path.join(folder, "run.jsonl")
    with open(path, "wb") as f:
        f.write(data)
    with open(os.path.join(folder, "about.json"), "w") as f:
        json.dump(
            {
                "seed": seed,
                "valid": valid,
                "mutation": mutation,
                "cut_off": cut_off,
                "units": len(units) if units is not None else 0,
                "frames": truth if valid else None,
            },
            f,
            indent=1,
        )
    return path, objects, groups
