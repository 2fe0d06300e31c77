"""A second, independent reader of visref's one-file recordings.

It was written from docs/recordings.md and the schemas alone; where they left a doubt,
which a comment numbers (Q1, Q2, …), the documentation now says what holds.
"""

import csv
import json
import math
import os
import re

import numpy as np

TAKEN_AS_IS, MADE_RIGID = 1e-6, 1e-4
NULL_IS_ABSENT = ("yfov", "ymag", "time_s", "animation", "fps", "units")
COUNTERS = [
    "queries",
    "queries_passed",
    "batches",
    "tests_skipped",
    "query_fragments",
    "query_fragments_passed",
    "lookups",
    "depth_tests",
    "triangles_drawn",
    "units_drawn",
    "draw_calls",
    "state_changes",
    "bytes_read_back",
    "iterations",
    "triangles_estimated",
]
FORMS = {
    "world_from_camera": ("world_from_camera",),
    "camera_from_world": ("camera_from_world",),
    "clip_from_world": ("clip_from_world",),
    "look": ("eye", "target"),
    "quat": ("position", "rotation"),
}
MAX_FRAME, MAX_SIDE = 2147483647, 1048576


class Refused(Exception):
    pass


# ---------------------------------------------------------------- values
def _number(v, where):
    if isinstance(v, bool) or not isinstance(v, (int, float)):
        raise Refused(f"{where}: not a number")
    v = float(v)
    if not math.isfinite(v):
        raise Refused(f"{where}: not finite")
    return v


def _whole(v, where, least=0, most=None):
    if isinstance(v, float) and v.is_integer():  # 3.0 is an integer to JSON Schema (Q1)
        v = int(v)
    if isinstance(v, bool) or not isinstance(v, int):
        raise Refused(f"{where}: not a whole number")
    if v < least or (most is not None and v > most):
        raise Refused(f"{where}: {v} is out of range")
    return v


def _text(v, where):
    if not isinstance(v, str):
        raise Refused(f"{where}: not a text")
    return v


def _vector(v, n, where):
    if not isinstance(v, list) or len(v) != n:
        raise Refused(f"{where}: not a list of {n} numbers")
    return [_number(x, f"{where}[{i}]") for i, x in enumerate(v)]


def _object(v, where):
    if not isinstance(v, dict):
        raise Refused(f"{where}: not an object")
    return v


def _list(v, where):
    if not isinstance(v, list):
        raise Refused(f"{where}: not a list")
    return v


def _matrix(v, where):
    if isinstance(v, dict):
        if len(v) != 1 or next(iter(v)) not in ("row_major", "column_major"):
            raise Refused(f"{where}: a flat matrix has row_major or column_major, and nothing else")
        key = next(iter(v))
        m = np.array(_vector(v[key], 16, f"{where}.{key}")).reshape(4, 4)
        return m if key == "row_major" else m.T.copy()
    if not isinstance(v, list) or len(v) != 4:
        raise Refused(f"{where}: not four rows of four")
    return np.array([_vector(r, 4, f"{where}[{i}]") for i, r in enumerate(v)])


def _finite_everywhere(v, where):
    if isinstance(v, float) and not math.isfinite(v):
        raise Refused(f"{where}: not finite")
    if isinstance(v, int) and not isinstance(v, bool):
        try:
            float(v)
        except OverflowError:
            raise Refused(f"{where}: not finite in double precision") from None
    if isinstance(v, list):
        for i, x in enumerate(v):
            _finite_everywhere(x, f"{where}[{i}]")
    if isinstance(v, dict):
        for k, x in v.items():
            _finite_everywhere(x, f"{where}.{k}")


def _parse_int(s):
    return int(s) if len(s) < 400 else math.inf


def _without_nulls(d):
    return {k: v for k, v in d.items() if not (v is None and k in NULL_IS_ABSENT)}


