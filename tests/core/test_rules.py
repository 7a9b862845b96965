"""The page of rules against the constants of the core."""

import importlib.util
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).resolve().parents[2] / "docs" / "programs" / "rules.py"


@pytest.fixture
def program():
    spec = importlib.util.spec_from_file_location("rules", PROGRAM)
    module = importlib.util.module_from_spec(spec)
    sys.modules["rules"] = module  # dataclasses ask for it
    spec.loader.exec_module(module)
    return module


def test_the_page_has_the_rules_of_the_code(program):
    page = program.PAGE.read_text(encoding="utf-8")
    stated = [(row[1], row[2], row[3]) for row in program.ROW.finditer(page)]
    coded = [(rule.name, rule.file, rule.value) for rule in program.rules()]
    assert sorted(stated) == sorted(coded), "python docs/programs/rules.py --write"
