"""Completion of commands, options, values and file names by the shell."""

import os
import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("words", "want"),
    [
        ("ocisac rec", ["plain,receive"]),
        ("ocisac receive --line", ["plain,--line-code"]),
        ("ocisac receive --line-code man", ["plain,manchester"]),
        ("ocisac gain lamp", ["file,lamp"]),
    ],
)
def test_the_shell_completes(run, monkeypatch, words, want):
    monkeypatch.setenv("_OCISAC_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    assert run() == (0, want, [])


def test_completion_without_its_variables_is_one_line(run, monkeypatch):
    monkeypatch.setenv("_OCISAC_COMPLETE", "bash_complete")
    monkeypatch.delenv("COMP_WORDS", raising=False)
    want = "ocisac: COMP_WORDS: not set, allowed: _OCISAC_COMPLETE by a shell's script alone"
    assert run() == (2, [], [want])


def test_completion_to_a_full_output_is_one_line():
    with open("/dev/full", "w") as full:
        words = [sys.executable, "-m", "ocisac_fast.cli"]
        options = {"env": {**os.environ, "_OCISAC_COMPLETE": "bash_source"}, "stdout": full, "stderr": subprocess.PIPE}
        done = subprocess.run(words, **options, check=False)
    assert (done.returncode, done.stderr) == (2, b"ocisac: No space left on device\n")


def test_completion_in_bash():
    path = f"{os.path.dirname(sys.executable)}:{os.environ['PATH']}"
    script = """
        eval "$(_OCISAC_COMPLETE=bash_source ocisac)"
        COMP_WORDS=(ocisac de) COMP_CWORD=1 COMPREPLY=()
        _ocisac_completion ocisac
        echo "${COMPREPLY[@]}"
    """
    environment = {**os.environ, "PATH": path}
    done = subprocess.run(["bash", "-c", script], env=environment, capture_output=True, text=True)
    assert (done.stdout.split(), done.stderr) == (["detect", "demo"], "")
