"""Sets of plans, read from files or generated, and which of them settings were chosen by."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

from data.common.errors import UserError
from data.generation.buildings import KINDS, generate_plan
from data.plans import Plan, read_plans

FIRST_SEED = 900_000  # of generated plans; beyond the seeds of the training data
# Settings were chosen by these sets of plans, and by the generated plans with seeds below this one.
VALIDATION, FIRST_TEST_SEED = ("swiss_floors", "AC11-Institute-Var-2-IFC", "Office_A_20110811"), FIRST_SEED + 2000
LARGE = 34  # rooms from which a plan is large


@dataclass(frozen=True)
class Candidate:
    """A plan and its set: a file or folder of plans, or the kind of generated ones."""

    plans: str
    plan: Plan


def size_class(rooms: int) -> str:
    """The size class of a plan: "small" below 34 rooms, else "large"."""
    return "large" if rooms >= LARGE else "small"


@cache
def name_of_set(plans: str) -> str:
    """The name of a set of plans for tables."""
    return Path(plans).resolve().name.split(".")[0]


def split_of(plans: str, plan: str) -> str:
    """Whether settings were chosen by a plan: "validation" if so, else "test"."""
    if plans in KINDS:
        return "validation" if _seed_of(plan) < FIRST_TEST_SEED else "test"
    return "validation" if name_of_set(plans) in VALIDATION else "test"


def load_plan(plans: str, name: str) -> Plan:
    """A plan of a set. Raises UserError as `read_plans` does, and for an unknown name."""
    if plans in KINDS:
        return _generated(plans, _seed_of(name))
    plan = _plans(plans).get(name)
    if plan is None:
        raise UserError(f"{plans}: no plan '{name}' with rooms")
    return plan


def read_candidates(paths: Sequence[Path], generated: Sequence[str]) -> list[Candidate]:
    """The plans of files and folders, and generated ones: KIND:COUNT, or KIND:COUNT:SKIPPED for the COUNT plans after
    the first SKIPPED. Plans without rooms are left out.

    Raises UserError for an unknown kind, for two plans of one name in a set, and as `read_plans` does.
    """
    found = [Candidate(str(path), plan) for path in paths for plan in _plans(str(path)).values()]
    seeds = dict.fromkeys(own for text in generated for own in _seeds(text))
    return found + [Candidate(kind, _generated(kind, seed)) for kind, seed in seeds]


def _seed_of(name: str) -> int:
    return int(name.rpartition("_")[2])


def _seeds(text: str) -> list[tuple[str, int]]:
    kind, *numbers = text.split(":")
    if kind not in KINDS or len(numbers) not in (1, 2) or not all(map(str.isdecimal, numbers)) or numbers[0] == "0":
        raise UserError(f"generated {text}: write KIND:COUNT or KIND:COUNT:SKIPPED; kinds are {', '.join(KINDS)}")
    count, skipped = [*map(int, numbers), 0][:2]
    return [(kind, FIRST_SEED + skipped + n) for n in range(count)]


@lru_cache(maxsize=1000)
def _generated(kind: str, seed: int) -> Plan:
    return generate_plan(kind, seed)


@cache
def _plans(path: str) -> dict[str, Plan]:
    found: dict[str, Plan] = {}
    for plan in read_plans(path):
        if plan.name in found:
            raise UserError(f"{path}: two plans are named '{plan.name}'; rename one")
        if plan.graph.rooms:
            found[plan.name] = plan
    return found