# ---------------------------------------------------------------- names
class Names:
    def __init__(self, objects, groups, where="scene"):
        self.n = len(objects)
        self.names, self.paths, self.group_names, self.group_paths, self.nodes = {}, {}, {}, {}, {}
        self.groups = []
        for o in objects:
            for text in {o["given_name"], o["name"]} - {None}:
                self.names.setdefault(text, []).append(o["id"])
            self.paths.setdefault((o["path"] or "").lstrip("/"), []).append(o["id"])
            if o.get("node") is not None:
                self.nodes.setdefault(o["node"], []).append(o["id"])
        for g in groups:
            i = len(self.groups)
            self.groups.append(sorted(set(g["objects"])))
            self.group_names.setdefault(g["name"], []).append(i)
            if g.get("path") is not None:
                self.group_paths.setdefault(g["path"].lstrip("/"), []).append(i)
        self.scene_groups = len(self.groups)

    def add_own(self, own, where):
        _object(own, where)
        for name in own:
            if name in self.group_names or name in self.group_paths:
                raise Refused(f"{where}.{name}: the scene has a group of that name")
        # Members are objects and the scene's groups, and none of the recording's own.
        found = {}
        for name, members in own.items():
            out = set()
            for k, m in enumerate(_list(members, f"{where}.{name}")):
                out.update(self.ids(self.entry(m, f"{where}.{name}[{k}]")))
            if not out:
                raise Refused(f"{where}.{name}: needs one member at least")
            found[name] = sorted(out)
        for name, ids in found.items():
            self.group_names[name] = [len(self.groups)]
            self.groups.append(ids)

    def entry(self, v, where):
        """-> ("object", id) or ("group", index)"""
        if isinstance(v, str):
            return self.text(v, where)
        i = _whole(v, where)
        if i >= self.n:
            raise Refused(f"{where}: there is no object {i}")
        return "object", i

    def text(self, s, where):
        if s.startswith("group:"):  # surely the group, by name or by path (Q8)
            rest = s[len("group:") :]
            found = self.group_names.get(rest) or self.group_paths.get(rest.lstrip("/"), [])
            return "group", self._one(found, s, where, "group")
        if s.startswith("/"):
            return self._choose(
                self.paths.get(s[1:], []), self.group_paths.get(s[1:], []), s, where
            )
        by_name = self.names.get(s, []), self.group_names.get(s, [])
        if any(by_name):  # names before paths (Q6)
            return self._choose(*by_name, s, where)
        return self._choose(self.paths.get(s, []), self.group_paths.get(s, []), s, where)

    def _choose(self, ids, groups, s, where):
        # A group's own members do not count as bearers of its name.
        ids = [i for i in ids if not any(i in self.groups[g] for g in groups)]
        if len(ids) == 1:  # also where a group has the same name (Q7)
            return "object", ids[0]
        if groups:
            return "group", self._one(groups, s, where, "group")
        return "object", self._one(ids, s, where, "object")

    @staticmethod
    def _one(found, s, where, kind):
        if not found:
            raise Refused(f"{where}: nothing is called {s!r}")
        if len(found) > 1:
            raise Refused(f"{where}: {s!r} is ambiguous, {kind}s {found}")
        return found[0]

    def ids(self, entry):
        kind, x = entry
        return [x] if kind == "object" else self.groups[x]


