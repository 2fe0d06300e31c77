"""The catalogue of findings. A finding is data: a stable code, a severity, a message, a place.

Codes never change their meaning; a code that goes out of use is not given to anything else.
`docs/findings.md` is generated from this module (`python -m visref.findings`).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Severity(StrEnum):
    """`error` fails a run, `warning` deserves a look, `info` explains a number."""

    ERROR = "error"
    WARNING = "warning"
    INFO = "info"


@dataclass(frozen=True)
class Rule:
    """One kind of finding: what it means and what its reader can do."""

    code: str
    severity: Severity
    title: str
    explanation: str


class Code(StrEnum):
    """The catalogue: every kind of finding there is, under its stable code."""

    rule: Rule

    def __new__(cls, rule: Rule) -> Code:
        code = str.__new__(cls, rule.code)
        code._value_ = rule.code
        code.rule = rule
        return code

    MISSED_OBJECT = Rule(
        "MISSED_OBJECT",
        Severity.ERROR,
        "A visible object was not drawn, or not all of it that is seen",
        "At samples that the object owns, or where it is seen as glass, nothing that shows it "
        "was drawn, and exact arithmetic confirmed that. A culler that promises to be "
        "conservative must not do this, however much else of the object it draws. The witness "
        "replays with `visref explain`.",
    )
    DRAWN_HIDDEN = Rule(
        "DRAWN_HIDDEN",
        Severity.ERROR,
        "A hidden unit was drawn by a culler that promises not to",
        "Exact arithmetic found the unit hidden at every sample that its triangles cover. A "
        "culler that promises to be exact or aggressive must not draw it; for others it only "
        "costs.",
    )
    MISSED_DECLARED = Rule(
        "MISSED_DECLARED",
        Severity.INFO,
        "A visible object was not drawn in full, by a culler that does not promise to draw it",
        "The same as MISSED_OBJECT for a culler that declares itself aggressive or "
        "approximate: it is measured, not convicted.",
    )
    MISSED_TIE = Rule(
        "MISSED_TIE",
        Severity.INFO,
        "A tied object was left out while a co-owner was drawn",
        "Several objects lie at exactly the same nearest depth at every sample of this "
        "object. All of them are visible, but the picture loses no pixel.",
    )
    MISSED_WITHIN_RASTER = Rule(
        "MISSED_WITHIN_RASTER",
        Severity.INFO,
        "A visible object was lost within the rasteriser's declared tolerance",
        "None of the object's samples survives the sub-pixel snap, depth step and float32 "
        "transform error that the rasteriser declares, and the rasteriser's own unculled "
        "picture lacks the object too. The culler is not to blame.",
    )
    MISSED_SMALL = Rule(
        "MISSED_SMALL",
        Severity.INFO,
        "A visible object lost fewer samples than the policy asks for",
        "It loses less than `min_samples` decided samples in that frame and drawn set. The user's "
        "policy accepts such a miss; it is counted as small.",
    )
    MISSED_LATE = Rule(
        "MISSED_LATE",
        Severity.INFO,
        "A visible object was missed no longer than the policy allows",
        "It had come into view less than `latency_frames` frames before, as where an answer comes "
        "a frame late. The user's policy accepts such a miss; it is counted as late.",
    )
    MISSED_WAIVED = Rule(
        "MISSED_WAIVED",
        Severity.INFO,
        "A visible object was missed, and the policy waives it",
        "A `[[waive]]` entry of the user's policy names this object in this frame; manifest.json "
        "has its reason.",
    )
    STALE_WAIVER = Rule(
        "STALE_WAIVER",
        Severity.ERROR,
        "A waiver of the policy is stale",
        "It has expired, or every frame that it covers was judged and it names no miss. A waiver "
        "that nothing needs hides the next fault: take it out, or renew it. The run is a "
        "violation by this, whatever its cullers are.",
    )
    NOT_DETERMINISTIC = Rule(
        "NOT_DETERMINISTIC",
        Severity.WARNING,
        "The culler answers otherwise when it is asked again",
        "With `--repeat` a culler is made anew and asked about all frames again. What it answers "
        "hangs on more than scene and path: its verdict is one of several, so it is inconclusive, "
        "unless it is a violation.",
    )
    MISALIGNED = Rule(
        "MISALIGNED",
        Severity.WARNING,
        "The recording fits another path than the one given",
        "It agrees badly with what the path's cameras see, and nearly fully once one ordinary "
        "mistake is undone: other axes, other units, another numbering. Then the violations tell "
        "of the input, not of the engine: mend that first. Agreement is Matthews' correlation "
        "between what was drawn and what is seen, in a few frames, evenly picked; "
        "docs/alignment.md says what is tried. Where an engine may cull that way by itself (a "
        "frame late, by another field of view) the message says so. The status stays as it is, "
        "unless `--if-misaligned inconclusive` was given.",
    )
    UNDECIDED_OBJECT = Rule(
        "UNDECIDED_OBJECT",
        Severity.WARNING,
        "Whether an undrawn object is visible depends on an alpha texture",
        "Every sample that the object could own hangs on an alpha mask that is neither solid nor "
        "a hole over the pixel, and some of what may be seen there was drawn. Such samples "
        "neither clear nor convict.",
    )
    MOSTLY_UNDECIDED = Rule(
        "MOSTLY_UNDECIDED",
        Severity.WARNING,
        "Most of what the verdict hangs on cannot be decided",
        "At so many samples the culler drew a part of what alpha masks may show there and left "
        "out the rest that nothing can be said of it: it is inconclusive. Look at them in a "
        "higher resolution, where a mask's edges cover fewer samples.",
    )
    ENGINE_CORRECTED = Rule(
        "ENGINE_CORRECTED",
        Severity.INFO,
        "Exact arithmetic overruled the ray engine",
        "At some disputed samples the float32 ray engine named the wrong owner. The verdict "
        "uses the exact owner.",
    )
    ENGINE_BLIND_SPOTS = Rule(
        "ENGINE_BLIND_SPOTS",
        Severity.INFO,
        "The truth comes from a float32 engine",
        "Exact arithmetic re-decided every disputed sample, so each violation is an exact "
        "one; a miss that the ray engine itself does not see stays unseen, and ties that "
        "nobody disputed are not listed. `--engine exact` lists every miss and every tie.",
    )
    ENGINE_WRONG = Rule(
        "ENGINE_WRONG",
        Severity.WARNING,
        "The ray engine gave wrong owners at samples whose owner is known",
        "In ten frames, evenly picked, triangles of every size that is shown were asked for by a "
        "ray through their centres, and some rays met only what lies behind. Float32 cannot tell "
        "apart what lies there, so misses may stay unseen. Each violation is exact all the same; "
        "`--engine exact` sees them all.",
    )
    TRUTH_UNSEALED = Rule(
        "TRUTH_UNSEALED",
        Severity.WARNING,
        "The truth file has no digest",
        "It is of version 1: whether somebody edited it after it was cast cannot be seen, and it "
        "does not say whether its engine is exact. Cast the truth again to have both.",
    )
    REBASE_INEXACT = Rule(
        "REBASE_INEXACT",
        Severity.WARNING,
        "The scene could not be moved to the origin without rounding",
        "The scene spans too many magnitudes for a translation that keeps every coordinate "
        "exact in float32. Far from the origin the ray engine may err; disputed samples are "
        "exact all the same.",
    )
    VERTICES_ROUNDED = Rule(
        "VERTICES_ROUNDED",
        Severity.WARNING,
        "Rounding to float32 moved what is seen by more than a sixteenth of a pixel",
        "The scene is too large for float32 vertices, even about an origin of its own. At samples "
        "where such a triangle was lost, or lies right behind what was, nobody is convicted.",
    )
    FAR_HIDES = Rule(
        "FAR_HIDES",
        Severity.WARNING,
        "Most of what the cameras meet lies beyond far",
        "In ten frames, evenly picked, and a few samples of each, more than half of what a ray "
        "meets first lies beyond the path's far plane: no culler can go wrong there. Are path and "
        "scene in the same units? No verdict rests on this.",
    )
    NEAR_HIDES = Rule(
        "NEAR_HIDES",
        Severity.WARNING,
        "Most of what the cameras meet lies before near",
        "As FAR_HIDES, for the near plane: the cameras look through what is nearest to them.",
    )
    INSIDE_OUT = Rule(
        "INSIDE_OUT",
        Severity.WARNING,
        "The scene looks inside out",
        "Triangles are one-sided, and in ten frames, evenly picked, most of what a ray meets "
        "first is a back face; or most closed objects among it enclose a negative volume and are "
        "seen from behind. Then near walls vanish and far ones show. Turn the winding of the "
        "model, or leave --cull-backfaces out. A room that is seen from within is right with its "
        "faces turned inwards.",
    )
    IMAGE_DIFFERS = Rule(
        "IMAGE_DIFFERS",
        Severity.WARNING,
        "The drawn set gives another picture than the whole scene",
        "Redrawn in id order by the same rasteriser, the drawn set's picture differs from "
        "the unculled one. It does not change the exit status: the verdict rests on rays "
        "and exact arithmetic.",
    )
    BOUNDS_TOO_SMALL = Rule(
        "BOUNDS_TOO_SMALL",
        Severity.WARNING,
        "A box that the culler tests does not contain what it stands for",
        "In these frames geometry lies outside its own box by more than float32 rounds, so a "
        "test of the box says nothing of it: sooner or later it vanishes in view. Usual causes "
        "are a box of the bind pose for a skinned mesh, of the rest shape for morph targets or "
        "for what a shader moves, last frame's box for what moves, and an instance's scale that "
        "the box lacks. It is said whether or not anything was missed.",
    )
    ABSENT_NAMED = Rule(
        "ABSENT_NAMED",
        Severity.INFO,
        "Something that is not there was drawn, and is ignored",
        "The path says that the object is absent in that frame (`absent`, another of its group's "
        "`levels`, or the file's own visibility), and the drawn set names it. It counts neither as "
        "drawn nor as superfluous. If the engine did draw it, the path tells of another moment "
        "than the engine's.",
    )
    CULLER_FAILED = Rule(
        "CULLER_FAILED",
        Severity.ERROR,
        "The culler broke down",
        "It raised an error or returned something that is no drawn set. Its remaining frames "
        "were not judged, so its verdict is inconclusive unless a violation came before.",
    )
    NO_GL = Rule(
        "NO_GL",
        Severity.WARNING,
        "A GL method could not run",
        "No OpenGL context can be made on this machine; `visref doctor` says why.",
    )
    NOTHING_JUDGED = Rule(
        "NOTHING_JUDGED",
        Severity.WARNING,
        "Nothing could be judged",
        "No frame was judged, or no object is visible in any of them. A run that checked "
        "nothing proves nothing: it is inconclusive.",
    )
    FIELD_IGNORED = Rule(
        "FIELD_IGNORED",
        Severity.WARNING,
        "A path, a recording or a policy has a field that is not known",
        "It may be a later version's, or misspelt: it was passed over, and the rest was read.",
    )
    CAMERA_MADE_RIGID = Rule(
        "CAMERA_MADE_RIGID",
        Severity.INFO,
        "A camera's matrix was not quite rigid, and was made so",
        "Printing with few digits leaves a rotation's axes not quite at right angles and of unit "
        "length. Up to 1e-4 the nearest rotation stands in, once, in float64; the samples are "
        "those of that camera. Print 9 digits of float32 and 17 of float64 to have your own.",
    )
    RECORDING_CUT_OFF = Rule(
        "RECORDING_CUT_OFF",
        Severity.WARNING,
        "The recording was cut off",
        "Whoever wrote it did not come to its end, as when an engine crashes or a recorder gives "
        "up. The frames before were judged.",
    )
    ANIMATION_IGNORED = Rule(
        "ANIMATION_IGNORED",
        Severity.WARNING,
        "Something that the file animates stands as it is written",
        "What of glTF and USD moves, deforms, hides and shows objects is played at a frame's time. "
        "A material's alpha, other properties, and other formats' animations are not.",
    )
    NONFINITE_DROPPED = Rule(
        "NONFINITE_DROPPED",
        Severity.WARNING,
        "Triangles with a NaN or infinite vertex were dropped",
        "`--lenient` was given. Without it such a file is an error.",
    )
    PARTLY_READ = Rule(
        "PARTLY_READ",
        Severity.WARNING,
        "Part of the scene file was not read",
        "The file uses an extension, a material or a feature that visref does not know, or a "
        "part of it is missing. The engine that draws it may see another scene than this one.",
    )
    UNITS_CONVERTED = Rule(
        "UNITS_CONVERTED",
        Severity.INFO,
        "The scene was converted to metres and +Y up",
        "The file says other units, or another axis that is up. Camera paths, poses and boxes of a "
        "recording are in metres with +Y up, as in glTF: convert the engine's alike.",
    )
    NO_TRIANGLES = Rule(
        "NO_TRIANGLES",
        Severity.INFO,
        "An object has no triangles",
        "Points and lines own no samples; the object keeps its id and is never visible.",
    )
    ALPHA_MASK_CONSTANT = Rule(
        "ALPHA_MASK_CONSTANT",
        Severity.INFO,
        "A masked material without a texture was decided by its constant alpha",
        "Its triangles count as opaque, or were dropped where the alpha is below the cutoff.",
    )


@dataclass(frozen=True)
class Finding:
    """One occurrence: its code, what was found, and where (culler, frame, object)."""

    code: Code
    message: str
    culler: str = ""
    frame: int | None = None
    object: str = ""

    @property
    def rule(self) -> Rule:
        return self.code.rule


# Errors that the status of their own culler says already.
_OF_A_CULLER = frozenset({Code.MISSED_OBJECT, Code.DRAWN_HIDDEN, Code.CULLER_FAILED})


def fails_run(code: str, severity: str) -> bool:
    """Whether a finding of this severity makes a run a violation, whatever its cullers are. Of a
    code that this version does not know, its run's status says enough."""
    known = code in Code.__members__
    return known and severity == Severity.ERROR and code not in _OF_A_CULLER


def rule_of(code: str, severity: str) -> Rule:
    """The rule of a finding on file. Where another version of visref wrote it, and this one does
    not know its code, what the record itself says of it."""
    if code in Code.__members__:
        return Code[code].rule
    return Rule(
        code,
        Severity(severity) if severity in tuple(Severity) else Severity.WARNING,
        "A finding that this version of visref does not know",
        "Another version wrote it. Its message says what was found; the catalogue of that "
        "version says what it means.",
    )


def document() -> str:
    """The catalogue as Markdown."""
    rules = [code.rule for code in Code]
    lines = [
        "# Findings",
        "",
        "Generated from `visref/findings.py` by `python -m visref.findings`; do not edit.",
        "",
        "| code | severity | meaning |",
        "|---|---|---|",
    ]
    lines += [f"| [`{r.code}`](#{r.code.lower()}) | {r.severity} | {r.title} |" for r in rules]
    for rule in rules:
        lines += ["", f"## {rule.code}", "", f"*{rule.severity}.* {rule.title}.", ""]
        lines.append(rule.explanation)
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    import sys

    sys.stdout.write(document())
