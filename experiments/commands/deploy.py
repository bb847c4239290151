"""`trackslip deploy`: an identified law for another program."""

import contextlib
import os
from pathlib import Path

from experiments.options.deploy import DeployConfig
from trackslip.deploy.deploy import deploy_law
from trackslip.errors import OutputError
from trackslip.slip.stored_laws import SHIPPED


def run(config: DeployConfig) -> None:
    """Print the law, or write it."""
    if config.out is not None and config.out.is_dir():
        raise OutputError(f"out = {str(config.out)!r}: is a folder, must be a file")
    if config.out is not None and config.out.exists() and not config.overwrite:
        raise OutputError(f"{config.out}: exists already; --overwrite replaces it")
    text = deploy_law(config.path or SHIPPED, config.to, config.law)
    if config.out is None:
        print(text, end="")
        return
    _write(text, config.out)
    print(f"{config.out}: written for {config.to}")


def _write(text: str, file: Path) -> None:
    """A file, whole or not at all."""
    draft = file.with_name(f".{file.name}-{os.getpid()}")
    made = [folder for folder in file.parents if not folder.exists()]
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        draft.write_text(text, encoding="utf-8")
        os.replace(draft, file)
    except OSError as error:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
        for folder in made:  # leave no empty folders of ours behind
            with contextlib.suppress(OSError):
                folder.rmdir()
        why = "a folder of its path is a file" if isinstance(error, FileExistsError) else error.strerror or error
        raise OutputError(f"out = {str(file)!r}: can't be written ({why})") from error