# ---------------------------------------------------------------- units
def _units(name, folder, names, triangles):
    where = "header.units"
    if _text(name, where) == "":
        raise Refused(f"{where}: empty")
    if (
        "\0" in name
        or os.path.isabs(name)
        or re.match(r"^[A-Za-z]:|^\\", name)
        or ".." in re.split(r"[/\\]", name)
    ):
        raise Refused(f"{where}: must stay in the recording's folder")
    full, root = os.path.realpath(os.path.join(folder, name)), os.path.realpath(folder)
    if os.path.commonpath([full, root]) != root:
        raise Refused(f"{where}: leads out of the recording's folder")
    if not os.path.isfile(full):
        raise Refused(f"{where}: there is no file {name}")
    columns = ("unit", "object", "first_triangle", "triangle_count")
    kind = os.path.splitext(name)[1].lower()
    if kind == ".csv":
        try:
            with open(full, encoding="utf-8-sig", newline="") as f:
                rows = list(csv.reader(f, strict=True))
        except (csv.Error, UnicodeDecodeError) as e:
            raise Refused(f"{name}: {e}") from None
        rows = [(i + 1, r) for i, r in enumerate(rows) if r]
        if not rows:
            raise Refused(f"{name}: empty")
        head = [c.strip() for c in rows[0][1]]
        for c in columns:
            if head.count(c) != 1:
                raise Refused(f"{name}: needs the column {c} once")
        at = [head.index(c) for c in columns]
        table = []
        for line, r in rows[1:]:
            if len(r) != len(head):
                raise Refused(f"{name}:{line}: {len(r)} cells")
            cells = [r[i] for i in at]
            out = []
            for c, cell in zip(columns, cells, strict=False):
                digits = re.fullmatch(r"[0-9]+", cell.strip())
                if c == "object" and not digits:
                    out.append(cell)
                elif not digits:
                    raise Refused(f"{name}:{line}: {c} is no whole number")
                else:
                    out.append(int(cell))
            table.append((f"{name}:{line}", *out))
    elif kind == ".parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            t = pq.read_table(full)
        except (pa.ArrowException, OSError) as e:
            raise Refused(f"{name}: {e}") from None
        for c in columns:
            if t.column_names.count(c) != 1:
                raise Refused(f"{name}: needs the column {c} once")
        lists = [t.column(c).to_pylist() for c in columns]
        table = [(f"{name} row {i}", *r) for i, r in enumerate(zip(*lists, strict=False))]
    else:
        raise Refused(f"{where}: neither .parquet nor .csv")

    units, covered = {}, [np.zeros(k, bool) for k in triangles]
    for place, unit, obj, first, count in table:
        for v, c, least in (
            (unit, "unit", 0),
            (first, "first_triangle", 0),
            (count, "triangle_count", 1),
        ):
            if isinstance(v, bool) or not isinstance(v, int):
                raise Refused(f"{place}: {c} is no whole number")
            if v < least or v > 2**31 - 1:
                raise Refused(f"{place}: {c} is out of range")
        kind_, x = (
            names.entry(obj, f"{place}: object") if isinstance(obj, (int, str)) else ("none", None)
        )
        if kind_ != "object":
            raise Refused(f"{place}: object must be an object")
        if first + count > triangles[x]:
            raise Refused(f"{place}: object {x} has {triangles[x]} triangles")
        units.setdefault(unit, set()).update((x, k) for k in range(first, first + count))
        covered[x][first : first + count] = True
    if sorted(units) != list(range(len(units))):
        raise Refused(f"{name}: unit numbers are not dense from 0")
    for i, c in enumerate(covered):
        if not c.all():
            raise Refused(f"{name}: triangle {int(np.argmin(c))} of object {i} is in no unit")
    return units


# ---------------------------------------------------------------- cameras
def _check_camera_fields(d, where):
    """Types and ranges of what stands at one place (header, frame or view)."""
    for k in ("width", "height"):
        if k in d:
            _whole(d[k], f"{where}.{k}", 1, MAX_SIDE)
    for k in ("near", "shift_x_px", "shift_y_px"):
        if k in d:
            _number(d[k], f"{where}.{k}")
    if d.get("far") is not None:
        _number(d["far"], f"{where}.far")
    if "yfov" in d and not 0 < _number(d["yfov"], f"{where}.yfov") < math.pi:
        raise Refused(f"{where}.yfov: out of range")
    if "ymag" in d and not _number(d["ymag"], f"{where}.ymag") > 0:
        raise Refused(f"{where}.ymag: out of range")
    if "yfov" in d and "ymag" in d:
        raise Refused(f"{where}: yfov and ymag at one place")  # Q14
    for k, n in (
        ("clip_plane", 4),
        ("eye", 3),
        ("target", 3),
        ("up", 3),
        ("position", 3),
        ("rotation", 4),
    ):
        if k in d and not (k == "clip_plane" and d[k] is None):
            _vector(d[k], n, f"{where}.{k}")
    for k in ("world_from_camera", "camera_from_world", "clip_from_world"):
        if k in d:
            _matrix(d[k], f"{where}.{k}")
    if "clip_depth" in d and d["clip_depth"] not in ("-1..1", "0..1", "1..0"):
        raise Refused(f"{where}.clip_depth: not known")
    if "clip_y" in d and d["clip_y"] not in ("up", "down"):
        raise Refused(f"{where}.clip_y: not known")
    if len(_forms(d)) > 1:
        raise Refused(f"{where}: the camera is given in more than one form")


