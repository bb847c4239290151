import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import sim


def python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_every_public_name_is_there_where_type_checkers_find_it():
    tree = ast.parse(Path(sim.__file__).read_text())
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and "." in node.module]
    static = {alias.name: node.module for node in imports for alias in node.names}
    assert set(sim.__all__) == set(static) <= set(dir(sim))
    for name, module in static.items():
        assert getattr(sim, name) is getattr(importlib.import_module(module), name), name
    with pytest.raises(AttributeError, match="module 'sim' has no attribute 'Tank'"):
        sim.Tank  # noqa: B018


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
