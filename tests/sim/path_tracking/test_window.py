"""The window of render_mode="human", on a virtual display where there is one."""

import os
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest

DRIVE = """
import gymnasium, numpy as np
env = gymnasium.make("sim:trackslip/PathTracking-v0", render_mode="human", reference="circle")
env.reset(seed=0)
for _ in range(20):
    env.step(np.array([0.7, 0.7], np.float32))
print("driven", flush=True)
input()
{end}
"""


@pytest.fixture
def display(tmp_path):
    """Name of a display and the file with its picture; None where it has no file."""
    if shutil.which("Xvfb"):
        read, write = os.pipe()
        screen = ("-screen", "0", "800x600x24", "-fbdir", str(tmp_path))
        server = subprocess.Popen(
            ["Xvfb", "-displayfd", str(write), *screen], pass_fds=[write], stderr=subprocess.DEVNULL
        )
        os.close(write)
        with os.fdopen(read) as number:
            name = number.readline().strip()
        assert name, "Xvfb doesn't start"
        yield f":{name}", tmp_path / "Xvfb_screen0"
        server.terminate()
        server.wait()
    elif os.environ.get("DISPLAY"):
        yield os.environ["DISPLAY"], None
    else:
        pytest.skip("there is neither a display nor Xvfb")


def colours(file):
    """Pixels (H, W, 3) of an X window dump, 32 bits each."""
    raw = file.read_bytes()
    header = np.frombuffer(raw, ">u4", 25)
    start, height, width = int(header[0] + 12 * header[19]), int(header[5]), int(header[4])
    return np.frombuffer(raw, np.uint8, offset=start)[: 4 * height * width].reshape(height, width, 4)[..., 2::-1]


def shows_path_and_robot(file):
    red, green, blue = np.moveaxis(colours(file).astype(int), -1, 0)
    path, bumper = (blue > red + 60) & (blue > green), (red > blue + 90) & (red > green + 40)
    return path.sum() > 100 and bumper.sum() > 20


@pytest.mark.parametrize("end", ["env.close()", "pass"], ids=["closed", "left open"])
def test_a_window_shows_the_robot_and_its_path(display, end):
    name, file = display
    program = subprocess.Popen(
        [sys.executable, "-c", DRIVE.format(end=end)],
        env=os.environ | {"DISPLAY": name},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert program.stdout.readline() == "driven\n", program.stderr.read()
    until = time.monotonic() + 60
    while file is not None and not shows_path_and_robot(file):  # the window renders in its own time
        assert program.poll() is None
        assert time.monotonic() < until, "nothing to see in the window"
        time.sleep(0.05)
    _, errors = program.communicate("\n", timeout=60)
    assert (program.returncode, errors) == (0, "")


def test_a_display_that_does_not_answer_is_an_error():
    code = DRIVE.format(end="") + "print('not reached')"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"DISPLAY": ":98765"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith("trackslip.errors.TrackslipError: rendering: no window opens here")