def _forms(d):
    return [f for f, keys in FORMS.items() if any(k in d for k in keys)]


def _rotation(r, where):
    """The rules of 1e-6 and 1e-4 (Q17: by the largest entry of R'R - I)."""
    with np.errstate(all="ignore"):
        off = np.abs(r.T @ r - np.eye(3)).max()
    if not off <= MADE_RIGID:
        raise Refused(f"{where}: not rigid")
    if np.linalg.det(r) < 0:
        raise Refused(f"{where}: a mirror")
    if off <= TAKEN_AS_IS:
        return r
    u, _, vt = np.linalg.svd(r)
    return u @ vt


def _rigid(m, where):
    if np.abs(m[3] - [0, 0, 0, 1]).max() > MADE_RIGID:
        raise Refused(f"{where}: the last row is not 0 0 0 1")
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = _rotation(m[:3, :3], where), m[:3, 3]
    return out


def _unit(v, where):
    v = np.asarray(v, float)
    big = np.abs(v).max()
    if not big > 0:
        raise Refused(f"{where}: no direction")
    v = v / big
    return v / np.linalg.norm(v)


def _look_at(eye, target, up, where):
    with np.errstate(over="ignore"):
        d = np.array(eye) / 2 - np.array(target) / 2
    back = _unit(d, f"{where}: eye and target")
    side = np.cross(_unit(up, f"{where}: up"), back)
    if np.linalg.norm(side) < 1e-9:
        raise Refused(f"{where}: up is along the view")
    right = _unit(side, where)
    return _pose(np.stack([right, np.cross(back, right), back], 1), eye)


def _pose(r, e):
    m = np.eye(4)
    m[:3, :3], m[:3, 3] = r, e
    return m


def _quaternion(p, q, where):
    q = np.array(q)
    n = math.sqrt(sum((q / max(np.abs(q).max(), 1e-300)) ** 2)) * max(np.abs(q).max(), 1e-300)
    if not abs(n - 1) <= MADE_RIGID:
        raise Refused(f"{where}: not a unit quaternion")
    x, y, z, w = q / n
    return _pose(
        np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        ),
        p,
    )


def _clip(m, depth, y, width, height, given, where):
    """-> pose, lens fields, near, far (the last two None where the matrix does not say)."""
    if y == "down":
        m = m.copy()
        m[1] = -m[1]
    with np.errstate(all="ignore"):
        w = np.linalg.norm(m[3, :3])
        rows = np.linalg.norm(m[:3, :3], axis=1)
    if not np.isfinite(w) or not np.isfinite(rows).all():
        raise Refused(f"{where}: too large")
    near = far = None
    if w > 1e-12 * max(rows[0], rows[1], abs(m[3, 3])):  # perspective
        m = m / w
        back = -m[3, :3]
        b, d = m[0, :3] @ back, m[1, :3] @ back
        right, up = m[0, :3] - b * back, m[1, :3] - d * back
        a, c = np.linalg.norm(right), np.linalg.norm(up)
        if not (a > 0 and c > 0):
            raise Refused(f"{where}: no projection")
        r = _rotation(np.stack([right / a, up / c, back], 1), where)
        try:
            e = np.linalg.solve(m[[0, 1, 3], :3], -m[[0, 1, 3], 3])
        except np.linalg.LinAlgError:
            raise Refused(f"{where}: no eye") from None
        lens = {
            "yfov": 2 * math.atan(1 / c),
            "ymag": None,
            "shift_x_px": b * width / 2,
            "shift_y_px": -d * height / 2,
        }
        if depth is not None and not {"near", "far"} <= set(given):
            A, B = m[2, :3] @ back, m[2, :3] @ e + m[2, 3]
            if np.linalg.norm(m[2, :3] - A * back) > MADE_RIGID * max(1, abs(A)):
                raise Refused(f"{where}: the near plane is oblique")  # Q21

            def at(z):  # view depth with normalised depth z: -A + B / t = z
                q = z + A
                if abs(q) <= 1e-9:
                    return math.inf
                return B / q

            lo, hi = {"-1..1": (-1, 1), "0..1": (0, 1), "1..0": (1, 0)}[depth]
            near, far = at(lo), at(hi)
            if far < 0:
                raise Refused(f"{where}: far is behind the eye")
    else:
        k = m[3, 3]
        if not k > 0:
            raise Refused(f"{where}: no projection")
        m = m / k
        a, c = np.linalg.norm(m[0, :3]), np.linalg.norm(m[1, :3])
        if not (a > 0 and c > 0):
            raise Refused(f"{where}: no projection")
        right, up = m[0, :3] / a, m[1, :3] / c
        back = np.cross(right, up)
        r = _rotation(np.stack([right, up, _unit(back, where)], 1), where)
        if depth is None:
            raise Refused(f"{where}: an orthographic matrix needs clip_depth")  # Q22
        s = m[2, :3] @ -r[:, 2]  # change of depth along the view
        if not abs(s) > 0 or (s > 0) != (depth != "1..0"):
            raise Refused(f"{where}: a mirror")
        lo, hi = {"-1..1": (-1, 1), "0..1": (0, 1), "1..0": (1, 0)}[depth]
        # a point with clip x = y = 0 on the near plane; the eye lies `near` before it
        p = np.linalg.solve(m[:3, :3], np.array([0, 0, lo]) - m[:3, 3])
        near = given.get("near", 0.0)
        far = near + (hi - lo) / s
        e = p + r[:, 2] * near
        lens = {"yfov": None, "ymag": 1 / c, "shift_x_px": 0.0, "shift_y_px": 0.0}
    if abs(c / a * height / width - 1) > MADE_RIGID:
        raise Refused(f"{where}: pixels are not square")
    return _pose(r, e), lens, near, far


