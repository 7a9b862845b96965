"""``python -m ocisac_fast.cli``."""

import sys

from ocisac_fast.cli import main

sys.exit(main())
