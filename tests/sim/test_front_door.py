import subprocess
import sys

CODE = """
import sys
import sim, sim.scanner.scanner, sim.drive.drive, sim.ground.ground, sim.robot.parameters
assert not [module for module in ("mujoco", "scipy", "sim.fleet") if module in sys.modules]
import gymnasium
for name in ("PathTracking", "Traverse"):
    print(gymnasium.make_vec(f"trackslip/{name}-v0", 2).reset(seed=0)[0].shape)
"""


def test_importing_the_package_starts_no_simulator_and_registers_the_environments():
    ran = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    assert ran.stdout == "(2, 19)\n(2, 63)\n"
