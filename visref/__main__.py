"""python -m visref"""

import sys

from visref.cli import main

sys.exit(main())
