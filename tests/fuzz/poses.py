"""Files of camera poses that other programs wrote."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.fuzz import rewrite, spoil
from tests.fuzz.limits import Folders
from tests.fuzz.target import Target
from visref.paths.conventions import find_convention
from visref.paths.lens import Lens
from visref.paths.pose_files import from_poses

CSV = b"time_s,name,x,y,z,qx,qy,qz,qw\n0,a,1,2,3,0,0,0,1\n0.5,b,1.5,2,3,0,0.6,0,0.8\n"
TUM = b"# timestamp x y z\n10.5 1 2 3 0 0 0 1\n10.75 -1e2 .5 3. 0.6 0 0 0.8\n"
IMAGES = b"# Image list\n1 1 0 0 0 1 2 3 1 b.jpg\n1.5 2.5 -1\n2 0.8 0 0.6 0 1 2 3 2 a 1.jpg\n\n"
CAMERAS = b"1 PINHOLE 640 480 500 500 310.5 244\n2 SIMPLE_RADIAL 64 48 40 32 24 0\n"


def _read(file: Path, folders: Folders) -> Any:
    del folders
    lens = None if file.name == "images.txt" else Lens(16, 12)
    path = from_poses(file, find_convention("unreal"), lens, near=0.5, far=math.inf)
    return [frame.definition() for frame in path.frames]


def _write(file: Path, folders: Folders) -> Sequence[str]:
    out = str(folders.out / "path.json")
    return ["path", "from-poses", str(file), "--convention", "opencv", "--out", out]


TARGETS = (
    Target("poses-csv", "case.csv", lambda: {"poses": CSV}, spoil.tokens, _read,
           rewrite.csv_text, _write),
    Target("poses-tum", "case.txt", lambda: {"tum": TUM}, spoil.tokens, _read,
           rewrite.lines(b"#"), _write),
    Target("poses-colmap", "images.txt", lambda: {"images": IMAGES}, spoil.tokens, _read,
           None, _write, {"cameras.txt": CAMERAS}),
)  # fmt: skip
