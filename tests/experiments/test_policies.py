"""Policy files from anywhere, given to the commands that drive with them."""

import sys

import numpy as np
import pytest

from sim.policy import Network, Policy, TrackingPolicy
from sim.traverse.policy import OPTIONS as CROSSING

ROBOTS_AND_PATHS = {"robot": "gone.toml", "ground": "gone.toml", "reference": "gone.csv"}
TRACK = ("track", "--reference", "circle", "--circle-duration", "1", "--localization", "truth")
BENCHMARK = ("benchmark", "--compensations", "none", "--seeds", "0", "--plants", "nominal")
DRIVE = (
    *("drive", "--course", "flat", "--preset", "fast", "--duration", "0.2"),
    *("--pictures", "0"),
)


@pytest.fixture(autouse=True)
def imported(tmp_path, monkeypatch):
    """The file that a user's module in the working folder writes when it is imported."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "own.py").write_text(
        "import pathlib\npathlib.Path('imported').touch()\n"
        "def effort(task):\n    return task.reward\n"
    )
    yield tmp_path / "imported"
    sys.modules.pop("own", None)


def tracking(**options):
    network = Network((np.zeros((19, 2)),), (np.zeros(2),))
    return TrackingPolicy(network, {"action": "twist"} | options, (0.1, 0.5))


def crossing(**options):
    return Policy(Network((np.zeros((63, 4)),), (np.zeros(4),)), CROSSING | options)


@pytest.mark.parametrize("option", ["own_rewards", "privileged"])
@pytest.mark.parametrize("policy", [tracking, crossing])
def test_no_code_is_imported_that_a_policy_names(trackslip, tmp_path, imported, policy, option):
    policy(**{option: {"own:effort": 1.0}}).save(tmp_path / "policy.npz")
    drives = {tracking: (*TRACK, "--controller", "ppo:."), crossing: (*DRIVE, "--policy", ".")}
    trackslip(*drives[policy])
    assert not imported.exists()


@pytest.mark.parametrize(
    ("policy", "command"),
    [
        (tracking, (*TRACK, "--controller", "ppo:.")),
        (tracking, (*BENCHMARK, "--controllers", "ppo:.")),
        (crossing, (*DRIVE, "--policy", ".")),
    ],
)
def test_policies_with_own_observations_are_refused(refused, tmp_path, imported, policy, command):
    policy(own_observations={"own:effort": 1.0}).save(tmp_path / "policy.npz")
    line = refused(*command)
    assert "own_observations of the policy = {'own:effort': 1.0}: must be empty" in line
    assert "MODULE:CLASS" in line
    assert not imported.exists()


def test_no_file_is_opened_that_a_policy_names(trackslip, tmp_path):
    tracking(**ROBOTS_AND_PATHS).save(tmp_path / "policy.npz")
    trackslip(*TRACK, "--controller", "ppo:.")
    crossing(robot="gone.toml", course="gone.toml").save(tmp_path / "policy.npz")
    trackslip(*DRIVE, "--policy", ".")


@pytest.mark.parametrize(
    ("controller", "message"),
    [
        ("ppo:policy.npz:gain=1", "ppo:policy.npz without arguments"),
        ("ppo:gone", "gone: No such file or directory"),
        (f"ppo:{'x' * 300}", "File name too long"),
        ("ppo:own.py", "own.py: not a policy.npz"),
    ],
)
def test_a_policy_that_cannot_be_read_is_named(refused, tmp_path, controller, message):
    tracking().save(tmp_path / "policy.npz")
    line = refused(*TRACK, "--controller", controller)
    assert message in line
    assert "out =" not in line
