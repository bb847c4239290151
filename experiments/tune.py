"""`trackslip tune`: find the gains of controllers, for each slip compensation on equal terms."""

import contextlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import tyro
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from experiments.benchmark.cases import BenchmarkCase
from experiments.benchmark.drive import ClosedLoops
from experiments.benchmark.gains import GAINS_FILE, specified
from experiments.benchmark.rows import score
from experiments.common.choices import COMPENSATIONS, CONTROLLER_NAMES, TRAINING_PATHS
from experiments.common.lookup import tunable
from experiments.common.manifest import digest, relative
from experiments.common.options import Distinct, Whole
from experiments.common.plain_json import write_json
from experiments.common.pool import Workers, processors, workers
from experiments.common.run import Run
from experiments.common.sweep import Row, drive_fleet, fleets
from experiments.common.table import Table
from experiments.simulate.options import ClosedLoopOptions
from sim.loop import Progress
from sim.seeds import generator
from trackslip.errors import TrackslipError, require_positive
from trackslip.kinematics import Array
from trackslip.metrics import LOST

EXAMPLES = (
    ("Eq. 31, with and without slip compensation", "trackslip tune linear"),
    ("your own controller", "trackslip tune my_controller:MyController --out out/mine"),
)
TRIALS_FILE = ".trials.jsonl"
"""File in OUT with the trials of a search that isn't finished."""
_MAX_EVALUATIONS = 10_000
_POPULATION = 12  # candidates of a generation
_FLEETS = (3, 32)  # robots of the smallest and the largest fleet worth driving


@dataclass(frozen=True)
class Config(ClosedLoopOptions):
    """Find gains that minimise the position error on training paths and drawn plants, below a limit on roughness.

    Every controller and compensation gets the same number of evaluations. Each evaluation drives four paths, which the
    suite fair of benchmark does not have, with --seeds plants each. An interrupted search resumes when it is run again
    with the same options.
    """

    controllers: tyro.conf.Positional[
        Annotated[tuple[str, ...], Distinct(), tyro.conf.arg(metavar="[CONTROLLER ...]")]
    ] = CONTROLLER_NAMES[1:]
    """Names, or MODULE:CLASS for your own, whose constructor's positive numbers are the gains."""
    compensations: Annotated[tuple[str, ...], Distinct(), tyro.conf.arg(metavar=f"{COMPENSATIONS} ...")] = (
        "none",
        "icr_radius",
        "online",
    )
    """Compensations to tune for."""
    evaluations: Annotated[int, Whole(_POPULATION, _MAX_EVALUATIONS)] = 60
    """Candidates for each controller and compensation, in generations of 12."""
    roughness: float = 2.0
    """Limit on the root mean square rate of change of the set points, averaged over the training runs [rad/s^2]."""
    seeds: Annotated[tuple[int, ...], Distinct(), Whole()] = (100,)
    """Seeds of training plants, random starts and the scanner's noise."""
    seed: Annotated[int, Whole()] = 0
    """Root seed of the search."""
    threads: Annotated[int, Whole(0, 1024)] = 0
    """Number of processes, 0 for one per processor; the results don't depend on it."""
    out: Path = Path("out/tune")
    """Folder for the results."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive("roughness", self.roughness)


def run(config: Config) -> None:
    """Search, store and print."""
    loops = ClosedLoops(config, "drawn")
    pairs = list(product(config.controllers, config.compensations))
    loops.check([case for pair in pairs for case in _cases(config, *pair)])
    for name in config.controllers:
        tunable(name)
    generations, jobs = config.evaluations // _POPULATION, config.threads or processors()
    with (
        Run(config) as run,
        run.progress("generations", generations * len(pairs), "generations") as report,
        workers("inline" if jobs == 1 else "processes", jobs) as pool,
    ):
        training = Training(config, loops, pool)
        rows = []
        for controller, compensation in pairs:
            rows.append(best_gains(config, controller, compensation, training, report))
        about = run.manifest(**loops.world.about)
        found_by = {name: about[name] for name in ("arguments", "git", "versions")}
        found_by |= {"paths": TRAINING_PATHS, "seeds": config.seeds, "roughness": config.roughness}
        write_json(run.folder / GAINS_FILE, {"found_by": found_by, "gains": rows})
        run.write({"gains": rows}, manifest=about)
    gains_table(rows).print()
    print(f"{config.out / GAINS_FILE}: {run.wall:.1f} s; trackslip benchmark --gains {config.out}")


class Trial(NamedTuple):
    """Means over the training runs of one candidate."""

    error: float
    """Position error after the transient, 0.5 m for a run that lost the path [m]."""
    roughness: float
    """Root mean square rate of change of the set points, infinite if a run failed [rad/s^2]."""
    failure: str = ""
    """Reason why a run failed, or none could be driven."""

    def cost(self, limit: float) -> float:
        """The error; above the limit on roughness more than any error, and the more the rougher [m]."""
        return self.error if self.roughness <= limit else LOST * (1 + self.roughness / limit)


class Training:
    """Drives the training runs of candidates.

    Finished trials are kept in TRIALS_FILE, a line each with the digest of their runs, so that a search resumes.
    """

    def __init__(self, config: Config, loops: ClosedLoops, pool: Workers) -> None:
        self._config, self._loops, self._pool = config, loops, pool
        self._file = config.out / TRIALS_FILE
        self._finished: dict[str, Trial] = {}
        for line in self._file.read_text(encoding="utf-8").splitlines() if self._file.exists() else ():
            with contextlib.suppress(ValueError, TypeError):  # cut short when the search was killed
                key, values = json.loads(line)
                self._finished[key] = Trial(*values)

    def tried(self, controllers: Sequence[str], compensation: str) -> list[Trial]:
        """The trials of candidates; one that can't be made has an infinite error."""
        trials: dict[str, Trial] = {}
        cases: dict[str, list[BenchmarkCase]] = {}
        for name in controllers:
            try:
                self._loops.controller(name)
                cases[name] = self._loops.identified(_cases(self._config, name, compensation))
            except TrackslipError as error:
                trials[name] = Trial(np.inf, np.inf, str(error))
        keys = {name: digest([case.id for case in runs]) for name, runs in cases.items()}
        missing = [name for name, key in keys.items() if key not in self._finished]
        runs = fleets([case for name in missing for case in cases[name]], self._pool.count, _FLEETS)
        rows: dict[str, Row] = {}
        for fleet in self._pool.each(partial(drive_fleet, self._loops), runs):
            rows |= {row["id"]: row for row in fleet.rows}
        for name in missing:
            trials[name] = _mean([rows[case.id] for case in cases[name]])
            if not trials[name].failure:
                self._keep(keys[name], trials[name])
        return [trials.get(name) or self._finished[keys[name]] for name in controllers]

    def _keep(self, key: str, trial: Trial) -> None:
        self._finished[key] = trial
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(f"\n{json.dumps([key, trial])}")  # the break is first, as the last line may be cut short


