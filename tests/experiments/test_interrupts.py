"""Interrupts at seeded moments of every command, and of a process that is deaf."""

import contextlib
import importlib.util
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import pytest
from command_runs import ran

from experiments.cli import commands
from experiments.common.sweep import STORE

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")

ROOT = Path(__file__).parents[2]
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
COMMANDS = {
    "benchmark": "benchmark --jobs 2 --out out",
    "calibrate": "calibrate --out out",
    "deploy": "deploy --to c --out out.h",
    "drive": "drive --out out",
    "evaluate": "evaluate {runs} --out out",
    "grid": "grid --jobs 2 --out out",
    "identify": "identify {runs} --out out",
    "log": "log {runs} --out out.csv",
    "plan": "plan --half-gauge 0.168 --sprocket-radius 0.06 --out out",
    "predict": "predict --out out",
    "reproduce": "reproduce --out out",
    "track": "track --out out",
    "train": "train --out out",
    "tune": "tune linear --out out",
    "validate": "validate --out out",
    "view": "view {runs} --save out.rrd",
    "wander": "wander --out out",
}
LIMIT = 5.0
"""Longest time from a signal to the end [s]."""
COUNT = 300
"""Number of interrupts in the slow test."""


@dataclass(frozen=True)
class End:
    """What is left of an interrupted command."""

    code: int
    wall: float
    """Time since the signal [s]."""
    message: str
    files: list[str]
    processes: list[psutil.Process]


@pytest.fixture(scope="session")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "grid"
    ran(folder, "grid", "--radii", "0.6", "1.5", "--speeds", "0.1", "--duration", "8")
    return folder


def test_every_command_is_interrupted():
    assert COMMANDS.keys() == commands().keys()


@contextlib.contextmanager
def started(arguments, folder, **options):
    """A Python process in a session of its own, with empty folders for work and for temporary
    files.
    """
    for name in ("work", "temporary"):
        (folder / name).mkdir(exist_ok=True)
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "TMPDIR": str(folder / "temporary"),
    }
    process = subprocess.Popen(
        [sys.executable, *arguments],
        cwd=folder / "work",
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
        **options,
    )
    with process:
        try:
            yield process
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def awaits_signals(process):
    """Wait until the process handles SIGTERM or has ended."""
    bit = 1 << (signal.SIGTERM - 1)
    status = Path(f"/proc/{process.pid}/status")
    while process.poll() is None:
        caught = next(line for line in status.read_text().splitlines() if "SigCgt" in line)
        if int(caught.split()[1], 16) & bit:
            return
        time.sleep(0.001)


def of_session(leader):
    """Processes of a session; they have a second to end after their leader."""
    deadline = time.monotonic() + 1
    while True:
        found = []
        for process in psutil.process_iter():
            with contextlib.suppress(ProcessLookupError, psutil.Error):
                if os.getsid(process.pid) == leader and process.pid != leader:
                    found.append(process)
        if not found or time.monotonic() > deadline:
            return found
        time.sleep(0.05)


def interrupted(process, folder, number, delay, group=False):
    """Send a signal after a delay [s], to the process alone or to its group; returns None if the
    process ended before.
    """
    try:
        process.wait(delay)
        return None
    except subprocess.TimeoutExpired:
        began = time.monotonic()
    (os.killpg if group else os.kill)(process.pid, number)
    _, message = process.communicate(timeout=60)
    wall = time.monotonic() - began
    store = folder / "work" / "out" / STORE
    kept = {folder / "work", folder / "temporary"}
    if store.exists():
        kept |= {store.parent, store, *store.glob("[!.]*")}
    files = [str(path.relative_to(folder)) for path in folder.rglob("*") if path not in kept]
    return End(process.returncode, wall, message, files, of_session(process.pid))


def require_clean(end):
    assert end.message.splitlines()[-1].startswith("trackslip: interrupted"), end
    assert end.message.count("\n") == 1, end
    assert end.code == 130, end
    assert end.wall < LIMIT, end
    assert not end.files, end
    assert not end.processes, end


def interrupt(seed, folder, runs, working=False):
    """Interrupt a command that is drawn, as are the signal and the moment, in the first second of
    the process or, for `working`, in the first four of its work in the results folder.
    """
    random = np.random.default_rng(seed)
    command = random.choice(sorted(COMMANDS))
    number = random.choice(SIGNALS)
    group = bool(random.integers(2))
    delay = random.random()
    if command == "train" and importlib.util.find_spec("torch") is None:
        command = "grid"
    arguments = COMMANDS[command].format(runs=runs).split()
    with started(["-m", "experiments", *arguments], folder) as process:
        awaits_signals(process)
        if working:
            delay *= 4
            out = folder / "work" / "out"
            while process.poll() is None and "--out out" in COMMANDS[command] and not out.exists():
                time.sleep(0.005)
        end = interrupted(process, folder, number, delay, group)
    print(command, number, f"{delay:.3f}", group, end)
    if end is not None and end.code != 0:  # else it had ended
        require_clean(end)


