"""The papers' tables made again: what they need is run and recorded, then set beside what was
published.

`measure` runs; `write_tables` writes from the records alone.
"""

from visref.tables.output import write_tables
from visref.tables.recording import Measured, Progress, measure

__all__ = ["Measured", "Progress", "measure", "write_tables"]
