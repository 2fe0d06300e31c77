"""python -m visref"""

import os
import sys

# `python -m` puts the current folder first, where a user's own `jinja2.py` would stand in for the
# library. The installed command does not, and this is the same program.
if not sys.flags.safe_path and sys.path[:1] == [os.getcwd()]:
    del sys.path[0]

from visref.cli.entry import main

sys.exit(main())