@pytest.mark.parametrize("seed", range(6))
def test_an_interrupt_in_the_first_second(seed, tmp_path, runs):
    interrupt(seed, tmp_path, runs)


BEGIN = """
import contextlib, hashlib, sys, time, weakref
from pathlib import Path
from experiments.common.interrupts import run_interruptible
from experiments.common.leftovers import temporary

def ready():
    print(flush=True)

"""


def ended(body, folder, number=signal.SIGTERM, times=1, delay=0.0, **options):
    """How a script ends whose function `body` prints a line and is then interrupted."""
    script = f"{BEGIN}def body():\n{body}\n\nrun_interruptible(body)"
    with started(["-c", script], folder, **options) as process:
        assert process.stdout.readline() == "\n"
        for _ in range(times - 1):
            process.send_signal(number)
            time.sleep(0.2)
        return interrupted(process, folder, number, delay)


DROPPED = """
    class Slow:
        def __del__(self):
            ready()
            time.sleep(0.3)
    Slow()
    time.sleep(60)
"""
CALLBACK = """
    class Owner: pass
    owner = Owner()
    reference = weakref.ref(owner, lambda _: (ready(), time.sleep(0.3)))
    del owner
    time.sleep(60)
"""
CAUGHT = """
    try:
        ready()
        time.sleep(60)
    except BaseException:
        pass
    time.sleep(60)
"""


@pytest.mark.parametrize("body", [DROPPED, CALLBACK, CAUGHT])
@pytest.mark.parametrize("number", SIGNALS)
def test_a_swallowed_interrupt_is_raised_again(body, number, tmp_path):
    require_clean(ended(body, tmp_path, number))


def test_an_interrupt_swallowed_at_the_end_is_reported(tmp_path):
    body = CAUGHT.replace("        pass\n    time.sleep(60)\n", "        pass\n")
    require_clean(ended(body, tmp_path))


def test_clean_up_is_not_interrupted(tmp_path):
    body = """
    try:
        ready()
        time.sleep(60)
    finally:
        time.sleep(1.5)
        print("cleaned up", file=sys.stderr)
"""
    end = ended(body, tmp_path, times=3)
    assert end.message == "cleaned up\ntrackslip: interrupted\n"
    assert end.code == 130


DEAF = """
    with temporary(Path("draft")) as draft, temporary(Path("file")) as file:
        draft.mkdir()
        (draft / "part").touch()
        file.touch()
        ready()
        hashlib.pbkdf2_hmac("sha256", b"", b"", 10**9)
"""
STUCK = """
    with temporary(Path("draft")) as draft:
        draft.mkdir()
        try:
            ready()
            time.sleep(60)
        finally:
            while True:
                with contextlib.suppress(OSError):
                    (draft / str(time.monotonic_ns())).touch()
                time.sleep(0.01)
"""


def test_a_deaf_process_is_ended_and_leaves_nothing(tmp_path):
    end = ended(DEAF, tmp_path, delay=1.0)
    require_clean(end)
    assert end.wall > 2.5


def test_clean_up_that_never_ends_is_ended(tmp_path):
    end = ended(STUCK, tmp_path)
    require_clean(end)
    assert end.wall > 2.5


def test_a_signal_ignored_before_stays_ignored(tmp_path):
    body = "    ready()\n    time.sleep(1)\n    print('done', file=sys.stderr)"
    ignoring = {"preexec_fn": lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN)}
    end = ended(body, tmp_path, signal.SIGHUP, **ignoring)
    assert (end.code, end.message) == (0, "done\n")


def test_the_exit_code_of_a_command_that_has_ended_stands(tmp_path):
    body = "    import atexit; atexit.register(lambda: (ready(), time.sleep(1)))\n    sys.exit(2)"
    end = ended(body, tmp_path)
    assert (end.code, end.message) == (2, "")


def test_an_exit_that_hangs_is_ended(tmp_path):
    body = "    import atexit; atexit.register(lambda: (ready(), time.sleep(60)))\n    sys.exit(2)"
    end = ended(body, tmp_path)
    assert end.code == 130
    assert end.wall < LIMIT


def test_a_platform_without_some_signals(monkeypatch):
    """As Windows, which has no SIGHUP."""
    script = (
        "import signal; del signal.SIGHUP\n"
        "from experiments.common.interrupts import run_interruptible\n"
        "run_interruptible(lambda: print('done'))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")


@pytest.mark.slow
@pytest.mark.parametrize("working", [False, True])
@pytest.mark.parametrize("seed", range(COUNT // 2))
def test_interrupts_of_all_commands(seed, working, tmp_path, runs):
    interrupt([seed, working], tmp_path, runs, working)
