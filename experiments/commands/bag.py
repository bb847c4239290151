"""`trackslip bag`: what is in a bag, what trackslip takes of it, and the log that this makes."""

from experiments.options.bag import BagConfig as Config

EXAMPLES = (
    ("topics, and what is taken for what", "trackslip bag run.mcap"),
    ("as a log with units", "trackslip bag run.mcap --export log.parquet"),
    ("with other poses", "trackslip bag old.bag --poses tf:map:base_link --export log.csv"),
)


def run(config: Config) -> None:
    """Print the topics of each bag, or write the log."""
    from experiments.work.bag import run as work

    work(config)
