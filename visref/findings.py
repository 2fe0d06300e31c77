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


@dataclass(frozen=True)
class Finding:
    """One occurrence: the rule's code, what was found, and where (culler, frame, object)."""

    code: str
    message: str
    culler: str = ""
    frame: int | None = None
    object: str = ""

    @property
    def rule(self) -> Rule:
        return RULES[self.code]


_CATALOGUE = (
    Rule(
        "MISSED_OBJECT",
        Severity.ERROR,
        "A visible object was not drawn, or not all of it that is seen",
        "At samples that the object owns, or where it is seen as glass, nothing that shows it "
        "was drawn, and exact arithmetic confirmed that. A culler that promises to be "
        "conservative must not do this, however much else of the object it draws. The witness "
        "replays with `visref explain`.",
    ),
    Rule(
        "DRAWN_HIDDEN",
        Severity.ERROR,
        "A hidden unit was drawn by a culler that promises not to",
        "Exact arithmetic found the unit hidden at every sample that its triangles cover. A "
        "culler that promises to be exact or aggressive must not draw it; for others it only "
        "costs.",
    ),
    Rule(
        "MISSED_DECLARED",
        Severity.INFO,
        "A visible object was not drawn in full, by a culler that does not promise to draw it",
        "The same as MISSED_OBJECT for a culler that declares itself aggressive or "
        "approximate: it is measured, not convicted.",
    ),
    Rule(
        "MISSED_TIE",
        Severity.INFO,
        "A tied object was left out while a co-owner was drawn",
        "Several objects lie at exactly the same nearest depth at every sample of this "
        "object. All of them are visible, but the picture loses no pixel.",
    ),
    Rule(
        "MISSED_WITHIN_RASTER",
        Severity.INFO,
        "A visible object was lost within the rasteriser's declared tolerance",
        "None of the object's samples survives the sub-pixel snap, depth step and float32 "
        "transform error that the rasteriser declares, and the rasteriser's own unculled "
        "picture lacks the object too. The culler is not to blame.",
    ),
    Rule(
        "UNDECIDED_OBJECT",
        Severity.WARNING,
        "Whether an undrawn object is visible depends on an alpha texture",
        "Every sample that the object could own lies at or behind a triangle with an alpha "
        "mask whose texture was not evaluated. Such samples neither clear nor convict.",
    ),
    Rule(
        "ENGINE_CORRECTED",
        Severity.INFO,
        "Exact arithmetic overruled the ray engine",
        "At some disputed samples the float32 ray engine named the wrong owner. The verdict "
        "uses the exact owner.",
    ),
    Rule(
        "ENGINE_BLIND_SPOTS",
        Severity.INFO,
        "The truth comes from a float32 engine",
        "Exact arithmetic re-decided every disputed sample, so each violation is an exact "
        "one; a miss that the ray engine itself does not see stays unseen, and ties that "
        "nobody disputed are not listed. `--engine exact` lists every miss and every tie.",
    ),
    Rule(
        "REBASE_INEXACT",
        Severity.WARNING,
        "The scene could not be moved to the origin without rounding",
        "The scene spans too many magnitudes for a translation that keeps every coordinate "
        "exact in float32. Far from the origin the ray engine may err; disputed samples are "
        "exact all the same.",
    ),
    Rule(
        "IMAGE_DIFFERS",
        Severity.WARNING,
        "The drawn set gives another picture than the whole scene",
        "Redrawn in id order by the same rasteriser, the drawn set's picture differs from "
        "the unculled one. It does not change the exit status: the verdict rests on rays "
        "and exact arithmetic.",
    ),
    Rule(
        "CULLER_FAILED",
        Severity.ERROR,
        "The culler broke down",
        "It raised an error or returned something that is no drawn set. Its remaining frames "
        "were not judged, so its verdict is inconclusive unless a violation came before.",
    ),
    Rule(
        "NO_GL",
        Severity.WARNING,
        "A GL method could not run",
        "No OpenGL context can be made on this machine; `visref doctor` says why.",
    ),
    Rule(
        "NOTHING_JUDGED",
        Severity.WARNING,
        "Nothing could be judged",
        "No frame was judged, or no object is visible in any of them. A run that checked "
        "nothing proves nothing: it is inconclusive.",
    ),
    Rule(
        "ANIMATION_IGNORED",
        Severity.WARNING,
        "Animated geometry is judged in its rest pose",
        "Only cameras may move. The file animates nodes, skins or morph targets.",
    ),
    Rule(
        "NONFINITE_DROPPED",
        Severity.WARNING,
        "Triangles with a NaN or infinite vertex were dropped",
        "`--lenient` was given. Without it such a file is an error.",
    ),
    Rule(
        "PARTLY_READ",
        Severity.WARNING,
        "Part of the scene file was not read",
        "The file uses an extension, a material or a feature that visref does not know, or a "
        "part of it is missing. The engine that draws it may see another scene than this one.",
    ),
    Rule(
        "NO_TRIANGLES",
        Severity.INFO,
        "An object has no triangles",
        "Points and lines own no samples; the object keeps its id and is never visible.",
    ),
    Rule(
        "ALPHA_MASK_CONSTANT",
        Severity.INFO,
        "A masked material without a texture was decided by its constant alpha",
        "Its triangles count as opaque, or were dropped where the alpha is below the cutoff.",
    ),
)

RULES: dict[str, Rule] = {rule.code: rule for rule in _CATALOGUE}


def document() -> str:
    """The catalogue as Markdown."""
    lines = [
        "# Findings",
        "",
        "Generated from `visref/findings.py` by `python -m visref.findings`; do not edit.",
        "",
        "| code | severity | meaning |",
        "|---|---|---|",
    ]
    lines += [f"| [`{r.code}`](#{r.code.lower()}) | {r.severity} | {r.title} |" for r in _CATALOGUE]
    for rule in _CATALOGUE:
        lines += ["", f"## {rule.code}", "", f"*{rule.severity}.* {rule.title}.", ""]
        lines.append(rule.explanation)
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    import sys

    sys.stdout.write(document())
