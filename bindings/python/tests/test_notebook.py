"""Runs the notebook of the book."""

import pathlib

import pytest
from conftest import PATIENCE

NOTEBOOK = pathlib.Path(__file__).resolve().parents[3] / "docs" / "guide" / "ten-minutes.ipynb"


def test_the_notebook_runs_to_the_picture():
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    pytest.importorskip("matplotlib")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in cells)
    # All but the installation.
    assert [cell.metadata.get("tags", []) for cell in cells][:2] == [["skip-execution"], []]
    nbclient.NotebookClient(notebook, timeout=PATIENCE).execute()
    shown = [
        "".join(output.get("text", "") + str(output.get("data", "")) for output in cell.outputs)
        for cell in cells
    ]
    expected = [
        ["(0, 1, -1)"],
        [],
        ["intact: 80 frames"],
        ["changed: 80 frames", "data:image/svg+xml;base64,"],
        ["[a, b]", "fraction"],
        ["frame 27: changed", "0.79"],
    ]
    for found, words in zip(shown[1:], expected, strict=True):
        assert all(word in found for word in words), found
        assert "Warning" not in found
