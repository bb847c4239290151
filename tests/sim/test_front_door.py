import subprocess
import sys

import pytest

LOADED = "import sys; print([m for m in ('mujoco', 'scipy', 'sim.fleet') if m in sys.modules])"
LIGHT = "sim, sim.scanner.scanner, sim.drive.drive, sim.ground.ground, sim.robot.parameters"
MADE = "import sim, gymnasium; print(gymnasium.make_vec('trackslip/{}-v0', 2).reset(seed=0)[0].shape)"


@pytest.mark.parametrize(
    ("code", "output"),
    [
        (f"import {LIGHT}; {LOADED}", "[]"),
        (MADE.format("PathTracking"), "(2, 19)"),
        (MADE.format("Traverse").replace("import sim,", "import").replace("'trackslip/", "'sim:trackslip/"), "(2, 63)"),
    ],
)
def test_importing_the_package_starts_no_simulator_and_registers_the_environments(code, output):
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == output
