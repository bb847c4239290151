"""`trackslip tune`: find controller gains, for each slip compensation on equal terms."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Final

import numpy as np
import tyro
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from experiments.benchmark.cases import BenchmarkCase
from experiments.benchmark.drive import ClosedLoops
from experiments.benchmark.gains import GAINS_FILE, ROUGHNESS_LIMIT, specified
from experiments.benchmark.rows import score
from experiments.common.choices import COMPENSATIONS, CONTROLLER_NAMES, TRAINING_PATHS
from experiments.common.lookup import tunable
from experiments.common.manifest import digest
from experiments.common.options import Distinct, Whole
from experiments.common.plain_json import write_json
from experiments.common.pool import Workers, processors, workers
from experiments.common.sweep import Row, Store, drive_fleet, fleets, resumable
from experiments.common.table import Table, number
from experiments.simulate.motors import print_motors
from experiments.simulate.options import ClosedLoopOptions
from sim.common.seeds import generator
from sim.runs.loop import MEASURED, Progress
from trackslip.errors import TrackslipError, require, require_positive
from trackslip.kinematics import Array
from trackslip.metrics import LOST

EXAMPLES: Final = (
    ("Eq. 31, with and without slip compensation", "trackslip tune linear"),
    ("your own controller", "trackslip tune my_controller:MyController --out out/mine"),
)
ESSENTIAL: Final = (
    "controllers",
    "compensations",
    "evaluations",
    "robot",
    "laws",
    "seeds",
    "threads",
    "out",
    "overwrite",
)
_MAX_EVALUATIONS: Final = 10_000
_POPULATION: Final = 12  # number of candidates in a generation
_COMPARED: Final = ("none", "icr_radius", "online")
_FLEETS: Final = (3, 32)  # numbers of robots in the smallest and the largest fleet worth driving

Gains = dict[str, float]
"""A controller's gains by name."""


