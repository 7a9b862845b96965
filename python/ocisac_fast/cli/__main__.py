"""``python -m ocisac_fast.cli``."""

import sys

from ocisac_fast.cli import main

if __name__ == "__main__":
    sys.exit(main())
