"""manifest.json and verdict.json as values, checked field by field.

What is refused here is what the schemas in `visref.schemas` refuse; a test holds the two together.
Fields that nobody here knows are ignored.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from visref.camera import MAX_IMAGE_SIDE, MAX_SAMPLES
from visref.culler import Promise, RasterTolerance
from visref.findings import Severity
from visref.run_folder.json_fields import Fields
from visref.run_folder.layout import (
    CAUSE_CODE,
    COUNTS,
    FORMAT,
    MISS_KINDS,
    PICTURES,
    READABLE,
    SINCE_VERSION_2,
    UNNAMED_VIEW,
    VERSION,
)
from visref.run_folder.rows import (
    CullerFacts,
    CullerVerdict,
    FindingRow,
    Manifest,
    Motion,
    MovedFrame,
    MovedObject,
    PathFacts,
    PictureSet,
    PolicyFacts,
    RunVerdict,
    SceneFacts,
    WaiverFacts,
    Witness,
)

FIX = "give a folder that `visref run` or `visref check` wrote"

STATUSES = ("no_violation_found", "violation", "inconclusive", "measured")
EXIT_STATUSES = (0, 1, 2, 3)
# A whole number without zeros before it, as JSON writes one as a key.
_AGE = re.compile("0|[1-9][0-9]{0,17}")
_DAY = re.compile("[0-9]{4}-[0-9]{2}-[0-9]{2}")
# Parts of file names, as `layout.slug` makes them: never a way out of the folder.
_SLUG = re.compile("[A-Za-z0-9._-]{1,100}")
_PICTURE = re.compile(rf"{PICTURES}/[A-Za-z0-9._-]{{1,250}}[.](png|jpg)")
_HEX_FINITE = ("shift_x_px", "shift_y_px")
_HEX_VECTORS = ("e", "F", "R", "U")


def read_manifest(value: object, source: str) -> Manifest:
    """The manifest from parsed JSON. Raises InputError naming `source` and the place."""
    top = Fields(value, source, FIX)
    version = top.plain().get("version")
    known = isinstance(version, int) and not isinstance(version, bool) and version in READABLE
    if top.plain().get("format") != FORMAT or not known:
        raise top.error(f"this manifest is not a run's (format {FORMAT}, version 1 to {VERSION})")
    assert isinstance(version, int)
    scene, path = top.inner("scene"), top.inner("path")
    exact = None
    if version >= 2 and not top.is_null("exact"):
        exact = top.flag("exact")
    facts = _path_facts(path)
    return Manifest(
        version,
        SceneFacts(
            scene.text("source"),
            scene.text("sha256"),
            scene.whole("objects"),
            scene.whole("triangles"),
        ),
        facts,
        top.text("engine"),
        exact,
        _settings(top),
        {
            name: CullerFacts(
                culler.text("promise", among=tuple(Promise)),
                culler.text("unit_kind"),
                culler.whole("units"),
                culler.text("slug", like=_SLUG),
                _raster(culler) if version >= 2 else None,
            )
            for name, culler in top.inner("cullers").items()
        },
        tuple(
            PictureSet(
                pictures.text("culler"),
                pictures.whole("frame"),
                _files(pictures.inner("files")),
                _view(pictures, version),
            )
            for pictures in top.each("pictures")
        ),
        _samples(top, version, facts),
        top.inner("versions").texts(),
        _machine(top),
        _motion(top) if version >= 2 else None,
        _policy(top) if version >= 2 else None,
    )


def _policy(top: Fields) -> PolicyFacts | None:
    if not top.has("policy") or top.is_null("policy"):
        return None
    policy = top.inner("policy")
    share = policy.number("max_undecided")
    if not 0.0 <= share <= 1.0:
        raise policy.error("it is no share from 0 to 1", "max_undecided")
    severities = policy.inner("severities")
    return PolicyFacts(
        policy.text("source"),
        policy.text("sha256"),
        _day(policy, "today"),
        policy.whole("latency_frames"),
        policy.whole("min_samples"),
        share,
        {name: severities.text(name, among=tuple(Severity)) for name in severities.plain()},
        tuple(
            WaiverFacts(
                waiver.text("object"),
                waiver.text("reason"),
                waiver.text_list("frames"),
                waiver.text("culler"),
                _day(waiver, "expires"),
            )
            for waiver in policy.each("waive")
        ),
    )


def _day(value: Fields, name: str) -> str | None:
    return None if value.is_null(name) else value.text(name, like=_DAY)


def _motion(top: Fields) -> Motion | None:
    if not top.has("motion") or top.is_null("motion"):
        return None
    return read_motion(top.inner("motion"))


def read_motion(motion: Fields) -> Motion:
    """What moved, as manifests and parts have it. Raises InputError for anything else."""
    return Motion(
        motion.whole("objects"),
        tuple(
            MovedFrame(*(one.whole(name) for name in ("frame", "moved", "appeared", "vanished")))
            for one in motion.each("frames")
        ),
        tuple(
            MovedObject(one.whole("object"), one.text("name"), one.whole("frames"))
            for one in motion.each("most")
        ),
    )


def _path_facts(path: Fields) -> PathFacts:
    count = path.whole("frames", least=1)
    if not path.has("numbers"):
        # As large as its samples, of which there are as many.
        return PathFacts(path.text("source"), path.text("sha256"), count, range(count))
    numbers = path.whole_list("numbers")
    if len(numbers) != count or any(one >= other for one, other in pairwise(numbers)):
        raise path.error("they are not a number per frame, ascending", "numbers")
    return PathFacts(path.text("source"), path.text("sha256"), count, numbers)


def _settings(top: Fields) -> dict[str, Any]:
    """Anything, but where it says how a scene was generated, that has names."""
    settings = top.inner("settings")
    if settings.has("generated"):
        settings.inner("generated")
    return top.free("settings")


def _files(files: Fields) -> dict[str, str]:
    return {name: files.text(name, like=_PICTURE) for name in files.plain()}


def _raster(culler: Fields) -> RasterTolerance | None:
    if culler.is_null("raster"):
        return None
    raster = culler.inner("raster")
    depth_bits = None if raster.is_null("depth_bits") else raster.whole("depth_bits", least=1)
    return RasterTolerance(raster.number("snap_px"), depth_bits)


def _machine(top: Fields) -> dict[str, Any]:
    machine = top.inner("machine")
    machine.text("cpu")
    machine.text("system")
    if not machine.is_null("cores"):
        machine.whole("cores", least=1)
    return top.free("machine")


def _samples(
    top: Fields, version: int, path: PathFacts
) -> Mapping[int, Mapping[str, Mapping[str, Any]]]:
    """The samples' definition by frame and view; in version 1 a frame has one without a name."""
    frames = top.each("samples")
    if version == 1:
        found = [{UNNAMED_VIEW: read_definition(frame)} for frame in frames]
    else:
        found = []
        for frame in frames:
            found.append({view: read_definition(definition) for view, definition in frame.items()})
            if not found[-1]:
                raise frame.error("a frame has at least one view")
    # Whether there are as many as frames, `check_manifest` asks.
    numbers = path.numbers if len(found) == path.frames else range(len(found))
    return dict(zip(numbers, found, strict=True))


