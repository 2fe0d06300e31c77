"""Parts of a run, or of a truth, put together to what one run would have left.

The scene is not needed: a part's folder holds what is. Verdicts are gone through again as a referee
goes through them (`visref.judging.review`): ages and a policy hang on frames before.
"""

from visref.merging.folder import merge_into, merge_runs
from visref.merging.truths import merge_truths

__all__ = ["merge_into", "merge_runs", "merge_truths"]
