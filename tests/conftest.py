"""What all tests share: real recordings where they are to be had, and how hard hypothesis tries."""

import multiprocessing
import os
import pathlib

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
