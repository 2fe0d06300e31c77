"""The start of the program: what was imported is no garbage, and what comes later may be."""

from __future__ import annotations

import subprocess
import sys

ASKING = """
import gc, sys
import visref.cli.main as cli
from visref.cli.entry import main
imported = len(gc.get_objects())
def asks(*, ready):
    during = gc.isenabled()
    ready()
    print(during, gc.isenabled(), gc.get_freeze_count() >= imported > 10_000)
    return 0
cli.main = asks
sys.exit(main())
"""


def test_garbage_is_looked_for_once_all_is_imported_and_only_in_what_is_new():
    done = subprocess.run(
        [sys.executable, "-c", ASKING], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["False", "True", "True"]
