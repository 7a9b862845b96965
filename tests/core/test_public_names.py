"""Public names: each in its room, none hidden by a module, nothing imported before it is needed."""

import importlib
import pkgutil
import subprocess
import sys
import types

import pytest

import ocisac_fast


def test_every_public_name_is_what_its_room_holds():
    for module in pkgutil.iter_modules(ocisac_fast.__path__):
        if module.name != "smoke":
            importlib.import_module(f"ocisac_fast.{module.name}")
    assert len(ocisac_fast.__all__) <= 45
    for name, room in ocisac_fast._rooms_by_name().items():
        value = getattr(ocisac_fast, name)
        assert not isinstance(value, types.ModuleType), name
        assert value is getattr(importlib.import_module(room), name)
        assert name in dir(ocisac_fast)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = ocisac_fast.nothing


def test_import_brings_only_what_is_asked_for():
    program = (
        "import sys, ocisac_fast; ocisac_fast.Camera; print(*[m for m in sys.modules if m.startswith('ocisac_fast')])"
    )
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert {name.split(".")[1] for name in loaded if "." in name} <= {"_core", "camera", "core"}
