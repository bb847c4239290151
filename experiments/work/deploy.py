"""`trackslip deploy`: an identified law for another program."""

from experiments.options.deploy import DeployConfig
from experiments.storage.whole_file import write_output
from trackslip.deploy.deploy import deployed
from trackslip.errors import OutputError
from trackslip.slip.stored_laws import SHIPPED


def run(config: DeployConfig) -> None:
    """Print the law, or write it."""
    if config.out is not None and config.out.is_dir():
        raise OutputError(f"out = {str(config.out)!r}: is a folder, must be a file")
    if config.out is not None and config.out.exists() and not config.overwrite:
        raise OutputError(f"{config.out}: exists already; --overwrite replaces it")
    found = deployed(config.path or SHIPPED, config.to, config.law)
    if config.out is None:
        print(found.text, end="")
        return
    write_output(config.out, lambda draft: draft.write_text(found.text, encoding="utf-8"))
    print(f"{config.out}: written for {config.to}, law {found.law}")
    if found.instead:
        print(found.instead)
