import subprocess
import sys


def python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_importing_the_package_or_its_options_starts_no_simulator():
    loaded = "import sys; print([m for m in ('mujoco', 'scipy', 'sim.fleet') if m in sys.modules])"
    for module in ("sim", "sim.scanner.scanner", "sim.drive.drive", "sim.ground.ground", "sim.robot.parameters"):
        assert python(f"import {module}; {loaded}") == "[]\n", module


def test_importing_the_package_registers_the_environments():
    code = "print(gymnasium.make('sim:trackslip/PathTracking-v0').reset(seed=0)[0].shape)"
    assert python(f"import gymnasium; {code}") == "(19,)\n"
    code = "print(gymnasium.make('sim:trackslip/Traverse-v0').reset(seed=0)[0].shape)"
    assert python(f"import gymnasium; {code}") == "(63,)\n"
    assert python("import sim, gymnasium; print(gymnasium.make_vec('trackslip/PathTracking-v0', 2).num_envs)") == "2\n"
