"""Pictures of a judged frame: the shaded scene, who was drawn for what, and what is missing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from visref.judge import FrameVerdict
from visref.scene import Int32, Scene, Units
from visref.visibility import FrameTruth


@dataclass(frozen=True)
class PictureSet:
    """The files of one frame, relative to the run folder, by what they show."""

    culler: str
    frame: int
    files: dict[str, str]


def draw_pictures(
    folder: Path,
    stem: str,
    scene: Scene,
    truth: FrameTruth,
    units: Units,
    drawn_units: Int32,
    verdict: FrameVerdict,
    *,
    culler: str,
    frame: int,
) -> PictureSet:
    raise NotImplementedError
