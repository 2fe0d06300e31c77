"""What engines and people hand in beside a scene: camera paths, recorded visible sets, recordings
and their units, and truth files.

`RecordingWriter` writes a recording, `read_recording` reads one; `pair_of_recording` and
`recording_of_pair` go between it and the two files that say the same.
"""

from visref.recordings.converting import pair_of_recording, recording_of_pair
from visref.recordings.recording import Recording, read_recording
from visref.recordings.units import read_units
from visref.recordings.visible_sets import Replay, VisibleSets, read_visible_sets
from visref.recordings.writing import RecordingWriter

__all__ = [
    "Recording",
    "RecordingWriter",
    "Replay",
    "VisibleSets",
    "pair_of_recording",
    "read_recording",
    "read_units",
    "read_visible_sets",
    "recording_of_pair",
]
