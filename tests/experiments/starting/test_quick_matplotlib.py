import subprocess
import sys

import pytest

from experiments.cli import COMMANDS, DRAWING

_IMPORTS = "import sys, importlib; [importlib.import_module('experiments.commands.' + name) for name in sys.argv[1:]]; "


def of_process(code, *arguments):
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_commands_that_draw_nothing_at_first_do_not_import_matplotlib():
    others = [name for name in COMMANDS if name not in DRAWING]
    assert of_process(_IMPORTS + "print('matplotlib' in sys.modules)", *others) == ["False"]


@pytest.mark.slow
@pytest.mark.parametrize("name", DRAWING)
def test_commands_that_draw_import_matplotlib(name):
    assert of_process(_IMPORTS + "print('matplotlib' in sys.modules)", name) == ["True"]


def test_matplotlib_is_as_usual_once_it_is_imported():
    code = """
from experiments.starting.quick_matplotlib import import_matplotlib
import_matplotlib()
from matplotlib.lines import Line2D
from matplotlib.artist import kwdoc
class Mine(Line2D):
    pass
line = Mine([0, 1], [0, 1])
line.set(color="red", linewidth=3)
print(line.get_color(), line.get_linewidth(), "linewidth" in kwdoc(Line2D), Line2D.set.__doc__)
"""
    assert of_process(code) == ["red", "3.0", "True", "None"]