@dataclass(frozen=True)
class Config(ClosedLoopOptions):
    """Find gains that minimise the position error on training paths and drawn plants, below a limit
    on roughness.

    Every controller and compensation gets the same number of evaluations. Each evaluation drives
    four paths, which are not in benchmark's fair suite, with a plant for each of the --seeds. An
    interrupted search resumes when it is run again with the same options.
    """

    controllers: tyro.conf.Positional[
        Annotated[tuple[str, ...], Distinct(), tyro.conf.arg(metavar="[CONTROLLER ...]")]
    ] = CONTROLLER_NAMES[1:]
    """Names, or MODULE:CLASS for your own; constructor parameters that default to positive floats
    are gains.
    """
    compensations: Annotated[
        tuple[str, ...], Distinct(), tyro.conf.arg(metavar=f"{COMPENSATIONS} ...")
    ] = _COMPARED
    """Compensations to tune for."""
    evaluations: Annotated[int, Whole(_POPULATION, _MAX_EVALUATIONS)] = 60
    """Number of candidates for each controller and compensation, in generations of 12."""
    roughness: float = ROUGHNESS_LIMIT
    """Limit on the root mean square rate of change of the set points, averaged over the training
    runs [rad/s^2].
    """
    seeds: Annotated[tuple[int, ...], Distinct(), Whole()] = (100,)
    """Seeds for training plants, random starts and scanner noise."""
    seed: Annotated[int, Whole()] = 0
    """Root seed for the search."""
    threads: Annotated[int, Whole(0, 1024)] = 0
    """Number of processes, 0 for one per processor; the results don't depend on it."""
    out: Path = Path("out/tune")
    """Folder for the results."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive("roughness", self.roughness)
        # a search with times that vary would not be the same again
        given = self.command_delay != MEASURED
        require(given, "command_delay", self.command_delay, "a time [s]")


def run(config: Config) -> None:
    """Search for gains, and store and print them."""
    loops = ClosedLoops(config, "drawn")
    pairs = product(config.controllers, config.compensations)
    searches = [Search(config, loops, *pair) for pair in pairs]
    loops.check([case for search in searches for case in search.cases({})])
    for name in config.controllers:
        tunable(name)
    ids = {id for search in searches for id in search.ids()}
    jobs = config.threads or processors()
    count = len(TRAINING_PATHS) * len(config.seeds) * len(ids)
    with (
        resumable(config, ids, "candidates tried") as (run, store),
        run.progress("runs", count, "runs") as report,
        workers("inline" if jobs == 1 else "processes", jobs) as pool,
    ):
        rows = [search.best(partial(search.drive, pool, store, report)) for search in searches]
        about = run.manifest(**loops.world.about)
        write_json(run.folder / GAINS_FILE, {"found_by": about, "gains": rows})
        run.write({"gains": rows}, manifest=about)
    gains_table(rows).print()
    print_motors(config.robot, loops.world.drive)
    for name in config.controllers:
        _, others = tunable(name)
        if others:
            print(
                f"Not tuned, as they do not default to a positive float: {', '.join(others)} of "
                f"{name}."
            )
    print(f"{config.out / GAINS_FILE}: {run.wall:.1f} s; trackslip benchmark --gains {config.out}")


@dataclass(frozen=True)
class Search:
    """The search for a controller's gains with a compensation.

    A candidate is a row: its `gains`; the means over the training runs of the `position` error
    after the transient [m] (0.5 m for a run that lost the path) and of the `roughness` [rad/s^2];
    and the `error` of a run that failed.
    """

    config: Config
    loops: ClosedLoops
    controller: str
    compensation: str

    def cases(self, gains: Gains) -> list[BenchmarkCase]:
        """The training runs with these gains."""
        controller = specified(self.controller, gains)
        runs = product(TRAINING_PATHS, self.config.seeds)
        return [
            BenchmarkCase(controller, self.compensation, path, "stone", "random", seed)
            for path, seed in runs
        ]

    def ids(self) -> list[str]:
        """Ids of all candidates: digests of everything that the search depends on, and of the
        candidate's number.
        """
        runs = [case.id for case in self.loops.identified(self.cases({}))]
        search = [runs, self.config.seed, self.config.roughness]
        generations = self.config.evaluations // _POPULATION
        return [digest([search, k]) for k in range(generations * _POPULATION)]

    def drive(
        self, pool: Workers, store: Store, report: Progress, generation: Mapping[str, Gains]
    ) -> list[Row]:
        """The candidates of a generation (gains by id), of which those missing from the store are
        driven.
        """
        missing = {
            id: self.cases(gains)
            for id, gains in generation.items()
            if id not in store.rows or store.rows[id]["gains"] != gains
        }
        stored = len(generation) - len(missing)
        report(stored * len(self.cases({})))

        # the runs of all candidates together
        runs = [case for cases in missing.values() for case in cases]
        driven: dict[str, Row] = {}
        drive = partial(drive_fleet, self.loops)
        for fleet in pool.each(drive, fleets(runs, pool.count, _FLEETS)):
            driven |= {row["run"]: row for row in fleet.rows}
            report(len(fleet.rows))

        rows = []
        for id, cases in missing.items():
            measured = [driven[case.name] for case in cases]
            rows.append(_candidate(id, generation[id], measured))
        store.keep(rows)
        return [store.rows[id] for id in generation]

    def cost(self, candidate: Row) -> float:
        """The position error [m]; above the roughness limit, a value above any error, which grows
        with roughness.
        """
        if candidate["error"] is not None:
            return np.inf
        excess = candidate["roughness"] / self.config.roughness
        return float(candidate["position"] if excess <= 1 else LOST * (1 + excess))

    def best(self, drive: Callable[[Mapping[str, Gains]], list[Row]]) -> Row:
        """The best gains within a factor of ten of the defaults in the controller's class.

        The search uses the logarithms of the gains. The defaults are the first candidate, and are
        kept if no candidate is smooth enough. Raises TrackslipError if runs fail with every
        candidate.
        """
        defaults, _ = tunable(self.controller)
        ids = self.ids()
        candidates: list[Row] = []

        def costs(logarithms: Array) -> Array:
            """Costs (S,) of candidates (gains, S)."""
            values = np.array(list(defaults.values())) * 10**logarithms.T
            gains = []
            for row in values:
                rounded = [float(f"{value:.4g}") for value in row]
                gains.append(dict(zip(defaults, rounded, strict=True)))
            next_ids = ids[len(candidates) :]
            rows = drive(dict(zip(next_ids, gains, strict=False)))
            candidates.extend(rows)
            return np.array([self.cost(row) for row in rows])

        # the defaults, and others spread evenly over the range
        rng = generator(self.config.seed, f"tune {self.controller} {self.compensation}")
        hypercube = qmc.LatinHypercube(len(defaults), rng=rng)
        first = qmc.scale(hypercube.random(_POPULATION), -1.0, 1.0)
        first[0] = 0.0
        differential_evolution(
            costs,
            [(-1.0, 1.0)] * len(defaults),
            init=first,
            maxiter=len(ids) // _POPULATION - 1,
            vectorized=True,
            updating="deferred",
            polish=False,
            tol=0.0,
            rng=rng,
        )

        default = candidates[0]
        best = min(candidates, key=self.cost)
        if self.cost(best) > LOST and default["error"] is None:
            best = default
        if best["error"] is not None:
            reason = f"no gains drive all training runs: {best['error']}"
            raise TrackslipError(f"{self.controller} with {self.compensation}: {reason}")
        return {
            "controller": self.controller,
            "compensation": self.compensation,
            "arguments": best["gains"],
            "error": best["position"],
            "roughness": best["roughness"],
            "default_error": default["position"],
            "default_roughness": default["roughness"],
        }


def _candidate(id: str, gains: Gains, runs: Sequence[Row]) -> Row:
    """The row of a candidate from its training runs, see Search."""
    errors = [run["error"] for run in runs if run["error"] is not None]
    roughness = None
    if not errors:
        roughness = float(np.mean([run["roughness"] for run in runs]))
    return {
        "id": id,
        "error": errors[0] if errors else None,
        "gains": gains,
        "position": float(np.mean([score(run) for run in runs])),
        "roughness": roughness,
    }


def gains_table(rows: Sequence[Row]) -> Table:
    """A table of the gains, and of errors and roughness with these gains and with the defaults."""
    header = (
        "controller",
        "compensation",
        "error [mm]",
        "by default",
        "rough [rad/s²]",
        "by default",
        "gains",
    )
    cells = [_gains_cells(row) for row in rows]
    return Table("Tuned gains, means over the training runs", header, cells, align="llrrrrl")


def _gains_cells(row: Row) -> tuple[str, ...]:
    gains = [f"{name} {value:g}" for name, value in row["arguments"].items()]
    return (
        row["controller"],
        row["compensation"],
        f"{1e3 * row['error']:.1f}",
        f"{1e3 * row['default_error']:.1f}",
        number(row["roughness"], 2),
        number(row["default_roughness"], 2),
        ", ".join(gains),
    )