def _camera(places, where):
    """places: from the innermost out, each without nulls and already checked."""

    def field(key, default=None):
        for d in places:
            if key in d:
                return d[key]
        return default

    for k in ("width", "height"):
        if field(k) is None:
            raise Refused(f"{where}: no {k}")
    width, height = int(field("width")), int(field("height"))
    level = next((i for i, d in enumerate(places) if _forms(d)), None)
    if level is None:
        raise Refused(f"{where}: no camera")
    form = _forms(places[level])[0]
    missing = [k for k in FORMS[form] if field(k) is None]
    if missing:
        raise Refused(f"{where}: no {missing[0]}")
    given = {}
    for k in ("near", "far"):
        if any(k in d for d in places):
            v = field(k)
            given[k] = math.inf if v is None else float(v)
    lens = {
        "yfov": None,
        "ymag": None,
        "shift_x_px": float(field("shift_x_px", 0)),
        "shift_y_px": float(field("shift_y_px", 0)),
    }
    near = far = None
    if form == "clip_from_world":
        for d in places[: level + 1]:  # Q20
            for k in ("yfov", "ymag", "shift_x_px", "shift_y_px"):
                if k in d:
                    raise Refused(f"{where}: {k} and clip_from_world")
        pose, lens, near, far = _clip(
            _matrix(field(form), where),
            field("clip_depth"),
            field("clip_y", "up"),
            width,
            height,
            given,
            f"{where}.clip_from_world",
        )
    else:
        for d in places:
            if "yfov" in d or "ymag" in d:
                key = "yfov" if "yfov" in d else "ymag"
                lens[key] = float(d[key])
                break
        else:
            raise Refused(f"{where}: no yfov or ymag")
        if form == "world_from_camera":
            pose = _rigid(_matrix(field(form), where), f"{where}.{form}")
        elif form == "camera_from_world":
            v = _rigid(_matrix(field(form), where), f"{where}.{form}")
            pose = _pose(v[:3, :3].T, -v[:3, :3].T @ v[:3, 3])  # Q18
        elif form == "look":
            pose = _look_at(
                _vector(field("eye"), 3, where),
                _vector(field("target"), 3, where),
                _vector(field("up", [0, 1, 0]), 3, where),
                where,
            )
        else:
            pose = _quaternion(
                _vector(field("position"), 3, where), _vector(field("rotation"), 4, where), where
            )
    near = given.get("near", near)
    far = given.get("far", math.inf if far is None else far)
    if near is None:
        raise Refused(f"{where}: no near")
    if lens["yfov"] is not None and not near > 0:
        raise Refused(f"{where}: near must be positive")  # Q15
    if not far > near:
        raise Refused(f"{where}: far must be beyond near")
    if not np.isfinite(pose).all():
        raise Refused(f"{where}: the camera is not finite")
    plane = field("clip_plane")
    return {
        "width": width,
        "height": height,
        "near": float(near),
        "far": float(far),
        **lens,
        "clip_plane": None if plane is None else [float(x) for x in plane],
        "world_from_camera": pose.tolist(),
    }


