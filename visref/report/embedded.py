"""A run's pictures as a page embeds them, only if they are that: images of the run folder, of the
kind that their name says and of the size that their frame's pictures have."""

from __future__ import annotations

import base64
import io
import warnings

from PIL import Image

from visref.errors import InputError
from visref.run_folder.facts import FIX
from visref.run_folder.inside import read_inside
from visref.run_folder.layout import page_shape
from visref.run_folder.read import RunFolder

_FORMATS = {".png": ("PNG", "image/png"), ".jpg": ("JPEG", "image/jpeg")}
# Four bytes a pixel while it is decoded: 256 MB. A picture is at most 960 pixels wide.
MAX_PIXELS = 1 << 26
_MAX_BYTES = 1 << 28


def data_uri(run: RunFolder, name: str, frame: int, view: str) -> str:
    """A picture of a frame's view, by its name in the manifest, as a data URI.

    Raises InputError if it is missing or lies elsewhere, if it is no image of its kind or not of
    its frame's size, and if it cannot be decoded.
    """
    content, _ = _read(run, name, frame, view)
    return f"data:{_FORMATS[name[-4:]][1]};base64,{base64.b64encode(content).decode()}"


def picture_of(run: RunFolder, name: str, frame: int, view: str) -> Image.Image:
    """The same, decoded."""
    return _read(run, name, frame, view)[1]


def _read(run: RunFolder, name: str, frame: int, view: str) -> tuple[bytes, Image.Image]:
    content = read_inside(run.folder, name, "copy the run folder whole", most=_MAX_BYTES)
    format_, _ = _FORMATS[name[-4:]]

    def refused(problem: str) -> InputError:
        return InputError(problem, source=str(run.folder / name), fix=FIX)

    try:
        with warnings.catch_warnings():
            # The size is looked at here, before anything is decoded.
            warnings.simplefilter("ignore")
            picture = Image.open(io.BytesIO(content), formats=[format_])
            width, height = run.size(frame, view)
            if picture.size[::-1] != page_shape(width, height):
                raise refused("it is not of the size of its frame's pictures")
            if picture.width * picture.height > MAX_PIXELS:
                raise refused(f"it has more than {MAX_PIXELS} pixels")
            picture.load()
    except InputError:
        raise
    except Exception as error:
        # A decoder of files from anywhere fails in whatever way it does.
        raise refused(f"this is no {format_} picture") from error
    return content, picture