def read_definition(definition: Fields) -> Mapping[str, Any]:
    """What `Camera.definition` gives: whole numbers of samples, hexadecimal floats else. Raises
    InputError for what no camera has, as a side that is too long."""
    definition.text("projection", among=("perspective", "orthographic"))
    width, height = (
        definition.whole(name, least=1, most=MAX_IMAGE_SIDE) for name in ("width", "height")
    )
    if width * height > MAX_SAMPLES:
        raise definition.error(f"{width} x {height} are more than {MAX_SAMPLES} samples", "width")
    for name in _HEX_FINITE:
        definition.hexadecimal(name, finite=True)
    for name in _HEX_VECTORS:
        definition.hexadecimal_vector(name)
    near, far = definition.hexadecimal("near"), definition.hexadecimal("far")
    if near == math.inf:
        raise definition.error("it is infinite", "near")
    if not near < far:
        raise definition.error("it is not less than 'far'", "near")
    return definition.plain()


def read_verdict(value: object, source: str, version: int) -> RunVerdict:
    """The verdict of a run folder of this version, from parsed JSON. Raises InputError naming
    `source` and the place."""
    top = Fields(value, source, FIX)
    if version >= 2 and top.whole("version") != version:
        raise top.error(f"its version is not the manifest's, {version}", "version")
    exit_status = top.whole("exit_status")
    if exit_status not in EXIT_STATUSES:
        raise top.error(f"it is {exit_status}", "exit_status")
    return RunVerdict(
        version,
        top.text("status", among=STATUSES),
        exit_status,
        {name: _culler(culler, version) for name, culler in top.inner("cullers").items()},
        tuple(_finding(finding) for finding in top.each("findings")),
    )


