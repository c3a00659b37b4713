"""Runs the Python code of the README and of the book."""

import importlib.util
import pathlib
import re
import subprocess
import sys

import pytest
from conftest import PATIENCE

ROOT = pathlib.Path(__file__).resolve().parents[3]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*/*.md"))]
# Its code is that of the recipes, which `test_recipes.py` runs.
PAGES.remove(ROOT / "docs" / "guide" / "simulators.md")

# What the example needs of MPI, for a single rank.
ONE_RANK = """
class World:
    rank, size = 0, 1

    def Gather(self, mine, everything, root):
        everything[:] = mine

    def bcast(self, value, root):
        return value

class MPI:
    COMM_WORLD = World()
"""


def code(page: pathlib.Path) -> str:
    """Returns the Python code of a page: later blocks continue earlier ones."""
    return "\n".join(re.findall(r"^```python\n(.*?)^```", page.read_text(), re.M | re.S))


@pytest.mark.parametrize("page", [page for page in PAGES if code(page)], ids=lambda p: p.stem)
def test_the_code_of_a_page_runs(page: pathlib.Path, tmp_path: pathlib.Path) -> None:
    program = code(page)
    if "mpi4py" in program and importlib.util.find_spec("mpi4py") is None:
        (tmp_path / "mpi4py.py").write_text(ONE_RANK)
    for module in ("MDAnalysis", "dask"):
        if module in program and importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed")
    # Warnings are errors, but those of MDAnalysis and its dependencies are not ours.
    strict = [] if "MDAnalysis" in program else ["-W", "error"]
    command = [sys.executable, *strict, "-c", program]
    subprocess.run(command, check=True, cwd=tmp_path, timeout=PATIENCE)


def test_some_pages_have_code() -> None:
    assert sum(bool(code(page)) for page in PAGES) >= 4
