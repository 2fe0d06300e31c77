"""Any program as a culler: `PROGRAM … {scene} {path} {visible}`.

It is run once for a scene and a path, as it would be by hand: it reads the scene's file and the
path, writes recorded visible sets (or `{recording}`, a one-file recording) and ends. Then they are
judged like any engine's.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.culler import CullerError, DrawnSet, Promise, Raster, RasterTolerance, Recorded
from visref.errors import InputError
from visref.findings import Code
from visref.plug_ins.making import DEFAULT_TIME_LIMIT_S
from visref.plug_ins.printed import Said
from visref.plug_ins.program import run_program
from visref.recordings.along import check_along
from visref.recordings.gathering import missing_frames
from visref.recordings.recording import read_recording
from visref.recordings.visible_sets import Replay, VisibleSets, read_visible_sets
from visref.scene import Float64, Scene, Units

_PLACEHOLDER = re.compile(r"\{(\w+)\}")
_INPUTS = ("scene", "path")
# The file's name in the program's folder, by the placeholder that stands for it.
_OUTPUTS = {"visible": "visible.jsonl", "recording": "recording.jsonl"}
_WORLD = np.zeros(3)


@dataclass(frozen=True)
class Command:
    """A program and its arguments, as somebody gave them, and what they say of it.

    `words`: the program's file, absolute, then its arguments with their placeholders; `output`: the
    placeholder of the file that it writes. `raster`: the tolerance of the rasteriser behind its
    depth buffer, None where it has none.
    """

    text: str
    words: tuple[str, ...]
    output: str
    promise: Promise = Promise.CONSERVATIVE
    raster: RasterTolerance | None = None

    @classmethod
    def parse(
        cls,
        text: str,
        *,
        promise: Promise = Promise.CONSERVATIVE,
        raster: RasterTolerance | None = None,
    ) -> Command:
        """Read a command line, split as a shell does it, though no shell is asked. Raises
        InputError where it names no program, an unknown placeholder, or not one file to write."""
        try:
            words = shlex.split(text)
        except ValueError as error:
            raise _wrong(text, str(error).lower(), "close the quotes") from error
        if not words:
            raise _wrong(text, "it names no program", "write PROGRAM {scene} {path} {visible}")
        used = [name for word in words for name in _PLACEHOLDER.findall(word)]
        known = (*_INPUTS, *_OUTPUTS)
        for name in used:
            if name not in known:
                shown = ", ".join(f"{{{one}}}" for one in known)
                raise _wrong(text, f"{{{name}}} is no placeholder", f"known are {shown}")
        outputs = sorted({name for name in used if name in _OUTPUTS})
        if len(outputs) != 1:
            problem = "it has no placeholder for the file that it writes"
            if outputs:
                problem = f"it is to write {' and '.join(f'{{{name}}}' for name in outputs)}"
            raise _wrong(text, problem, "write {visible}, or {recording}")
        program = shutil.which(words[0])
        if program is None:
            problem, fix = f"there is no program '{words[0]}'", "check its name, or give its path"
            if Path(words[0]).exists():
                problem = f"'{words[0]}' is no program that can be run"
                fix = "make it executable (chmod +x), or name what runs it"
            raise _wrong(text, problem, fix)
        # Where it is started, it would be found again; a link stays what it is called by.
        words[0] = os.path.abspath(program)
        return cls(text, tuple(words), outputs[0], promise, raster)

    @property
    def name(self) -> str:
        """What reports call it: `command:` with the program's name and those of the files that
        follow it, up to the first option or placeholder (`command:python3 my_culler.py`)."""
        names = [Path(self.words[0]).name]
        for word in self.words[1:]:
            if word.startswith("-") or _PLACEHOLDER.search(word):
                break
            names.append(Path(word).name)
        return f"command:{' '.join(names)}"

    def filled(self, files: Mapping[str, Path]) -> list[str]:
        """The words, with a file's place for each placeholder."""
        return [_PLACEHOLDER.sub(lambda found: str(files[found[1]]), word) for word in self.words]


