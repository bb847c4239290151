"""Trainings that are killed and resumed."""

import functools
import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from command_runs import ran

from experiments.train.training import CHECKPOINT, UNFINISHED, read_checkpoint
from sim.common.array_file import read_arrays

pytest.importorskip("stable_baselines3")
OPTIONS = (
    *("--robots", "4", "--horizon", "32", "--batch", "64", "--epochs", "1", "--network", "8"),
    *("--references", "slalom", "--threads", "1"),
)
UPDATE = 4 * 32
"""Steps of all robots between two updates."""
SHORT = str(5 * UPDATE)
LONG = str(20 * UPDATE)

# `os.kill` before the nth call of a function that changes files, or after the nth checkpoint is
# half written
KILLER = """
import os, signal, sys
import numpy
from experiments.cli import main

name, count = sys.argv[1], int(sys.argv[2])
module = numpy if name == "savez" else os
whole, calls = getattr(module, name), 0

def deadly(*args, **kwargs):
    global calls
    calls += 1
    if calls < count:
        return whole(*args, **kwargs)
    if name == "savez":
        whole(*args, **kwargs)
        args[0].truncate(args[0].tell() // 2)
        args[0].flush()
    os.kill(os.getpid(), signal.SIGKILL)

setattr(module, name, deadly)
main(sys.argv[3:])
"""


COMMAND = """
from experiments.__main__ import main
main()
"""


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """A function that returns the undisturbed training of so many steps."""

    @functools.cache
    def of(steps):
        out = tmp_path_factory.mktemp("undisturbed") / "out"
        return ran(out, "train", *OPTIONS, "--steps", steps)

    return of


def train(out, steps, code, *arguments):
    """Start a training in another process, or resume it if it has a checkpoint."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    resume = ("--resume",) if (out / UNFINISHED).is_file() else ()
    options = ("train", *OPTIONS, "--steps", steps, *resume, "--out", str(out))
    command = (sys.executable, "-c", code, *arguments, *options)
    return subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)


def steps_of(out):
    """Steps in the last checkpoint, which can always be read."""
    return read_checkpoint(out)["steps"] if (out / UNFINISHED).is_file() else 0


def assert_same_policy(resumed, undisturbed):
    assert resumed.summary["curve"] == undisturbed.summary["curve"]
    for name in ("policy.npz", CHECKPOINT):
        about, arrays = read_arrays(undisturbed.folder / name, name)
        again, others = read_arrays(resumed.folder / name, name)
        assert again == about
        for array in arrays:
            np.testing.assert_array_equal(others[array], arrays[array], err_msg=array)


@pytest.mark.parametrize(
    ("function", "call", "updates"),
    [
        pytest.param("replace", 4, 3, marks=pytest.mark.slow),
        ("savez", 2, 1),
        pytest.param("replace", 1, 0, marks=pytest.mark.slow),
    ],
)
def test_a_kill_while_storing_leaves_the_checkpoint_before(
    tmp_path, undisturbed, function, call, updates
):
    out = tmp_path / "out"
    with train(out, SHORT, KILLER, function, str(call)) as killed:
        killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    assert steps_of(out) == updates * UPDATE
    resume = ("--resume",) if updates else ()
    resumed = ran(out, "train", *OPTIONS, "--steps", SHORT, *resume)
    assert_same_policy(resumed, undisturbed(SHORT))
    assert not list(out.glob(".*"))


@pytest.mark.slow
@pytest.mark.parametrize("stop", [signal.SIGKILL, signal.SIGTERM])
def test_a_training_that_is_stopped_at_any_moment_resumes(tmp_path, undisturbed, stop):
    """Each of three processes is stopped soon after its first checkpoint, which later ones keep."""
    out = tmp_path / "out"
    moments = random.Random(int(stop))
    for _ in range(3):
        before = steps_of(out)
        with train(out, LONG, COMMAND) as process:
            while process.poll() is None and steps_of(out) == before:
                time.sleep(0.01)
            time.sleep(moments.uniform(0.0, 0.15))
            process.send_signal(stop)
            process.communicate()
        assert process.returncode == (-stop if stop is signal.SIGKILL else 130)
        assert steps_of(out) > before
    resumed = ran(out, "train", *OPTIONS, "--steps", LONG, "--resume")
    assert_same_policy(resumed, undisturbed(LONG))
