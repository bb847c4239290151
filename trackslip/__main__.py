"""Entry point of `python -m trackslip`, which runs the command `trackslip` from the package
`experiments`.
"""

import importlib.util
import runpy
import sys

if importlib.util.find_spec("experiments") is None:
    sys.exit(
        "trackslip: the commands are in the package experiments; install all of trackslip to "
        "have them"
    )
runpy.run_module("experiments", run_name="__main__", alter_sys=True)
