"""The package as a whole: what its import needs and costs, what it says of itself, and that it lives beside cv2."""

import hashlib
import importlib.metadata
import importlib.resources
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import ocisac_fast
from ocisac_fast import _core


def run_python(program: str) -> str:
    """Standard output of a program run by a fresh interpreter that imports what this one does."""
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_import_needs_numpy_and_the_standard_library_only() -> None:
    loaded = run_python(
        "import sys; before = set(sys.modules); import ocisac_fast;"
        "print(*{name.partition('.')[0] for name in set(sys.modules) - before})"
    )
    foreign = set(loaded.split()) - sys.stdlib_module_names - {"numpy", "ocisac_fast"}
    assert {name for name in foreign if not name.startswith(("_", "pybind11"))} == set()


def test_import_is_quick_beside_that_of_numpy() -> None:
    program = (
        "import time; import numpy; start = time.perf_counter(); import ocisac_fast; print(time.perf_counter() - start)"
    )
    assert min(float(run_python(program)) for _ in range(3)) < 0.3


def test_version_is_that_of_the_distribution() -> None:
    assert ocisac_fast.__version__ == importlib.metadata.version("ocisac-fast") == _core.version()


def test_build_tells_its_commit_compiler_and_opencv() -> None:
    assert re.fullmatch("[0-9a-f]{7,40}|unknown", _core.commit())
    assert re.match(r"(GCC|Clang) \d+", _core.compiler())
    assert re.match(r"\d+\.\d+\.\d+|none, Eigen's FFT$", _core.opencv_version())


def test_package_is_marked_as_typed_and_ships_the_stub_of_its_names() -> None:
    files = importlib.resources.files(ocisac_fast)
    assert (files / "py.typed").is_file()
    assert "from ocisac_fast.camera import Camera as Camera" in (files / "__init__.pyi").read_text()


@pytest.mark.parametrize("first", ["cv2", "ocisac_fast"])
def test_lives_beside_cv2_in_one_process(first: str) -> None:
    """Both run their own OpenCV's DFT, in turn, and each keeps its own version."""
    pytest.importorskip("cv2")
    second = {"cv2": "ocisac_fast", "ocisac_fast": "cv2"}[first]
    program = f"""
import {first}, {second}
import numpy as np
from ocisac_fast import Camera, _core, tone_gain

version = _core.opencv_version()
rows = np.arange(720)
signals = 100 + 50 * np.cos(2 * np.pi * 9 / 720 * rows + np.arange(3)[:, np.newaxis])
camera = Camera(row_time=1.0)
for _ in range(2):
    spectra = cv2.dft(signals, flags=cv2.DFT_ROWS | cv2.DFT_COMPLEX_OUTPUT)
    assert np.allclose(np.hypot(*spectra[:, 9].T) / 360, 50)
    assert np.allclose(tone_gain(signals.T, camera, 9 / 720, method="dft").gain, 0.5)
assert _core.opencv_version() == version
"""
    run_python(program)


def test_the_bill_of_materials_names_all_that_the_wheel_links(tmp_path: Path) -> None:
    scripts = Path(__file__).parents[2] / "scripts"
    wheel = tmp_path / "ocisac_fast-1.2.3-cp311-cp311-linux_x86_64.whl"
    wheel.write_bytes(b"wheel")
    told = subprocess.run([sys.executable, scripts / "sbom", wheel], capture_output=True, text=True, check=True).stdout
    bill = json.loads(told)
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.5")
    parts = [bill["metadata"]["component"], *bill["components"]]
    assert {part["name"] for part in parts} == {"ocisac_fast", "opencv_core", "zlib", "highway", "eigen"}
    assert parts[0]["version"] == "1.2.3"
    assert parts[0]["hashes"][0]["content"] == hashlib.sha256(b"wheel").hexdigest()
    pinned = (scripts / "standalone-sources.txt").read_text()
    assert all(part["hashes"][0]["content"] in pinned for part in parts[1:])
    assert all("--hash=sha256:" in line for line in pinned.splitlines())


def test_the_recipe_of_conda_forge_is_rendered_for_every_python() -> None:
    rattler = pytest.importorskip("rattler_build")
    root = Path(__file__).parents[2]
    recipe = root / "recipe" / "recipe.yaml"
    tools = {
        "cxx_compiler": ["gxx"],
        "cxx_compiler_version": ["13"],
        "c_stdlib": ["sysroot"],
        "c_stdlib_version": ["2.17"],
    }
    pythons = [f"3.{minor}.*" for minor in range(11, 15)]
    variants = rattler.VariantConfig.from_yaml(json.dumps({**tools, "python": pythons}))
    rendered = rattler.Stage0Recipe.from_yaml(recipe.read_text(), recipe_dir=recipe.parent).render(variants)
    assert sorted(one.variant["python"] for one in rendered) == pythons
    project = tomllib.loads((root / "pyproject.toml").read_text())
    for one in rendered:
        assert one.recipe.package.version == _core.version()
        needed = [str(part).replace(" ", "") for part in one.recipe.requirements.host]
        assert {requirement.removesuffix(".0") for requirement in project["build-system"]["requires"]} <= set(needed)
        assert [str(part).replace(" ", "") for part in one.recipe.requirements.run][1:] == project["project"][
            "dependencies"
        ]
    assert (recipe.parent / rendered[0].recipe.build.script).stat().st_mode & 0o100


def test_the_workflow_of_ci_runs_every_step() -> None:
    """The workflow and the contributors' page name every step of ``.ci/run``."""
    root = Path(__file__).parents[2]
    run = root / ".ci" / "run"
    if not run.is_file():
        pytest.skip("no repository here")
    found = re.findall(r"^(?:steps|more)=\((.*?)\)", run.read_text(), re.MULTILINE)
    assert len(found) == 2
    steps = set(" ".join(found).split())
    called = re.findall(r"\.ci/run ([a-z ]+)|step: \[(.*)\]", (root / ".github" / "workflows" / "ci.yml").read_text())
    assert {step for words in called for step in re.findall("[a-z]+", " ".join(words))} == steps
    page = (root / "CONTRIBUTING.md").read_text().partition("## CI\n")[2]
    assert {step for step in steps if f"`{step}`" not in page} == set()
