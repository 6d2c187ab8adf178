"""``python -m poseppl.cli``: the command line."""

import sys

from poseppl.cli import main

sys.exit(main())
