"""`trackslip bench`: measure how fast the simulator is, store and print it."""

from experiments.options.bench import BenchConfig as Config

EXAMPLES = (
    ("the simulator", "trackslip bench"),
    ("a quick look", "trackslip bench --sizes 1 64 --thread-counts 1 --seconds 5 --repeats 3"),
    ("the learning environments", "trackslip bench --env"),
    ("tracks on terrain", "trackslip bench --terrain"),
    ("ground that shears", "trackslip bench --shear"),
    ("fleets on an NVIDIA GPU", "trackslip bench --gpu"),
    ("every stage beside its bound", "trackslip bench --pipeline"),
    ("many robots and long runs", "trackslip bench --scale"),
)


def run(config: Config) -> None:
    """Measure, store and print."""
    from experiments.work.bench import run as work

    work(config)
