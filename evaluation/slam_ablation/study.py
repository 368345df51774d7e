"""Ablation of the SLAM system: each drive is run with parts of the system left out, and by others' odometries alone."""

from pathlib import Path

from evaluation.drives import Conditions, prepare
from evaluation.drives.sequences import DriveCase, DriveOptions
from evaluation.harness import Study
from evaluation.slam_ablation.plots import plots
from evaluation.slam_ablation.scores import Scores
from evaluation.slam_ablation.tables import claims, tables
from evaluation.slam_ablation.variants import VARIANTS, check_variant, run_variant


class Choice(DriveOptions, Conditions):
    """The drives, their conditions, and the variants, all but those that need an extra; sequences that are also run
    with a weakened front end, and the variants of these runs."""

    variants: tuple[str, ...] = tuple(name for name in VARIANTS if name != "multi-scale-icp-to-bim")
    weakened: tuple[str, ...] = ("institute", "office")
    weakened_variants: tuple[str, ...] = ("graph", "anchored:voting", "anchored")


class Run(DriveCase):
    """A variant on a drive."""

    conditions: Conditions
    variant: str

    def files(self) -> set[str]:
        """The sequence's files and the matcher's weights."""
        return super().files() | {self.variant.partition("@")[2]} - {""}


def cases(options: Choice) -> list[Run]:
    """Each drive with all variants. Raises UserError for an unknown variant, and as `DriveOptions` does."""
    conditions = Conditions.model_validate(options.model_dump(include=set(Conditions.model_fields)))
    weak, drives = conditions.model_copy(update={"weaken": True}), list(options.drives())
    planned = [(spec, seed, conditions, variant) for spec, seed in drives for variant in options.variants]
    planned += [
        (spec, seed, weak, variant)
        for spec, seed in drives if spec.name in options.weakened for variant in options.weakened_variants
    ]  # fmt: skip
    return [
        Run(sequence=spec, seed=seed, conditions=own, variant=check_variant(variant))
        for spec, seed, own, variant in dict.fromkeys(planned)
    ]


def measure(case: Run, work: Path) -> Scores:
    """Runs the variant; the drive is simulated if it is missing."""
    return run_variant(case.variant, prepare(case.sequence, case.seed, work, case.conditions))


QUICK = Choice(
    sequences=("demo", "institute"), seeds=(0,), variants=("kiss-icp", "small_gicp", "graph", "anchored"), weakened=(),
)  # fmt: skip
STUDY = Study(
    "ablation", "how far off the truth the system is, with parts of it left out, and its peers",
    Choice, QUICK, Run, Scores, cases, measure, tables, claims, plots,
)  # fmt: skip
