"""`trackslip sensitivity`: how disturbances of scanner, mounting and field affect the identified slip."""

from experiments.options.sensitivity import SensitivityConfig as Config

EXAMPLES = (
    ("the paper's grid", "trackslip sensitivity"),
    ("a smaller one", "trackslip sensitivity --radii 0.5 1.5 --speeds 0.1 0.2 --duration 20"),
)


def run(config: Config) -> None:
    """Drive, evaluate, store and print."""
    from experiments.work.sensitivity import run as work

    work(config)
