import subprocess
import sys

import pytest

import sim
import trackslip


def modules_after(statement):
    code = f"""
import sys
before = set(sys.modules)
{statement}
print(*sorted(set(sys.modules) - before))
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize(("package", "some"), [(trackslip, "identify"), (sim, "Fleet")])
def test_every_public_name_is_there(package, some):
    assert some in package.__all__
    assert set(package.__all__) <= {*dir(package), "__version__"}
    assert all(getattr(package, name) is not None for name in package.__all__)
    with pytest.raises(AttributeError, match="nonsense"):
        _ = package.nonsense


def test_importing_the_package_imports_next_to_nothing():
    found = modules_after("import trackslip")
    assert {name for name in found if name.startswith("trackslip")} == {"trackslip"}
    assert not found & {"numpy", "scipy", "typing", "dataclasses", "pathlib"}
