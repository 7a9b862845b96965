"""Shared by all tests: real recordings where they are to be had, the command line, and how hard hypothesis tries."""

import importlib.util
import json
import multiprocessing
import os
import pathlib
import subprocess
import sys
import warnings

# Before NumPy is loaded: threads of its linear algebra wait for each other in a loop, and tests run on all processors.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import HealthCheck, settings

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent

# The same draws in each run: a change is judged by its own failures. Nightly draws at random, and ten times as often.
settings.register_profile(
    "default", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.register_profile("nightly", settings.get_profile("default"), derandomize=False, max_examples=1000)
settings.register_profile("thorough", settings.get_profile("default"), max_examples=20_000)
settings.load_profile("default")

# Packages without which the tests of a room, or of a file of it, are skipped: those of the extras, and more.
FILES = ("PIL", "av")
CLI = (*FILES, "click", "rich", "matplotlib", "pyarrow", "fsspec")
NEEDED = {
    "files": (*FILES, "fsspec"),
    "cli": CLI,
    "cli/test_docs.py": ("distributed",),
    "batch": CLI,
    "batch/test_cluster.py": ("distributed",),
    "batch/test_workers.py": ("psutil",),
}


class Skipped(pytest.Module):
    """A file of tests that need a package which is not installed."""

    def collect(self):
        pytest.skip(f"could not import {', '.join(missing_of(self.path))}", allow_module_level=True)


def missing_of(path):
    names = NEEDED.get(path.parent.name, ()) + NEEDED.get(f"{path.parent.name}/{path.name}", ())
    return [name for name in names if importlib.util.find_spec(name) is None]


def pytest_pycollect_makemodule(module_path, parent):
    return Skipped.from_parent(parent, path=module_path) if missing_of(module_path) else None


@pytest.fixture
def run(capsys, monkeypatch):
    """Runs the command line in this process: code, lines of standard output, lines of standard error."""
    for package in CLI:
        pytest.importorskip(package)
    from ocisac_fast.cli import main

    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)  # put back after each run

    def call(*arguments):
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return code, captured.out.splitlines(), captured.err.splitlines()

    return call


@pytest.fixture
def facts(run):
    """Runs a command with --json, which must succeed: its objects."""

    def call(*arguments):
        code, out, err = run(*arguments, "--json")
        assert (code, err) == (0, [])
        return [json.loads(line, parse_constant=pytest.fail) for line in out]

    return call


@pytest.fixture(scope="session")
def program():
    """Runs the command line as a process: what subprocess.run gives, with all that is printed as text."""

    def call(*arguments, **options):
        command = [sys.executable, "-m", "ocisac_fast.cli", *map(str, arguments)]
        options = {"capture_output": True, "text": True, "timeout": 120, "check": False} | options
        return subprocess.run(command, **options)

    return call


@pytest.fixture(scope="session")
def recordings() -> pathlib.Path:
    """Folder of recordings made by real cameras: OCISAC_RECORDINGS, or shared/recordings beside the repository."""
    folder = pathlib.Path(os.environ.get("OCISAC_RECORDINGS", REPOSITORY.parent / "shared" / "recordings"))
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}")
    return folder


@pytest.fixture(scope="session")
def process_semaphores() -> None:
    """Semaphores between processes, which process pools and Dask's local workers need."""
    try:
        multiprocessing.get_context("fork").Lock()
    except OSError as error:
        pytest.skip(f"no semaphores between processes here, is /dev/shm writable? ({error})")
