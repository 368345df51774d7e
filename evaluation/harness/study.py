"""A study: a function from a case to a record, and its list of cases."""

import importlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict

from data.common.errors import UserError

Cost = Annotated[float | None, "cost"]
"""Seconds or megabytes: differs from run to run, and is not compared between runs."""


def key_of(case: dict[str, Any]) -> str:
    """The identity of a case that is given as JSON values."""
    return json.dumps(case, separators=(",", ":"), ensure_ascii=False)


class Options(BaseModel):
    """What can be chosen of a study (`--set`); the defaults are the full study."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Case(BaseModel):
    """One measurement, complete in itself: the same case gives the same record, wherever it is computed."""

    model_config = ConfigDict(frozen=True)

    @property
    def key(self) -> str:
        """The identity of the case, as JSON."""
        return key_of(self.model_dump(mode="json"))

    def files(self) -> set[str]:
        """The paths of the files that it reads."""
        return set()


class Record(BaseModel):
    """The results of a case; fields of the type `Cost` differ from run to run."""

    model_config = ConfigDict(frozen=True)

    @classmethod
    def costs(cls) -> set[str]:
        """The names of the fields that differ from run to run."""
        return {name for name, field in cls.model_fields.items() if "cost" in field.metadata}


@dataclass(frozen=True)
class Claim:
    """A claim of the page of results: what is claimed, the value with its interval, and the number of cases."""

    text: str
    value: str
    cases: str


@dataclass(frozen=True)
class Study:
    """A study.

    `cases` lists the cases of given options, `measure` computes one; drives and other intermediate files go in the
    folder that it gets. `tables` makes, of the rows of the study (a DataFrame with the fields of case and record as
    columns), the tables (DataFrames of text) and short texts that pages show, by name; `claims` its lines in the
    page's list of claims; `plots` writes SVG files to a folder.

    A case has a process of its own, unless it is `small`: then many share a process of one thread. Where seconds are
    what is measured, the study is `timed`: nothing runs beside it. Cases that differ in the field `apart` may be
    measured on builds of their own, such as peers that our build does not change. A study whose data are `brought` by
    its user is not one of `all`.
    """

    name: str
    asks: str
    options: type[Options]
    quick: Options
    case: type[Case]
    record: type[Record]
    cases: Callable[[Any], Sequence[Case]]
    measure: Callable[[Any, Path], Record]
    tables: Callable[[Any], Mapping[str, Any]]
    claims: Callable[[Any], Sequence[Claim]] = lambda rows: ()
    plots: Callable[[Any, Path], None] = lambda rows, folder: None
    small: bool = False
    timed: bool = False
    apart: str | None = None
    brought: bool = False


STUDIES = {  # by name, the module whose `STUDY` it is; the most asked for first
    "ablation": "evaluation.slam_ablation.study",
    "anchored_carriers": "evaluation.studies.carried.anchored_carriers",
    "trust": "evaluation.studies.carried.trust",
    "degradation": "evaluation.studies.carried.degradation",
    "elements": "evaluation.studies.carried.elements",
    "as_built": "evaluation.studies.as_built",
    "other_slam": "evaluation.studies.carried.other_slam",
    "inertial": "evaluation.studies.carried.inertial",
    "live": "evaluation.studies.live",
    "storeys": "evaluation.studies.storeys",
    "relocalisation": "evaluation.studies.relocalisation",
    "carriers": "evaluation.studies.carried.carriers",
    "matching": "evaluation.matching_benchmark.study",
    "published": "evaluation.published.study",
    "known_map": "evaluation.published.known_map",
    "one_wall_out": "evaluation.published.one_wall_out",
    "combinatorial": "evaluation.published.combinatorial",
    "rooms_to_localise": "evaluation.studies.rooms_to_localise",
    "wrong_matches": "evaluation.studies.wrong_matches",
    "loops": "evaluation.studies.loops",
    "odometries": "evaluation.studies.odometries",
    "timing": "evaluation.studies.timing",
    "matching_time": "evaluation.matching_benchmark.timing",
    "long_run": "evaluation.studies.long_run",
    "resume": "evaluation.studies.resume",
    "real": "evaluation.studies.real.study",
}


def load_study(name: str) -> Study:
    """The study of this name: one of `STUDIES`, or `STUDY` of a module of one's own that has this name.

    Raises UserError if there is none.
    """
    module = STUDIES.get(name, name)
    try:
        study = importlib.import_module(module).STUDY
    except (ImportError, AttributeError, ValueError) as error:
        if module != name:
            raise
        raise UserError(f"no study '{name}' ({error}); there are {', '.join(STUDIES)}") from None
    if not isinstance(study, Study) or study.name != name:
        raise UserError(f"{module}: STUDY must be a Study of the name '{name}'")
    return study
