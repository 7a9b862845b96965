"""Files beside the program: the service example of docs/howto/raspberry-pi.md, and the package's copyright file."""

import configparser
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def examples():
    """The unit and the journal's configuration, as docs/howto/raspberry-pi.md shows them."""
    text = (ROOT / "docs" / "howto" / "raspberry-pi.md").read_text(encoding="utf-8")
    return re.findall(r"```ini\n(.*?)```", text, re.DOTALL)


def test_the_service_example_is_bounded_and_confined(examples, tmp_path):
    unit, journal = (configparser.ConfigParser(interpolation=None, strict=True) for _ in range(2))
    unit.read_string(examples[0].replace("\\\n", ""))
    journal.read_string(examples[1])
    service = unit["Service"]
    for name in ("NoNewPrivileges", "PrivateNetwork", "DynamicUser"):
        assert service.getboolean(name)
    assert service["MemoryMax"] == "256M"
    assert service.getint("RestartSec") * unit["Unit"].getint("StartLimitBurst") < unit["Unit"].getint(
        "StartLimitIntervalSec"
    )
    assert service["LogNamespace"] == "ocisac"
    assert journal["Journal"]["RuntimeMaxUse"] == "64M"
    if shutil.which("systemd-analyze"):
        (tmp_path / "ocisac-rx.service").write_text(examples[0])
        command = ["systemd-analyze", "verify", "--man=no", str(tmp_path / "ocisac-rx.service")]
        told = subprocess.run(command, capture_output=True, text=True, timeout=60).stderr
        assert "Unknown" not in told


def test_the_debian_package_names_its_copyright():
    text = (ROOT / "cpp" / "cmake" / "copyright").read_text(encoding="utf-8")
    assert text.startswith("Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\n")
    words = " ".join((ROOT / "LICENSE").read_text(encoding="utf-8").split("\n\n", 2)[2].split())
    assert words in " ".join(text.replace("\n .\n", "\n").split())
    assert re.search(r"install\(FILES .*cmake/copyright", (ROOT / "cpp" / "CMakeLists.txt").read_text(encoding="utf-8"))
