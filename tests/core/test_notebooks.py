"""The notebooks run from the first cell to the last; each cell draws a figure or a table, and none warns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

NOTEBOOKS = sorted((Path(__file__).parents[2] / "examples" / "notebooks").glob("*.ipynb"))
# Debuggers that look for frozen modules warn on standard error.
KERNEL = {"PYDEVD_DISABLE_FILE_VALIDATION": "1", "MPLBACKEND": "module://matplotlib_inline.backend_inline"}


def shown_by(cell: Any) -> set[str]:
    """The kinds of content that a cell displays."""
    return {kind for output in cell.outputs for kind in output.get("data", {})}


def test_there_are_three_notebooks():
    assert len(NOTEBOOKS) == 3


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.filterwarnings("default")  # of the client's own loop and sockets
def test_a_notebook_runs(path, tmp_path, monkeypatch):
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    pytest.importorskip("matplotlib")
    pytest.importorskip("pandas")
    for name, value in KERNEL.items():
        monkeypatch.setenv(name, value)
    notebook = nbformat.read(path, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)  # stored without outputs
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    for cell in notebook.cells:
        if cell.cell_type != "code":
            continue
        assert shown_by(cell) & {"image/png", "text/html"}, cell.source
        printed = [output.text for output in cell.outputs if output.output_type == "stream" and output.name == "stderr"]
        assert not printed, cell.source
