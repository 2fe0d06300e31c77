"""Where the reported faults are tried: a village, a hall, a plaza full of people, and others, each
with a way through it that walks and turns. Each is made once, whoever asks for it.
"""

from tests.causes.reported.places.avenue import LEVEL_ENDS, avenue, level_of
from tests.causes.reported.places.ground import globe, height, hills
from tests.causes.reported.places.hall import hall
from tests.causes.reported.places.making import Place
from tests.causes.reported.places.materials import forest, glasshouse, lake
from tests.causes.reported.places.moving import passages, plaza, reed_bed
from tests.causes.reported.places.strewn import groves, moving_groves, strewn
from tests.causes.reported.places.village import (
    far_village,
    village,
    village_from_above,
    village_twice,
    village_with,
)

__all__ = [
    "LEVEL_ENDS",
    "Place",
    "avenue",
    "far_village",
    "forest",
    "glasshouse",
    "globe",
    "groves",
    "hall",
    "height",
    "hills",
    "lake",
    "level_of",
    "moving_groves",
    "passages",
    "plaza",
    "reed_bed",
    "strewn",
    "village",
    "village_from_above",
    "village_twice",
    "village_with",
]
