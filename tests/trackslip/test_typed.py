import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROGRAM = """
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sim
import trackslip


class Saturating(trackslip.SlipLaw):
    def __call__(self, kappa: ArrayLike) -> NDArray[np.floating[Any]]:
        return np.stack([-0.1 * np.tanh(kappa), 0.1 * np.tanh(kappa)], axis=-1)


robot = trackslip.RobotGeometry(half_gauge=0.168, sprocket_radius=0.06)
found = trackslip.identify(Path("samples.csv"), robot)
laws: list[trackslip.SlipLaw] = [found.laws[found.best], Saturating(), trackslip.PUBLISHED]
low, high = found.intervals["icr"]["offset"]
page: Path = found.report("report.html")
reference: trackslip.Reference = trackslip.circle(1.0, 0.15, 10.0)
controller: trackslip.Controller = trackslip.LinearTimeVarying()
twist = controller.twist(0.0, reference.pose(0.0), reference)
fleet = sim.Fleet(sim.load_robot(), np.zeros((2, 3)), sim.Ground())
print(low < high, page.name, laws[0].sprocket_speeds(twist, robot).max(), fleet.pose().shape)
"""
WRONG = """
import trackslip

number: int = trackslip.__version__
trackslip.identify(3)
trackslip.nonsense
trackslip.Exponential("a", 1, 2, 3)
"""


def run(*command, cwd):
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        [*map(str, command)], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.slow
def test_a_users_program_type_checks_against_the_wheel(tmp_path):
    """Wrong types must be found: without py.typed everything is Any."""
    pytest.importorskip("hatchling", reason="hatchling builds the wheel")
    pytest.importorskip("mypy", reason="mypy checks the program")
    built = run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path, cwd=ROOT)
    assert built.returncode == 0, built.stderr
    (wheel,) = tmp_path.glob("*.whl")
    run(sys.executable, "-m", "venv", "--without-pip", "venv", cwd=tmp_path)
    python = tmp_path / "venv" / "bin" / "python"
    install = ("install", "--no-deps", "--no-index", "--no-compile", wheel)
    installed = run(sys.executable, "-m", "pip", "--python", python, *install, cwd=tmp_path)
    assert installed.returncode == 0, installed.stderr
    site = next((tmp_path / "venv" / "lib").glob("python*/site-packages"))
    # whose own .pth files aren't read
    (site / "others.pth").write_text(sysconfig.get_path("purelib") + "\n")
    (tmp_path / "program.py").write_text(PROGRAM)
    (tmp_path / "wrong.py").write_text(WRONG)
    options = ("--strict", "--python-executable", python, "--cache-dir", tmp_path / "cache")
    command = (sys.executable, "-m", "mypy", *options, "program.py", "wrong.py")
    said = run(*command, cwd=tmp_path).stdout
    assert "in 1 file (checked 2 source files)" in said, said
    assert "program.py" not in said, said
    assert all(f"wrong.py:{line}: error" in said for line in (4, 5, 6, 7)), said
