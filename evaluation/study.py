"""A study: a list of cases, a measurement of each, and the tables of the rows."""

import importlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from data.common.build import PRODUCT
from data.common.errors import UserError

Record = dict[str, Any]
"""What was measured, as JSON values."""


class Options(BaseModel):
    """What can be chosen of a study (`--set`); the defaults are the full study."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Case(BaseModel):
    """One measurement, complete in itself: the same case gives the same record, wherever it is computed."""

    model_config = ConfigDict(frozen=True)

    @property
    def key(self) -> str:
        """The identity of the case: its fields as JSON."""
        return key_of(self.model_dump(mode="json"))

    @property
    def group(self) -> str:
        """Cases of one group are measured one after another in one process, and share what is expensive."""
        return self.key

    @property
    def depends(self) -> tuple[str, ...]:
        """The packages whose change makes it necessary to measure again."""
        return PRODUCT

    def files(self) -> set[str]:
        """The paths of the files that it reads."""
        return set()


def key_of(case: Mapping[str, Any]) -> str:
    """The identity of a case that is given as JSON values."""
    return json.dumps(case, separators=(",", ":"), ensure_ascii=False)


@dataclass(frozen=True)
class Claim:
    """A line of the index of results: what is claimed, the value with its bounds, and the units that it is over."""

    text: str
    value: str
    units: str


@dataclass(frozen=True)
class Study:
    """A study answers one question.

    `cases` lists the cases of given options, `measure` computes the record of one; intermediate files go in the folder
    that it gets, and `release` removes those of a group when its last case is done. `tables` makes, of the rows (a
    DataFrame with the fields of case and record as columns), the tables and short texts that pages show, by name;
    `claims` its lines in the index. Where seconds are what is measured, the study
    is `timed`: nothing runs beside it. A study whose data are `brought` by its user is not one of `all`.
    """

    name: str
    asks: str
    options: type[Options]
    quick: Options
    case: type[Case]
    cases: Callable[[Any], Sequence[Case]]
    measure: Callable[[Any, Path], Record]
    tables: Callable[[Any], Mapping[str, Any]]
    claims: Callable[[Any], Sequence[Claim]] = lambda rows: ()
    release: Callable[[Any, Path], None] = lambda case, work: None
    timed: bool = False
    brought: bool = False


STUDIES = (
    "accuracy",
    "carriers",
    "trust",
    "elements",
    "storeys",
    "heights",
    "relocalisation",
    "other_slam",
    "timing",
    "matching",
    "real",
)
ALIASES = {"ablation": "accuracy"}


def load_study(name: str) -> Study:
    """The study of this name: one of `STUDIES`, or `STUDY` of a module of one's own that has this name.

    Raises UserError if there is none.
    """
    name = ALIASES.get(name, name)
    module = f"evaluation.studies.{name}" if name in STUDIES else name
    try:
        study = importlib.import_module(module).STUDY
    except (ImportError, AttributeError, ValueError) as error:
        if name in STUDIES:
            raise
        raise UserError(f"no study '{name}' ({error}); there are {', '.join(STUDIES)}") from None
    if not isinstance(study, Study) or study.name != name:
        raise UserError(f"{module}: STUDY must be a Study of the name '{name}'")
    return study
