"""Which hidden nodes are asked about together."""

from __future__ import annotations

import math
from collections.abc import Sequence


def chance_of_staying_hidden(frames: int) -> float:
    """Of a node that was hidden for so many frames in a row."""
    return 0.99 - 0.7 * math.exp(-frames)


def worth(nodes: int, chance: float) -> float:
    """Queries saved by one about so many nodes, for each that it costs: itself, and should they not
    all be hidden, which has this chance, one for each of them."""
    return nodes / (1.0 + (1.0 - chance) * nodes) if nodes > 1 else 1.0


def multiqueries(chances: Sequence[float]) -> list[list[int]]:
    """Places in `chances`, each once, those that are asked together in one list.

    Those most likely to stay hidden come first, and a query takes more of them while its worth
    grows.
    """
    rest = sorted(range(len(chances)), key=lambda place: -chances[place])
    result = []
    while rest:
        size, chance = 1, chances[rest[0]]
        for place in rest[1:]:
            together = chance * chances[place]
            if worth(size + 1, together) <= worth(size, chance):
                break
            size, chance = size + 1, together
        result.append(rest[:size])
        rest = rest[size:]
    return result
