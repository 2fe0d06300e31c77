"""Why was it missed? Causes of misses, each found by what would be seen if a rule were broken."""

from visref.causes.naming import CausesFound, Named
from visref.causes.watching import Watching

__all__ = ["CausesFound", "Named", "Watching"]