class CommandCuller(Recorded):
    """A program on one scene and one path: `prepare` runs it, and what it wrote is played back.

    `scene_file`: what {scene} stands for; the scene that `prepare` is given must be what that file
    holds. `path`: all of the path that it is run on, without gaps; {path} is a file of it in world
    coordinates, in the plain form of `CameraPath.to_json`. `frames`: those that will be asked for,
    all by
    default. `rest_pose`: what the scene's file animates stands as it does at rest, so the program
    is told no time. `cull_backfaces` is told by the environment: VISREF_CULL_BACKFACES is 1 or 0.

    The program has `time_limit_s` seconds in all (None: no limit), and `memory_limit` bytes for
    each of its processes; `say` is given each line that it prints. Whatever goes wrong with it is
    a CullerError of `prepare`.
    """

    name = "command"
    summary = "a program that writes recorded visible sets"
    timed = False

    def __init__(
        self,
        command: Command,
        scene_file: Path | str,
        path: CameraPath,
        *,
        frames: Sequence[int] | None = None,
        rest_pose: bool = False,
        cull_backfaces: bool = False,
        time_limit_s: float | None = DEFAULT_TIME_LIMIT_S,
        memory_limit: int | None = None,
        say: Said | None = None,
    ) -> None:
        self.command = command
        self.promise = command.promise
        self._scene_file = Path(scene_file).absolute()
        self._path = path
        self._frames = path.numbers if frames is None else frames
        self._rest_pose, self._cull_backfaces = rest_pose, cull_backfaces
        self._time_limit_s, self._memory_limit, self._say = time_limit_s, memory_limit, say
        self._replay: Replay | None = None

    @property
    def _played(self) -> Replay:
        if self._replay is None:
            raise CullerError("it was not prepared")
        return self._replay

    @property
    def joint(self) -> bool:  # type: ignore[override]
        return self._replay is not None and self._replay.joint

    @property
    def raster(self) -> Raster | None:  # type: ignore[override]
        return None if self._replay is None else self._replay.raster

    def prepare(self, scene: Scene) -> Units:
        """Run the program, read what it wrote. Raises CullerError."""
        with tempfile.TemporaryDirectory(prefix="visref-command-") as name:
            folder = Path(name)
            output = folder / _OUTPUTS[self.command.output]
            files = {
                "scene": self._scene_file,
                "path": folder / "path.json",
                self.command.output: output,
            }
            files["path"].write_text(json.dumps(self._told().to_json()), encoding="utf-8")
            run_program(
                self.command.filled(files),
                environment={
                    "TMPDIR": name,
                    "VISREF_CULL_BACKFACES": str(int(self._cull_backfaces)),
                },
                time_limit_s=self._time_limit_s,
                memory_limit=self._memory_limit,
                say=self._say,
                tidy=lambda text: _tidied(text, files, name),
            )
            self._replay = self._read(output, scene)
        return self._replay.prepare(scene)

    def _told(self) -> CameraPath:
        """The path as the program gets it."""
        path = self._path.relative_to(_WORLD)
        if self._rest_pose:
            frames = [replace(frame, time_s=None, clip=None) for frame in path.frames]
            path = replace(path, frames=tuple(frames))
        return path

    def _read(self, output: Path, scene: Scene) -> Replay:
        placeholder = f"{{{self.command.output}}}"
        if not output.is_file():
            what = "is no ordinary file" if output.exists() else "was not written"
            raise CullerError(f"it ended well, but {placeholder} {what}")
        try:
            recorded = self._recorded(output, scene)
        except InputError as error:
            # Records are the same wherever the files were.
            file = placeholder if error.source in ("", str(output)) else Path(error.source).name
            line = str(InputError(error.problem, fix=error.fix, place=error.place))
            line = line.replace(str(output), placeholder)
            raise CullerError(f"what it wrote to {file}: {line}") from error
        path = self._path.relative_to(scene.origin)
        return Replay(recorded, path, self.promise, self.command.raster)

    def _recorded(self, output: Path, scene: Scene) -> VisibleSets:
        """What was drawn in the frames that are judged. Raises InputError."""
        frames, limit = self._frames, self._memory_limit
        if self.command.output == "visible":
            return read_visible_sets(output, scene, frames, self._path, max_memory=limit)
        found = read_recording(output, scene, max_memory=limit)
        # It is judged by the path, whose cameras say where the samples are.
        check_along(found.path, self._told())
        missing = [frame for frame in frames if not found.path.has(frame)]
        if missing:
            error = missing_frames(missing, len(frames), "")
            cut_off = [text for code, text in found.path.remarks if code is Code.RECORDING_CUT_OFF]
            problem = ": ".join([*cut_off, error.problem])
            raise InputError(problem, place=error.place, fix=error.fix)
        return found.sets.only(frames)

    def seek(self, frame: int) -> None:
        self._played.seek(frame)

    def update(self, scene: Scene) -> None:
        """The program has been told by the path."""

    def cull(self, camera: Camera) -> DrawnSet:
        return self._played.cull(camera)

    def cull_joint(self, cameras: Sequence[Camera]) -> DrawnSet:
        return self._played.cull_joint(cameras)

    def bounds(self) -> Float64 | None:
        return self._played.bounds()


def _tidied(text: str, files: Mapping[str, Path], folder: str) -> str:
    """A program's words with placeholders for its files, so that records are the same wherever
    those were."""
    for name, file in files.items():
        text = text.replace(str(file), f"{{{name}}}")
    return text.replace(f"{folder}{os.sep}", "")


def _wrong(text: str, problem: str, fix: str) -> InputError:
    return InputError(problem, source=f'--command "{text}"', fix=fix)