def _cases(config: Config, controller: str, compensation: str) -> list[BenchmarkCase]:
    """The training runs of a controller."""
    driven = product(TRAINING_PATHS, config.seeds)
    return [BenchmarkCase(controller, compensation, path, "stone", "random", seed) for path, seed in driven]


def _mean(rows: Sequence[Row]) -> Trial:
    error = float(np.mean([score(row) for row in rows]))
    for row in rows:
        if row["error"] is not None:
            return Trial(error, np.inf, row["error"])
    return Trial(error, float(np.mean([row["roughness"] for row in rows])))


def best_gains(config: Config, controller: str, compensation: str, training: Training, report: Progress) -> Row:
    """The best gains of a controller with a compensation, within a factor of ten of the defaults of its class.

    The search is in the logarithms of the gains, and the defaults are the first candidate. `report` is told of each
    generation. Raises TrackslipError if a run fails with each of the candidates.
    """
    defaults = tunable(controller)
    trials: list[tuple[dict[str, float], Trial]] = []

    def costs(logarithms: Array) -> Array:
        """Costs (S,) of candidates (gains, S)."""
        values = np.array(list(defaults.values())) * 10**logarithms.T
        rounded = [[float(f"{value:.4g}") for value in row] for row in values]
        candidates = [dict(zip(defaults, row, strict=True)) for row in rounded]
        tried = training.tried([specified(controller, gains) for gains in candidates], compensation)
        trials.extend(zip(candidates, tried, strict=True))
        report(1.0)
        return np.array([trial.cost(config.roughness) for trial in tried])

    rng = generator(config.seed, f"tune {controller} {compensation}")
    first = qmc.scale(qmc.LatinHypercube(len(defaults), rng=rng).random(_POPULATION), -1.0, 1.0)
    first[0] = 0.0
    differential_evolution(
        costs,
        [(-1.0, 1.0)] * len(defaults),
        init=first,
        maxiter=config.evaluations // _POPULATION - 1,
        vectorized=True,
        updating="deferred",
        polish=False,
        tol=0.0,
        rng=rng,
    )
    gains, best = min(trials, key=lambda pair: pair[1].cost(config.roughness))
    if best.failure:
        raise TrackslipError(f"{controller} with {compensation}: no gains drive all training runs: {best.failure}")
    default = trials[0][1]
    row: Row = {"controller": controller, "compensation": compensation, "arguments": gains}
    row |= {"error": best.error, "roughness": best.roughness}
    return row | {"default_error": default.error, "default_roughness": default.roughness}


def gains_table(rows: Sequence[Row]) -> Table:
    """The gains, and errors and roughness with them and with the defaults."""
    return Table(
        "Tuned gains, means over the training runs",
        ("controller", "compensation", "error [mm]", "by default", "rough [rad/s²]", "by default", "gains"),
        [
            [
                relative(row["controller"]),
                row["compensation"],
                *(f"{1e3 * row[name]:.1f}" for name in ("error", "default_error")),
                *(f"{row[name]:.2f}" for name in ("roughness", "default_roughness")),
                ", ".join(f"{name} {value:g}" for name, value in row["arguments"].items()),
            ]
            for row in rows
        ],
        align="llrrrrl",
    )
