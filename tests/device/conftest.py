"""The C++ executable."""

import os
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def run_command(run):
    """The command line in Python, beside the program."""
    return run


@pytest.fixture(scope="module")
def receiver():
    """The executable that OCISAC_RX names (`make test` does), else the newest of this tree's builds."""
    built = sorted(ROOT.glob("build/**/ocisac-rx"), key=os.path.getmtime)
    found = os.environ.get("OCISAC_RX") or (str(built[-1]) if built else shutil.which("ocisac-rx"))
    if found is None:
        pytest.skip("ocisac-rx is not built")
    return found
