import json
import shutil
import subprocess

import numpy as np
import pytest
from deployed import GEOMETRY, stored, twists

from trackslip.deploy.deploy import c_text, deploy_law, python_text
from trackslip.errors import TrackslipError
from trackslip.laws.families import FAMILIES
from trackslip.laws.file import save_laws
from trackslip.laws.icr import IcrLoad

LAWS = stored()
OTHERS = stored({"turn_loss": {"offset": 0.3, "radius_error": 0.1, "turn_loss": -0.9}})
"""Laws that no robot has: compared where `twist` finds one that has the sprocket speeds."""
PROGRAMS = [name for name, family in FAMILIES.items() if "c" in family.targets]
CASES = [(LAWS, name) for name in PROGRAMS]
CASES += [(OTHERS, name) for name in OTHERS.laws if name != "none"]
STRICT = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow")
PROGRAM = """\
#include <stdio.h>
#include "law.h"

int main(void)
{
    double given[2];
    while (fread(given, sizeof(double), 2, stdin) == 2) {
        const struct trackslip_omega omega = trackslip_sprocket_speeds(given[0], given[1]);
        const struct trackslip_twist twist = trackslip_body_twist(given[0], given[1]);
        const double found[4] = {omega.left, omega.right, twist.v, twist.w};
        fwrite(found, sizeof(double), 4, stdout);
    }
    return 0;
}
"""


def expected(laws, name):
    """Twists, their sprocket speeds, sprocket speeds, and their twists; all (n, 2)."""
    law = laws.laws[name]
    twist = twists(500)
    with np.errstate(all="ignore"):
        omega = law.sprocket_speeds(twist, GEOMETRY)
        finite = omega[np.isfinite(omega).all(axis=1)]
        omegas = np.concatenate([twist / GEOMETRY.sprocket_radius, finite])
        twists_back = law.twist(omegas, GEOMETRY)
        missed = np.abs(law.sprocket_speeds(twists_back, GEOMETRY) - omegas).max(axis=1)
    is_solved = missed <= 1e-9 * np.abs(omegas).max(axis=1)
    if laws is LAWS:
        is_solved[:] = True
    assert is_solved.mean() > 0.5
    return twist, omega, omegas[is_solved], twists_back[is_solved]


def assert_same(found, known):
    """To 1e-12 of the larger of both numbers; for twists (v, b w)."""
    size = np.maximum(np.abs(known).max(axis=1, keepdims=True), 1e-300)
    np.testing.assert_allclose(found / size, known / size, rtol=0, atol=1e-12)


def compare(laws, name, sprocket_speeds, body_twist):
    twist, omega, omegas, twists_back = expected(laws, name)
    assert_same(sprocket_speeds(twist), omega)
    scale = np.array([1.0, GEOMETRY.half_gauge])
    assert_same(body_twist(omegas) * scale, twists_back * scale)


def compile_law(folder, laws, name, *command):
    """A function from (n, 2) numbers to the header's four results (n, 4)."""
    (folder / "law.h").write_text(c_text(laws, name))
    (folder / "main.c").write_text(PROGRAM)
    subprocess.run([*command, *STRICT, "main.c", "-o", "main", "-lm"], cwd=folder, check=True)

    def results(given):
        program = [folder / "main"]
        done = subprocess.run(program, input=given.tobytes(), capture_output=True, check=True)
        return np.frombuffer(done.stdout).reshape(-1, 4)

    return results


IN_C = [(*case, "cc -std=c99") for case in CASES]
IN_CPP = (*CASES[-1], "g++ -std=c++11 -x c++")


@pytest.mark.parametrize(("laws", "name", "command"), [*IN_C, IN_CPP])
def test_the_header_is_the_law(laws, name, command, tmp_path):
    if shutil.which(command.split()[0]) is None:
        pytest.skip("needs a compiler")
    run = compile_law(tmp_path, laws, name, *command.split())
    compare(laws, name, lambda twist: run(twist)[:, :2], lambda omega: run(omega)[:, 2:])


@pytest.mark.parametrize(("laws", "name"), CASES)
def test_the_python_file_is_the_law(laws, name):
    text = python_text(laws, name)
    assert {line for line in text.splitlines() if "import" in line} <= {"import math"}
    names = {}
    exec(compile(text, name, "exec"), names)

    def each(function):
        return lambda given: np.array([names[function](*pair) for pair in given.tolist()])

    compare(laws, name, each("sprocket_speeds"), each("body_twist"))


@pytest.mark.parametrize(
    ("to", "name", "message"),
    [
        ("c", "icr_load", "c can express constant ICRs and turn loss"),
        ("python", "exponential", "python can express constant ICRs and turn loss"),
        ("ros2_control", "icr_load", "ros2_control can only express constant ICRs"),
    ],
)
def test_inexpressible_laws_are_refused(to, name, message, tmp_path):
    file = tmp_path / "laws.json"
    laws = dict(LAWS.laws, icr_load=IcrLoad(0.04, GEOMETRY.half_gauge, 0.01, 0.08))
    save_laws(file, {name: laws[name]}, GEOMETRY)
    said = rf"law = '{name}': {message}; those in laws.json: none"
    with pytest.raises(TrackslipError, match=said):
        deploy_law(file, to, name)
    assert json.loads(deploy_law(file, "json", name))["law"] == name
