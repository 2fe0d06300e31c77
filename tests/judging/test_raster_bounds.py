"""What a rasteriser may excuse is bounded, whoever declares it and however near the near plane is;
what is no proper declaration, or no picture, is the plug-in's own failure."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.cli.main import main
from visref.culler import Culler, DrawnSet, Raster, RasterTolerance, check_tolerance
from visref.engines import make_engine
from visref.findings import Code
from visref.judging.outcome import verdict_json
from visref.judging.referee import Referee
from visref.judging.status import Exit
from visref.scene import Scene

WIDTH, HEIGHT = 32, 24
QUAD = np.array([[0, 1, 2], [0, 2, 3]])
FLOOR, TOWER, WALL = range(3)


def upright(half: float, z: float, low: float = -1.0, high: float = 1.0):
    corners = [[-half, low, z], [half, low, z], [half, high, z], [-half, high, z]]
    return np.array(corners), QUAD


def scene(gap: float = 5.0) -> Scene:
    """A floor from behind the eye on, a tower at depth 5, and a wall `gap` behind it."""
    floor = np.array([[-9.0, -1, 9], [9, -1, 9], [9, -1, -9], [-9, -1, -9]])
    return Scene.from_objects(
        [("floor", floor, QUAD), ("tower", *upright(1.0, -5.0)),
         ("wall", *upright(9.0, -5.0 - gap, -1.0, 9.0))]
    )  # fmt: skip


def path(near: float = 0.1, frames: int = 1) -> CameraPath:
    pose = look_at((0.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    return CameraPath((Camera(pose, WIDTH, HEIGHT, near, 100.0, yfov=1.0),) * frames)


class Rasterised(Raster):
    def __init__(self, tolerance: object, picture: object = None) -> None:
        self.tolerance = tolerance  # type: ignore[assignment]
        self.picture = picture

    def item_buffer(self, camera):
        return self.picture(camera) if callable(self.picture) else self.picture


class Draws(Culler):
    """All objects but one."""

    name = "draws"

    def __init__(self, raster: object = None, without: int = TOWER) -> None:
        self.raster = raster  # type: ignore[assignment]
        self.without = without

    def cull(self, camera):
        return DrawnSet(np.setdiff1d(range(3), [self.without]).astype(np.int32))


def judged(*cullers: Culler, near: float = 0.1, frames: int = 1, of: Scene | None = None):
    looked_at = scene() if of is None else of
    referee = Referee(looked_at, lambda: make_engine("exact", looked_at))
    return referee.run(path(near, frames), range(frames), [(c.name, c) for c in cullers])


def failures(outcome) -> list[str]:
    return [f.message for f in outcome.findings if f.code == Code.CULLER_FAILED]


class Raises(RasterTolerance):
    @property
    def snap_px(self):  # type: ignore[override]
        raise KeyError("snap")

    @snap_px.setter
    def snap_px(self, value):
        pass


class Spoofs(float):
    """Calls itself less than anything."""

    def __le__(self, other):
        return True

    def __ge__(self, other):
        return True


BAD = {
    "no tolerance": object(),
    "none": None,
    "a tuple": (0.1, 24),
    "a whole pixel": RasterTolerance(1.0, 24),
    "just above": RasterTolerance(math.nextafter(0.5, 1.0), 24),
    "a million pixels": RasterTolerance(1e6, 24),
    "too large for a float": RasterTolerance(10**400, 24),
    "infinite": RasterTolerance(math.inf, 24),
    "nan": RasterTolerance(math.nan, 24),
    "numpy's nan": RasterTolerance(np.float32("nan"), 24),
    "negative": RasterTolerance(-0.001, 24),
    "text": RasterTolerance("0.1", 24),  # type: ignore[arg-type]
    "true": RasterTolerance(True, 24),
    "an array": RasterTolerance(np.array([0.1]), 24),  # type: ignore[arg-type]
    "spoofed": RasterTolerance(Spoofs(1e6), 24),
    "raises": Raises(0.1, 24),
    "no bits": RasterTolerance(0.1, 0),
    "8 bits": RasterTolerance(0.1, 8),
    "15 bits": RasterTolerance(0.1, 15),
    "33 bits": RasterTolerance(0.1, 33),
    "minus 5000 bits": RasterTolerance(0.1, -5000),
    "a fraction of bits": RasterTolerance(0.1, 24.0),  # type: ignore[arg-type]
    "bits as text": RasterTolerance(0.1, "24"),  # type: ignore[arg-type]
    "bits true": RasterTolerance(0.1, True),
}


@pytest.mark.parametrize("declared", BAD.values(), ids=BAD)
def test_what_is_declared_out_of_bounds_is_its_cullers_failure_alone(declared):
    outcome = judged(Draws(Rasterised(declared)), Draws())
    assert [record.exit for record in outcome.cullers] == [Exit.NOTHING_JUDGED, Exit.VIOLATION]
    (said,) = failures(outcome)
    assert said.startswith("raster.tolerance")
    assert outcome.exit is Exit.VIOLATION
    json.dumps(verdict_json(outcome, scene()), allow_nan=False)
    assert outcome.cullers[0].raster is None


@pytest.mark.parametrize("raster", [object(), "raster", 0], ids=["object", "text", "number"])
def test_what_is_no_rasteriser_is_its_cullers_failure(raster):
    outcome = judged(Draws(raster))
    assert (outcome.exit, len(failures(outcome))) == (Exit.NOTHING_JUDGED, 1)


def test_a_rasteriser_that_cannot_be_asked_for_is_its_cullers_failure():
    class NotReady(Draws):
        raster = property(lambda self: 1 // 0, lambda self, value: None)

    outcome = judged(NotReady(), Draws())
    assert [record.exit for record in outcome.cullers] == [Exit.NOTHING_JUDGED, Exit.VIOLATION]


@pytest.mark.parametrize("bits", [16, 24, 32, None, np.int64(24)])
@pytest.mark.parametrize("snap", [0, 0.0, 0.5, np.float32(0.25)])
def test_what_is_within_bounds_is_taken_in_plain_numbers(snap, bits):
    taken = check_tolerance(RasterTolerance(snap, bits))
    assert taken == RasterTolerance(float(snap), None if bits is None else int(bits))
    assert type(taken.snap_px) is float
    assert type(taken.depth_bits) in (int, type(None))


@pytest.mark.parametrize(
    "text",
    ["snap=0.51,depth=24", "snap=nan,depth=24", "snap=inf,depth=24", "snap=-1,depth=24",
     "snap=1e6,depth=24", "snap=0.1,depth=15", "snap=0.1,depth=33", "snap=0.1,depth=-5000",
     "snap=0.1,depth=24.0", "snap=0.1", "depth=24", "snap=0.1,depth=24,snap=0.1", "tight"],
)  # fmt: skip
def test_the_command_line_is_held_to_the_same_bounds(text, tmp_path, capsys):
    (tmp_path / "s.obj").write_text("o a\nv 0 0 -5\nv 1 0 -5\nv 0 1 -5\nf 1 2 3\n")
    (tmp_path / "p.json").write_text(json.dumps(path().to_json()))
    (tmp_path / "v.jsonl").write_text('{"frame": 0, "visible": []}\n')
    status = main(
        ["check", str(tmp_path / "s.obj"), "--path", str(tmp_path / "p.json"), "--visible",
         str(tmp_path / "v.jsonl"), "--out", str(tmp_path / "out"), "--raster", text]
    )  # fmt: skip
    assert status == 2
    said = capsys.readouterr().err
    assert "--raster" in said
    assert not (tmp_path / "out").exists()


def test_a_declaration_is_read_once_a_frame_and_what_was_checked_is_used_and_recorded():
    class Changes(Rasterised):
        """Good where it is looked at first in a frame, without bounds from then on."""

        asked = 0
        tolerance = property(lambda self: self._next(), lambda self, value: None)

        def _next(self):
            self.asked += 1
            return RasterTolerance(0.25 if self.asked <= 2 else 1e6, 24)

    raster = Changes(None)
    outcome = judged(Draws(raster), frames=2)
    assert raster.asked == 2
    assert outcome.exit is Exit.VIOLATION
    assert outcome.cullers[0].raster == RasterTolerance(0.25, 24)
    later = judged(Draws(Changes(None)), frames=3)
    assert (len(later.cullers[0].frames), len(failures(later))) == (2, 1)


def test_the_loosest_tolerance_of_all_frames_is_recorded():
    class Widens(Rasterised):
        tolerance = property(lambda self: next(self.each), lambda self, value: None)

    raster = Widens(None)
    raster.each = iter([RasterTolerance(0.1, 32), RasterTolerance(0.3, None),
                        RasterTolerance(0.2, 16), RasterTolerance(0.0, 24)])  # fmt: skip
    (record,) = judged(Draws(raster), frames=4).cullers
    assert record.raster == RasterTolerance(0.3, 16)


SHAPE = (HEIGHT, WIDTH)
BAD_PICTURES = {
    "a list": np.full(SHAPE, -1).tolist(),
    "nothing": np.zeros((0, 0), np.int32),
    "an empty list": [],
    "text": "picture",
    "turned": np.full(SHAPE[::-1], -1),
    "flat": np.full(WIDTH * HEIGHT, -1),
    "floats": np.full(SHAPE, -1.0),
    "bools": np.zeros(SHAPE, np.bool_),
    "objects": np.full(SHAPE, -1, object),
    "below": np.full(SHAPE, -2),
    "above": np.full(SHAPE, 6),
    "unsigned": np.full(SHAPE, 2**64 - 1, np.uint64),
    "raises": lambda camera: 1 // 0,
}


@pytest.mark.parametrize("picture", BAD_PICTURES.values(), ids=BAD_PICTURES)
def test_what_is_no_picture_is_its_cullers_failure_alone(picture):
    # A tower a thousandth of a pixel wide on the middle column of samples would be excused.
    thin = Scene.from_objects(
        [("floor", *upright(9.0, -20.0)), ("tower", *upright(2.0, -5.0, -1e-4, 0.2)),
         ("wall", *upright(9.0, -10.0, -9.0, 9.0))]
    )  # fmt: skip
    tolerance = RasterTolerance(0.5, 24)
    good = judged(Draws(Rasterised(tolerance)), of=thin)
    assert good.cullers[0].totals.within_raster_tolerance == 1
    outcome = judged(Draws(Rasterised(tolerance, picture)), Draws(), of=thin)
    assert [record.exit for record in outcome.cullers] == [Exit.NOTHING_JUDGED, Exit.VIOLATION]
    assert failures(outcome)[0].startswith("item_buffer()")


def blank(camera):
    return np.full((camera.height, camera.width), -1, np.int32)


NEARS = [5e-324, 1e-300, 1e-100, 1e-30, 1e-12]


@pytest.mark.parametrize("bits", [16, 24, None])
@pytest.mark.parametrize("near", [*NEARS, 1e-6, 1e-3, 0.1])
def test_no_near_plane_excuses_what_is_lost_broadly_by_declaration(near, bits):
    (record,) = judged(Draws(Rasterised(RasterTolerance(0.5, bits))), near=near).cullers
    totals = record.totals
    assert (totals.missed, totals.confirmed, totals.within_raster_tolerance) == (1, 1, 0)
    assert record.exit is Exit.VIOLATION


@pytest.mark.parametrize("near", NEARS)
def test_an_empty_picture_is_no_excuse_where_the_buffer_tells_nothing_apart(near):
    (record,) = judged(Draws(Rasterised(RasterTolerance(0.5, 24), blank)), near=near).cullers
    assert record.exit is Exit.VIOLATION
    assert record.totals.confirmed == 1


def test_an_endless_orthographic_range_excuses_nothing():
    pose = look_at((0.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    for near, far in ((-1e300, 1e300), (0.0, 1e30), (-1e12, 100.0)):
        looked_at = scene()
        referee = Referee(looked_at, lambda of=looked_at: make_engine("exact", of))
        path = CameraPath((Camera(pose, WIDTH, HEIGHT, near, far, ymag=2.0),))
        culler = Draws(Rasterised(RasterTolerance(0.5, 16)))
        (record,) = referee.run(path, [0], [("draws", culler)]).cullers
        assert record.totals.confirmed == 1, (near, far)


@pytest.mark.parametrize(("near", "excused"), [(0.1, True), (2.0, False)])
def test_what_a_step_of_a_sensible_buffer_hides_stays_excused(near, excused):
    # A step of 16 bits is 2^-16 / near in 1 / depth, at depth 5 thus 25 times that in depth:
    # 0.0038 for near 0.1, and a twentieth of that for near 2, with room for float32's roundings.
    close = scene(gap=0.001)
    (record,) = judged(Draws(Rasterised(RasterTolerance(0.0, 16))), near=near, of=close).cullers
    assert record.totals.missed == 1
    assert record.totals.within_raster_tolerance == excused


def test_what_was_excused_is_in_the_verdict_with_the_tolerance():
    close = scene(gap=0.001)
    outcome = judged(Draws(Rasterised(RasterTolerance(0.0, 16))), Draws(), of=close, frames=2)
    told = verdict_json(outcome, close)["cullers"]
    excused, convicted = told.values()  # type: ignore[attr-defined]
    assert convicted["raster"] is None
    lost = excused["missed_pixels"]
    assert lost > 0
    assert excused["raster"] == {"snap_px": 0.0, "depth_bits": 16, "objects": 2, "samples": lost}
