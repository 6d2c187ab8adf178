"""``python -m poseppl.cli``: the command line."""

import sys

from poseppl.cli import main

if __name__ == "__main__":
    sys.exit(main())
