"""A run's listener that labels its frames and writes what is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from visref.engines import TruthEngine
from visref.engines.exact import ExactEngine
from visref.errors import InputError
from visref.exact import ExactScene
from visref.files import refuse_inputs, replacing_file, replacing_folder
from visref.inputs import Inputs
from visref.judging.asking import Job
from visref.judging.referee import JudgedFrame
from visref.labels.bop import BOP_FOLDER, BopFolder, intrinsics
from visref.labels.coco import COCO_BEGINS, CocoFile
from visref.labels.frame import Labeller
from visref.labels.images import IMAGE_FOLDER, ImageFolder
from visref.labels.table import LabelTable
from visref.recordings.truth_file import TRUTH_BEGINS
from visref.visibility import FrameTruth, ObjectVisibility


@dataclass(frozen=True)
class LabelFiles:
    """Where labels go, None where they do not: `table` a Parquet file, `images` a folder, `coco` a
    JSON file, `bop` a folder."""

    table: Path | None = None
    images: Path | None = None
    coco: Path | None = None
    bop: Path | None = None

    @property
    def asked(self) -> dict[str, Path]:
        """What is asked for, by the option that names it."""
        named = {
            "--labels": self.table,
            "--images": self.images,
            "--coco": self.coco,
            "--bop": self.bop,
        }
        return {option: path for option, path in named.items() if path is not None}

    def check(self, inputs: Inputs, others: dict[str, Path]) -> None:
        """Raises InputError where two outputs, `others` among them, are one or one holds another,
        where one is an input, and where BOP cannot have a camera."""
        every = [*others.items(), *self.asked.items()]
        for place, (option, path) in enumerate(every):
            for other, earlier in every[:place]:
                one, two = path.resolve(), earlier.resolve()
                if one.is_relative_to(two) or two.is_relative_to(one):
                    raise InputError(
                        f"{option} and {other} are the same place, or one is in the other",
                        source=str(path),
                        fix="name two",
                    )
        for path in self.asked.values():
            refuse_inputs(path, inputs.files)
        if self.bop is not None:
            for frame in inputs.frames:
                for camera in inputs.path.views(frame):
                    intrinsics(camera)


class Labelling:
    """The listener; `labelling` makes one. `left_out`: objects without a pose in some frame."""

    def __init__(
        self,
        inputs: Inputs,
        engine: TruthEngine,
        table: LabelTable | None,
        images: ImageFolder | None,
        coco: CocoFile | None,
        bop: BopFolder | None,
    ) -> None:
        self._timeline = inputs.timeline
        if isinstance(engine, ExactEngine):
            exact = engine.arithmetic
        else:
            exact = ExactScene(inputs.timeline.still, threads=inputs.threads)
        self._labeller = Labeller(exact)
        self._table, self._images, self._coco, self._bop = table, images, coco, bop

    @property
    def left_out(self) -> Sequence[str]:
        return sorted(self._bop.left_out) if self._bop is not None else ()

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        scene = self._timeline.at(frame)
        labels = self._labeller.frame(scene, truth, seen)
        if self._table is not None:
            self._table.add(frame, labels)
        if self._images is not None:
            self._images.add(frame, truth, labels)
        if self._coco is not None:
            self._coco.add(frame, labels)
        if self._bop is not None:
            self._bop.add(frame, scene, truth, labels)

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        pass

    def on_frame_done(self, frame: int) -> None:
        pass


@contextmanager
def labelling(files: LabelFiles, inputs: Inputs, engine: TruthEngine) -> Iterator[Labelling]:
    """A listener; all of `files` are written when the block ends well, and none otherwise."""
    with ExitStack() as closing:

        def file(path: Path, begins: bytes) -> Path:
            return closing.enter_context(replacing_file(path, begins=begins))

        table_file = file(files.table, TRUTH_BEGINS) if files.table is not None else None
        coco_file = file(files.coco, COCO_BEGINS) if files.coco is not None else None
        images, bop = None, None
        if files.images is not None:
            folder = closing.enter_context(replacing_folder(files.images, kind=IMAGE_FOLDER))
            images = ImageFolder(folder, inputs.scene)
        if files.bop is not None:
            folder = closing.enter_context(replacing_folder(files.bop, kind=BOP_FOLDER))
            bop = BopFolder(folder, inputs.timeline)
        table = LabelTable(inputs.scene) if table_file is not None else None
        coco = CocoFile(inputs.scene) if coco_file is not None else None
        yield Labelling(inputs, engine, table, images, coco, bop)
        if table is not None and table_file is not None:
            table.write(
                table_file,
                engine=inputs.engine,
                exact=engine.exact,
                scene=inputs.scene.digest,
                path=inputs.path,
            )
        if coco is not None and coco_file is not None:
            coco.write(coco_file)
        if images is not None:
            images.finish()
        if bop is not None:
            bop.finish()
