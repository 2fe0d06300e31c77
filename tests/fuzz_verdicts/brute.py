"""The verdict by its rules, in whole numbers, of the case as it was written; nothing of visref."""

from collections import Counter
from fractions import Fraction as Q
from math import floor, inf, tan

SOLID, HOLE, BETWEEN = "solid", "hole", "between"
CLAMP, MIRROR = 33071, 33648
# Where masks answer otherwise with numbers changed by this share, float64 may give either answer:
# its error is 2^-53 times a lookup's condition, far below 2^20 with numbers as small as the cases'.
MARGIN = Q(1, 1 << 30)


def triple(p, q, r):
    x, y = q[1] * r[2] - q[2] * r[1], q[2] * r[0] - q[0] * r[2]
    return p[0] * x + p[1] * y + p[2] * (q[0] * r[1] - q[1] * r[0])


def plus(p, q, sign=1):
    return p[0] + sign * q[0], p[1] + sign * q[1], p[2] + sign * q[2]


class View:
    """One camera's rays against all triangles, all vectors whole after one power of two."""

    def __init__(self, triangles, camera):
        self.triangles, w, h = triangles, camera["width"], camera["height"]
        right, up, back, eye = zip(*camera["world_from_camera"][:3], strict=True)
        self.straight = "ymag" in camera
        s = (camera["ymag"] if self.straight else tan(camera["yfov"] / 2)) / h
        lens = [[x * s for x in right], [x * s for x in up], [-x for x in back], eye]
        dx, dy = camera.get("shift_x_px", 0.0), camera.get("shift_y_px", 0.0)
        columns = [2.0 * (x + dx) + 1.0 - w for x in range(w)]
        self.grid = [(a, h - 2.0 * (y + dy) - 1.0) for y in range(h) for a in columns]
        self.near, self.far = Q(camera["near"]), camera["far"]
        corners = [x for t in triangles for v in t.corners for x in v]
        self.fine = max(Q(x).denominator for pair in self.grid for x in pair)
        unit = self.fine * max(Q(x).denominator for x in corners + [x for v in lens for x in v])
        self.r, self.u, self.f, self.e = ([int(Q(x) * unit) for x in v] for v in lens)
        self.shapes = []
        for t in triangles:
            v0, v1, v2 = ([int(x * unit) for x in v] for v in t.corners)
            self.shapes.append((v0, plus(v1, v0, -1), plus(v2, v0, -1)))

    def solve(self, index, a, b):
        """o + t d = v0 + b1 e1 + b2 e2: determinant, > 0 from the front; numerators b1, b2, t."""
        i, j = int(a * self.fine), int(b * self.fine)
        side = [(i * x + j * y) // self.fine for x, y in zip(self.r, self.u, strict=True)]
        start = plus(self.e, side) if self.straight else self.e
        way = self.f if self.straight else plus(self.f, side)
        v0, e1, e2 = self.shapes[index]
        s = plus(start, v0, -1)
        return triple(e1, way, e2), triple(s, way, e2), triple(way, s, e1), triple(e2, s, e1)

    def hits(self, at):
        """(t, triangle) of all that cover a sample in range, nearest first."""
        found = []
        for index, t in enumerate(self.triangles):
            front, *rest = self.solve(index, *self.grid[at])
            d, (b1, b2, n) = abs(front), (x if front > 0 else -x for x in rest)
            if d and min(b1, b2, d - b1 - b2) >= 0 and not (t.one_sided and front < 0):
                found += [(Q(n, d), index)] * (self.near <= Q(n, d) <= (self.far or inf))
        return sorted(found)

    def mask(self, at, index):
        """What a mask may say at a hit: one answer, or two at a border that float64 cannot see."""
        t, (a, b) = self.triangles[index], self.grid[at]
        around = [(0, 0), (-2, -2), (-2, 2), (2, -2), (2, 2)]  # a pixel is 2 wide; doubled
        found = [self.solve(index, a + i, b + j)[:3] for i, j in around]
        bounded = self.straight or all(d * found[0][0] > 0 for d, _, _ in found)
        box = []
        for f in zip(*t.lookup, strict=True):  # u, v and vertex alpha, by corner
            x = [f[0] + Q(m, d) * (f[1] - f[0]) + Q(n, d) * (f[2] - f[0]) for d, m, n in found if d]
            half = max(abs(y - x[0]) for y in x) if bounded or len({*f}) == 1 else inf
            box.append((x[0], half, min(f), max(f)))
        return {decide(t.mask, box, sign * MARGIN) for sign in (1, -1)}


def decide(mask, box, grow):
    (u, du, *_), (v, dv, *_), (x, dx, low, high) = box
    w, h = len(mask.texels[0]), len(mask.texels)
    slack = [grow * (n + abs(c)) for n, c in ((w, u * w), (h, v * h))]
    wide, reach = (du * w + slack[0], dv * h + slack[1]), 0 if mask.nearest else Q(1, 2)
    if mask.nearest and max(wide) < 1:  # under a texel: the one at the hit
        wide = slack
    columns = texels(u * w, wide[0] + reach, w, mask.wrap[0])
    rows = texels(v * h, wide[1] + reach, h, mask.wrap[1])
    alphas = [Q(mask.texels[j][i], 255) * Q(mask.factor) for j in rows for i in columns]
    least, greatest = max(low, x - dx - grow), min(high, x + dx + grow)
    if min(alphas) * least >= Q(mask.cutoff):
        return SOLID
    return HOLE if max(alphas) * greatest < Q(mask.cutoff) else BETWEEN


def texels(c, half, size, mode):
    """Those that [c - half, c + half] touches along an axis; the one at c if half is negative."""
    if half == inf:
        return range(size)
    first, last = floor(c - max(half, 0)), floor(c + max(half, 0))
    if mode == CLAMP:
        first, last = (min(max(i, 0), size - 1) for i in (first, last))
    every = {i % (2 * size) for i in range(first, min(last, first + 2 * size) + 1)}
    return {min(i, 2 * size - 1 - i) if mode == MIRROR else i % size for i in every}


class Sample:
    """`tied` own it, `doubt` may, `glass` is seen before all, `maybe` is glass that may be."""

    def __init__(self, view, at, state_of):
        found = view.hits(at)
        states = {i: {"opaque": SOLID}.get(k := view.triangles[i].kind, k) for _, i in found}
        states |= {i: state_of(at, i) for i, k in states.items() if k == "mask"}
        nearest = min((t for t, i in found if states[i] == SOLID), default=inf)
        self.met = {*states}
        self.tied = [i for t, i in found if states[i] == SOLID and t == nearest]
        doubt = {i: t for t, i in found if states[i] == BETWEEN and t <= nearest}
        self.doubt, first = [*doubt], min([nearest, *doubt.values()])
        self.glass = [i for t, i in found if states[i] == "blend" and t < first]
        self.maybe = [i for t, i in found if states[i] == "blend" and first <= t < nearest]


def judge(samples, triangles, units, drawn, promise):
    """The counts of one drawn set, the lost samples, and the objects that lose any."""
    of, out, here = [t.object for t in triangles], Counter(), {i for u in drawn for i in units[u]}
    visible, shows, loses, gone, seen, lost = set(), set(), set(), set(), set(), set()
    for at, s in enumerate(samples):
        seen |= {*s.tied, *s.doubt, *s.glass, *s.maybe}
        candidates = [[i] for i in s.doubt] + [s.tied] * bool(s.tied)
        there = [any(i in here for i in one) for one in candidates]
        out["owned_samples"] += bool(candidates)
        if s.tied and not any(there):
            lost.add(at)
            gone |= {*s.tied}
            loses |= {of[i] for i in s.tied}
        elif s.doubt and not all(there):
            out["undecided_samples"] += 1
        if not s.doubt or at in lost:
            visible |= {of[i] for i in s.tied}
            shows |= {of[i] for i in s.tied if i in here}
        for o in {of[i] for i in s.glass}:
            own = {i for i in s.glass if of[i] == o}
            visible.add(o)
            (shows if own & here else loses).add(o)
            gone |= set() if own & here else own
    hidden = [u for u in drawn if units[u] and not seen & {*units[u]}]
    doubtful = {i for s in samples if s.doubt for i in s.met}
    undrawn = {*range(len(units))} - {*drawn}
    out |= {"visible": len(visible), "missed": len(visible - shows), "missed_pixels": len(lost)}
    out |= {"partly_missed": len(loses & shows), "ties": len(visible - shows - loses)}
    out |= {"confirmed": len(loses), "drawn": len(drawn), "superfluous": len(hidden)}
    out["missed_units"] = sum(bool(gone & {*units[u]}) for u in undrawn)
    if promise in ("exact", "aggressive"):
        out["violations"] = sum(not doubtful & {*units[u]} for u in hidden)
        out["superfluous_confirmed"] = out["violations"]
    out["violations"] += len(loses) if promise in ("exact", "conservative") else 0
    return out, lost, loses


def status(totals, promise):
    """The word and the exit status, from the sums over frames."""
    owned, open_ = totals["owned_samples"], totals["undecided_samples"]
    if totals["violations"]:
        return "violation", 1
    if not totals["visible"] or 2 * open_ > owned:
        return "inconclusive", 3
    return ("measured" if promise == "approximate" else "no_violation_found"), 0