# ---------------------------------------------------------------- lines
def _lines(path):
    """-> [(line number, value)], cut_off"""
    with open(path, "rb") as f:
        data = f.read()
    if data.startswith(b"\xef\xbb\xbf"):
        data = data[3:]
    raw = data.split(b"\n")
    out = []
    for i, line in enumerate(raw):
        if not line.strip(b" \t\r"):
            continue
        where = f"line {i + 1}"
        try:
            value = json.loads(line.decode("utf-8"), parse_int=_parse_int)
        except (ValueError, RecursionError) as e:  # UnicodeDecodeError is a ValueError
            if i == len(raw) - 1:
                return out, True
            raise Refused(f"{where}: no JSON ({e})") from None
        try:
            _finite_everywhere(value, where)
        except RecursionError:
            raise Refused(f"{where}: too deep") from None
        out.append((where, _object(value, where)))
    return out, False


def _posed(d, names, where):
    out, seen = {}, {}
    for name, v in _object(d, where).items():
        place = f"{where}.{name}"
        entry = names.text(name, place)
        if entry in seen:
            raise Refused(f"{place}: the same as {seen[entry]!r}")
        seen[entry] = name
        m = _matrix(v, place)
        if np.abs(m[3] - [0, 0, 0, 1]).max() > TAKEN_AS_IS:
            raise Refused(f"{place}: not affine")
        with np.errstate(all="ignore"):
            a = m[:3, :3]
            size = np.abs(a).max()
            det = np.linalg.det(a / size) if size > 0 else 0.0
        if det == 0:
            raise Refused(f"{place}: cannot be inverted")
        out[name] = m.tolist()
    return out


def _stats(d, where):
    for k, v in _object(d, where).items():
        if k == "ms":
            for phase, x in _object(v, f"{where}.ms").items():
                if _number(x, f"{where}.ms.{phase}") < 0:
                    raise Refused(f"{where}.ms.{phase}: negative")
        elif k in COUNTERS:
            _whole(v, f"{where}.{k}", 0, 2**63 - 1)
        else:
            raise Refused(f"{where}.{k}: not known")


def _bounds(d, names, units, where):
    for k, v in _object(d, where).items():
        place = f"{where}.{k}"
        if units is None:
            names.text(k, place)
        elif not re.fullmatch(r"[0-9]+", k) or int(k) not in units:
            raise Refused(f"{place}: no unit")
        if not isinstance(v, list) or len(v) != 2:
            raise Refused(f"{place}: not two corners")
        lo, hi = (_vector(x, 3, place) for x in v)
        if any(a > b for a, b in zip(lo, hi, strict=False)):
            raise Refused(f"{place}: the least corner is beyond the greatest")


def read(recording_path, objects, groups):
    objects = sorted(objects, key=lambda o: o["id"])
    triangles = [o["triangles"] for o in objects]
    names = Names(objects, groups)
    lines, cut_off = _lines(recording_path)
    if not lines:
        raise Refused("no header")
    header = _without_nulls(lines[0][1])
    if header.get("format") != "visref-recording":
        raise Refused("line 1: format is not visref-recording")
    if _whole(header.get("version"), "header.version") != 1:
        raise Refused("header.version: not 1")
    _check_camera_fields(header, "header")
    if "fps" in header and not _number(header["fps"], "header.fps") > 0:
        raise Refused("header.fps: not positive")
    if "animation" in header:
        _text(header["animation"], "header.animation")
    if "groups" in header:
        names.add_own(header["groups"], "header.groups")
    units = None
    if "units" in header:
        units = _units(
            header["units"], os.path.dirname(os.path.abspath(recording_path)), names, triangles
        )
    if len(lines) < 2:
        raise Refused("no whole frame")
    frames, before = [], None
    for where, raw in lines[1:]:
        frame = _frame(_without_nulls(raw), header, names, units, triangles, before, where)
        before = frame["number"]
        frames.append(frame)
    return {"frames": frames, "cut_off": cut_off, "units": 0 if units is None else len(units)}


