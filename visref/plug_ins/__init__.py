"""Cullers that nobody here wrote: each in a process of its own, or guarded in this one.

`making_cullers` decides which is which. Whatever a plug-in does (raises, exits, dies, hangs,
prints, writes into its arguments, opens a GL context), it is named for it, and the run goes on for
all others. A process of its own keeps faults apart; it is no sandbox: a plug-in runs with its
user's rights.
"""

from visref.plug_ins.making import (
    DEFAULT_TIME_LIMIT_S,
    Making,
    check_cullers,
    check_time_limit,
    is_ours,
    making_cullers,
)

__all__ = [
    "DEFAULT_TIME_LIMIT_S",
    "Making",
    "check_cullers",
    "check_time_limit",
    "is_ours",
    "making_cullers",
]
