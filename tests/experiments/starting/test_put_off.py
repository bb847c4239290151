"""Modules whose import is put off: in a process of its own, because they are loaded here."""

import subprocess
import sys

import pytest

PREPARE = "import sys\nfrom experiments.starting.put_off import put_off\nput_off()\n"
LOADED = (
    "print(*(name for name in ('glfw.library', 'numpy.f2py.crackfortran', 'unittest.case') if name in sys.modules))"
)


def printed(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", PREPARE + code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_libraries_that_import_them_do_not_load_them():
    assert printed("import mujoco, scipy.linalg, scipy.ndimage\n" + LOADED) == ""


@pytest.mark.parametrize(
    ("code", "loaded"),
    [
        ("import glfw, mujoco; print(glfw.get_version_string() is not None)", "True"),
        ("from numpy.testing import assert_array_equal; assert_array_equal([1], [1]); print(True)", "True"),
        ("import numpy; numpy.testing.assert_array_equal([1], [1]); print(True)", "True"),
        ("import numpy.f2py.crackfortran as c; print(c.__name__)", "numpy.f2py.crackfortran"),
        ("import importlib.util as u; print(u.find_spec('glfw').name)", "glfw"),
        (
            "import glfw; glfw.init; import sys; print(sys.modules['glfw'].__name__, sys.modules['glfw'] is glfw)",
            "glfw False",
        ),
    ],
)
def test_they_are_loaded_by_whoever_needs_them(code, loaded):
    assert printed(code) == loaded


def test_a_name_that_a_module_lacks_is_reported_as_ever():
    assert printed("import glfw\ntry: glfw.nothing\nexcept AttributeError as e: print('nothing' in str(e))") == "True"


def test_modules_that_are_not_installed_stay_missing():
    code = "put_off(['not_installed'])\ntry: import not_installed\nexcept ImportError: print('missing')"
    assert printed(code) == "missing"
