"""One run of the ablation in a process of its own, on this machine or on a worker of a Dask cluster."""

import threading
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from data.common.children import may_have_children, run_isolated
from data.common.cluster_worker import scratch
from evaluation.harness import Conditions, SequenceSpec, prepare
from evaluation.slam_ablation.rows import KEY, Records, as_record, errors_file
from evaluation.slam_ablation.variants import config_of, run_variants


@dataclass(frozen=True)
class Task:
    """One run; it gives a row for each of its `variants`."""

    spec: SequenceSpec
    seed: int
    variants: tuple[str, ...]
    conditions: Conditions

    def key(self, variant: str) -> tuple[str, ...]:
        """The key of a variant's record."""
        return (self.spec.name, self.conditions.name, str(self.seed), variant)

    def describe(self) -> str:
        """A description for messages."""
        return f"{self.spec.name}, {self.conditions.name}, seed {self.seed}, {' and '.join(self.variants)}"


@dataclass(frozen=True)
class Answer:
    """The results of a run: its rows, and the texts of files by their paths in the folder of the results."""

    records: Records
    files: dict[str, str]


def run_in_process(task: Task, drives: Path) -> Answer:
    """Runs a task in a child process, with the drive in the folder `drives`, simulated there if missing. Raises
    ProcessEndedError and what the run raises."""
    return run_isolated(_run, task, drives, what=task.describe())


_preparing, _ready = threading.Lock(), set[tuple[object, ...]]()  # state of a cluster's worker


def run_on_worker(task: Task) -> Answer:
    """Runs a task on a worker of a cluster, which simulates each drive once, in a folder of its own."""
    may_have_children()
    drives, drive = scratch(), (task.spec, task.seed, task.conditions)
    with _preparing:
        if drive not in _ready:
            run_isolated(_prepare, task, drives, what=task.describe())
            _ready.add(drive)
    return run_in_process(task, drives)


def _prepare(task: Task, drives: Path) -> None:
    prepare(task.spec, task.seed, drives, task.conditions)


def _run(task: Task, drives: Path) -> Answer:
    """One run; the errors over time and the configuration become files of their own."""
    import yaml

    from sgslam.config.loading import save_config

    sequence = prepare(task.spec, task.seed, drives, task.conditions)
    config = save_config(config_of(task.variants[0], sequence))
    config += yaml.safe_dump({"ablation": dict(zip(KEY, task.key(" ".join(task.variants)), strict=True))})
    name = f"configs/{sha256(config.encode()).hexdigest()[:12]}.yaml"
    files, records = {name: config}, []
    for run in run_variants(task.variants, sequence):
        record = as_record(run.row) | {"config": name}
        if run.errors is not None:
            lines = [f"{t:.3f},{e:.5f}" for t, e in run.errors.tolist()]
            files[errors_file(Path(), record).as_posix()] = "\n".join(["seconds,error_m", *lines]) + "\n"
        records.append(record)
    return Answer(records, files)
