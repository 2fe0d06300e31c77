"""The papers' tables made again: what they need is run and kept, then set beside what was
published.

`run_all` runs; `write_tables` writes from what is on disk.
"""

from visref.tables.at_once import default_workers
from visref.tables.output import write_tables
from visref.tables.progress import Progress
from visref.tables.runs import PaperRuns, run_all

__all__ = ["PaperRuns", "Progress", "default_workers", "run_all", "write_tables"]