def _culler(culler: Fields, version: int) -> CullerVerdict:
    counts: dict[str, Any] = {
        name: SINCE_VERSION_2[name]
        if version == 1 and name in SINCE_VERSION_2
        else culler.whole(name)
        for name in COUNTS
    }
    return CullerVerdict(
        status=culler.text("status", among=STATUSES),
        promise=culler.text("promise", among=tuple(Promise)),
        frames=culler.whole("frames"),
        unit_kind=culler.text("unit_kind"),
        ages=_ages(culler.inner("ages")) if version >= 2 else {},
        causes=_causes(culler) if version >= 2 else (),
        worst=None if culler.is_null("worst") else _witness(culler.inner("worst"), version),
        excused_samples=_excused_samples(culler) if version >= 2 else None,
        **counts,
    )


def _excused_samples(culler: Fields) -> int | None:
    """How many samples the rasteriser's tolerance excused; None without one, or where a record
    does not say."""
    if "raster" not in culler.plain() or culler.is_null("raster"):
        return None
    raster = culler.inner("raster")
    raster.number("snap_px")
    if not raster.is_null("depth_bits"):
        raster.whole("depth_bits", least=1)
    raster.whole("objects")
    return raster.whole("samples")


def _causes(culler: Fields) -> tuple[dict[str, Any], ...]:
    causes = culler.each("causes")
    for cause in causes:
        read_cause(cause)
        for other in cause.each("alternatives"):
            other.text("cause", like=CAUSE_CODE)
            other.text("text")
        for name in ("misses", "examined", "objects"):
            cause.whole(name, least=1)
    return tuple(cause.plain() for cause in causes)


def read_cause(cause: Fields) -> None:
    """That a cause is named, in a code and in words, with its score."""
    cause.text("cause", like=CAUSE_CODE)
    cause.text("text")
    if not 0.0 <= cause.number("score") <= 1.0:
        raise cause.error("it is not from 0 to 1", "score")


def _ages(ages: Fields) -> dict[int, int]:
    """How many misses are of each age, in frames."""
    found = {}
    for name in ages.plain():
        if not _AGE.fullmatch(name):
            raise ages.error("an age is a whole number of frames", name)
        found[int(name)] = ages.whole(name)
    return found


def _witness(witness: Fields, version: int) -> Witness:
    wholes = ("frame", "object", "pixels", "owned", "x", "y", "triangle")
    return Witness(
        view=_view(witness, version),
        name=witness.text("object_name"),
        kind=witness.text("kind", among=MISS_KINDS),
        depth=witness.number("depth"),
        **{name: witness.whole(name) for name in wholes},
        margin_px=_margin(witness, "margin_px"),
        margin_depth=_margin(witness, "margin_depth"),
        partly=witness.flag("partly") if version >= 2 else False,
    )


def _margin(witness: Fields, name: str) -> float | None:
    return None if witness.is_null(name) else witness.number(name)


def _finding(finding: Fields) -> FindingRow:
    return FindingRow(
        finding.text("code"),
        finding.text("severity", among=tuple(Severity)),
        finding.text("message"),
        finding.text("culler"),
        None if finding.is_null("frame") else finding.whole("frame"),
        finding.text("object"),
    )


def _view(value: Fields, version: int) -> str:
    return value.text("view") if version >= 2 else UNNAMED_VIEW
