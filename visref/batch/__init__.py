"""Many runs from one file: scenes × paths, each judged for several cullers, with one table and one
page at the end.

Each run is a `visref run` of its own, in a process of its own: it leaves what that command leaves,
and its end ends nobody else.
"""

from visref.batch.plan import Job, read_batch
from visref.batch.results import BatchResults, read_results, write_results
from visref.batch.running import Ended, Run, run_jobs, worst

__all__ = [
    "BatchResults",
    "Ended",
    "Job",
    "Run",
    "read_batch",
    "read_results",
    "run_jobs",
    "worst",
    "write_results",
]