def _frame(line, header, names, units, triangles, before, where):
    if "frame" not in line:
        raise Refused(f"{where}: no frame")
    number = _whole(line["frame"], f"{where}.frame", 0, MAX_FRAME)
    if before is not None and number <= before:
        raise Refused(f"{where}.frame: {number} does not come after {before}")
    _check_camera_fields(line, where)
    cut = line.get("cut", False)
    if not isinstance(cut, bool):
        raise Refused(f"{where}.cut: neither true nor false")
    # the moment
    if "time_s" in line:
        time = _number(line["time_s"], f"{where}.time_s")
    elif "fps" in header:
        time = number / float(header["fps"])
        if not math.isfinite(time):
            raise Refused(f"{where}: the time is not finite")
    else:
        time = None
    animation = (
        _text(line["animation"], f"{where}.animation")
        if "animation" in line
        else header.get("animation")
    )
    absent = [_text(a, f"{where}.absent") for a in _list(line.get("absent", []), f"{where}.absent")]
    gone = set()
    for a in absent:
        gone.update(names.ids(names.text(a, f"{where}.absent")))
    levels = {}
    for g, k in _object(line.get("levels", {}), f"{where}.levels").items():
        place = f"{where}.levels.{g}"
        # here a group is meant, and an object of the same name is not (Q10)
        found = names.group_names.get(g) or names.group_paths.get(g.lstrip("/"))
        kind, x = ("group", names._one(found, g, place, "group")) if found else names.text(g, place)
        if kind != "group" or x >= names.scene_groups:
            raise Refused(f"{place}: no group with levels")
        levels[g] = _whole(k, place)
    posed = _posed(line.get("world_from_object", {}), names, f"{where}.world_from_object")
    # views
    views = []
    if "views" in line:
        given = _object(line["views"], f"{where}.views")
        if not given:
            raise Refused(f"{where}.views: none")
        for name, v in given.items():
            place = f"{where}.views.{name}"
            v = _without_nulls(_object(v, place))
            _check_camera_fields(v, place)
            views.append({"name": name, **_camera([v, line, header], place)})
    else:
        views.append({"name": "", **_camera([line, header], where)})
    # what was drawn
    said = [k for k in ("visible", "visible_nodes") if k in line]
    if len(said) != 1:
        raise Refused(f"{where}: one of visible and visible_nodes")
    key = said[0]
    if key == "visible_nodes" and units is not None:
        raise Refused(f"{where}: visible_nodes with units")
    sets = line[key]
    if isinstance(sets, dict):
        if set(sets) != {v["name"] for v in views}:
            raise Refused(f"{where}.{key}: must name every view of the frame, and no other")
    else:
        sets = {"": sets}
    drawn = {}
    for view, items in sets.items():
        refs = set()
        for i, item in enumerate(_list(items, f"{where}.{key}")):
            place = f"{where}.{key}[{i}]"
            if units is not None:
                u = _whole(item, place)
                if u not in units:
                    raise Refused(f"{place}: there is no unit {u}")
                refs |= units[u]
                continue
            if key == "visible_nodes":
                ids = names.nodes.get(_whole(item, place))
                if ids is None:
                    raise Refused(f"{place}: no object stands at node {item}")
            else:
                ids = names.ids(names.entry(item, place))
            for o in ids:
                refs.update((o, t) for t in range(triangles[o]))
        drawn[view] = sorted(r for r in refs if r[0] not in gone)
    if "bounds" in line:
        _bounds(line["bounds"], names, units, f"{where}.bounds")
    if "stats" in line:
        _stats(line["stats"], f"{where}.stats")
    gap = before is not None and number != before + 1
    return {
        "number": number,
        "time_s": time,
        "animation": animation,
        "cut": cut or gap,
        "absent": absent,
        "levels": levels,
        "world_from_object": posed,
        "views": views,
        "drawn": drawn,
    }
