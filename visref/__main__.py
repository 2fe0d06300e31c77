"""python -m visref"""

import sys

from visref.cli.main import main

sys.exit(main())
