import contextlib
import importlib
import sys

import pytest

# pages train after others have drawn with OpenGL, in this process: docs/faq.md has the reason
with contextlib.suppress(ImportError):
    import torch._dynamo  # noqa: F401


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """An empty folder to run a page in, whose modules are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setenv("COLUMNS", "200")
    # others would take longer to start
    monkeypatch.setattr("experiments.common.sweep.processors", lambda: 1)
    importlib.invalidate_caches()
    yield tmp_path
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", None) or "").startswith(str(tmp_path)):
            del sys.modules[name]
