"""Where the reported faults are tried: a village, a hall, a plaza full of people, and others, each
with a way through it that walks and turns. Each is made once, whoever asks for it.
"""

from tests.causes.reported.places.avenue import LEVEL_ENDS, avenue, level_of
from tests.causes.reported.places.basins import basins
from tests.causes.reported.places.bridges import bridges
from tests.causes.reported.places.canyon import PINE_ENDS, canyon
from tests.causes.reported.places.castle import castle, castle_room_of, openings
from tests.causes.reported.places.drawing import drawing
from tests.causes.reported.places.fairground import fairground
from tests.causes.reported.places.fleet import fleet
from tests.causes.reported.places.ground import globe, height, hills
from tests.causes.reported.places.hall import hall
from tests.causes.reported.places.harbour import harbour
from tests.causes.reported.places.interiors import doorways, library, mansion, room_of
from tests.causes.reported.places.making import Place
from tests.causes.reported.places.materials import forest, glasshouse, lake
from tests.causes.reported.places.moving import passages, plaza, reed_bed
from tests.causes.reported.places.outdoors import cellars, orchard, pond, sheds
from tests.causes.reported.places.quarry import FACE, quarry
from tests.causes.reported.places.railway import railway
from tests.causes.reported.places.space import space
from tests.causes.reported.places.stadium import stadium
from tests.causes.reported.places.strewn import groves, moving_groves, strewn
from tests.causes.reported.places.terminal import terminal
from tests.causes.reported.places.terraces import terraces
from tests.causes.reported.places.theatre import theatre
from tests.causes.reported.places.village import (
    far_village,
    village,
    village_from_above,
    village_twice,
    village_with,
)

__all__ = [
    "FACE",
    "LEVEL_ENDS",
    "PINE_ENDS",
    "Place",
    "avenue",
    "basins",
    "bridges",
    "canyon",
    "castle",
    "castle_room_of",
    "cellars",
    "doorways",
    "drawing",
    "fairground",
    "far_village",
    "fleet",
    "forest",
    "glasshouse",
    "globe",
    "groves",
    "hall",
    "harbour",
    "height",
    "hills",
    "lake",
    "level_of",
    "library",
    "mansion",
    "moving_groves",
    "openings",
    "orchard",
    "passages",
    "plaza",
    "pond",
    "quarry",
    "railway",
    "reed_bed",
    "room_of",
    "sheds",
    "space",
    "stadium",
    "strewn",
    "terminal",
    "terraces",
    "theatre",
    "village",
    "village_from_above",
    "village_twice",
    "village_with",
]
