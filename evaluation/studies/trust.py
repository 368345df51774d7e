"""Whether a run is ever anchored at a wrong place, whatever goes wrong with the sensor, the recording or the plan."""

from collections.abc import Mapping
from itertools import product

import pandas as pd
from pydantic import Field

from evaluation.buildings import building_named, generated
from evaluation.conditions import NO_PLACE, PLACES, SENSOR, split
from evaluation.conditions import RECORDING as OF_RECORDING
from evaluation.drive import RECORDING, DriveCase, DriveOptions
from evaluation.run import study_of_runs
from evaluation.study import Claim
from evaluation.tables import ANCHORED, INSIDE, WRONG, Query, count, made, rare, truth, units

NONE = ""
KINDS = ("office", "corridor", "l_shape", "apartment", "skewed", "mirrored_twins", "tower")
HOUSES = ("fzk-haus", "niedriha", "jesse", "sample-house")
SEVERE = {name: amounts for name, amounts in {**SENSOR, **OF_RECORDING}.items() if amounts}
PLAIN = (NONE, *PLACES, *(name for name in (*SENSOR, *OF_RECORDING) if name not in SEVERE))


class Choice(DriveOptions):
    """Each of `troubles`, and of the others each of `severities`, of each of `carriers` with each of `sensors` and
    `effects`, in `per_cell` drives drawn in turn (all of them for None); and each of `changes` of buildings that are
    not meshes."""

    buildings: tuple[str, ...] = ("institute", "office", *HOUSES, *generated(20, 21))
    troubles: tuple[str, ...] = PLAIN
    changes: tuple[str, ...] = ("absent", "10 to 30 cm")
    severities: tuple[int, ...] = (1, 2, 3, 4)
    carriers: tuple[str, ...] = ("wheeled", "handheld", RECORDING)
    sensors: tuple[str, ...] = ("VLP-16", "Mid-360")
    effects: tuple[tuple[str, ...], ...] = ((), ("all",))
    per_cell: int | None = Field(None, ge=1)


def cases(options: Choice) -> list[DriveCase]:
    """The drives with all troubles that they can have: a storey can only be stated wrongly where there are several."""
    troubles = [*options.troubles, *(f"{name} {n}" for name in SEVERE for n in options.severities)]
    cells = [
        {"carrier": carrier, "sensor": sensor, "effects": effects}
        for carrier, sensor, effects in product(options.carriers, options.sensors, options.effects)
    ]
    found = []
    for design in options.in_turn(cells, options.per_cell):
        is_ifc = building_named(design["building"]).bim.endswith(".ifc")
        own = [trouble for trouble in troubles if trouble != "wrong storey" or is_ifc]
        found += [DriveCase(**design, trouble=trouble) for trouble in own]
        found += [DriveCase(**design, changes=changes) for changes in options.changes if is_ifc]
    return found


COLUMNS = {**ANCHORED, "lost": count(lambda rows: rows.lost > 0), **WRONG}
QUERIES = {
    "troubles": Query({"worse": "trouble"}, COLUMNS),
    "severities": Query({"severity": "severity"}, COLUMNS, lambda rows: rows.severity > 0),
    "carriers": Query({"carrier": "carrier", "effects": "effects"}, COLUMNS, lambda rows: rows.worse == "none"),
    "inside": Query({"worse": "trouble"}, INSIDE, lambda rows: rows["inside.poses"].notna()),
    "wrong_runs": Query(
        {"worse": "trouble", "building": "building", "carrier": "carrier", "sensor": "sensor"},
        {
            "scans wrong": lambda rows: f"{rows.wrong.sum():.0f}",
            "alarms": lambda rows: "; ".join(sorted({alarm for of_run in rows.alarms for alarm in of_run})) or "none",
        },
        lambda rows: rows.wrong > 0,
    ),
}


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """By trouble, by severity, by carrier and effects without trouble; how true the standard deviations are; and each
    run with a wrong scan."""
    return made(QUERIES, _split(rows))


def _split(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with the trouble's name and severity apart, in the order of the lists."""
    names = rows.trouble.where(rows.changes.eq(""), "as built").map(
        lambda trouble: (trouble, 0) if trouble == "as built" else split(trouble) if trouble else ("none", 0)
    )
    rows = rows.assign(worse=names.str[0], severity=names.str[1]).reindex(columns=[*rows, "worse", "severity"])
    order = {name: k for k, name in enumerate(("none", *PLAIN[1:], "as built", *SEVERE))}
    if "inside.poses" not in rows:
        rows["inside.poses"] = None
    return rows.assign(order=rows.worse.map(order)).sort_values(["order", "severity"], kind="stable")


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How often a run was anchored wrongly, and silently so."""
    rows = _split(rows)
    anchored, over = rows[truth(rows, "anchored")], units(rows)
    nowhere = rows[rows.worse.isin(NO_PLACE)]
    wrong = rare(anchored.wrong > 0, anchored.building)
    return [
        Claim("Whatever goes wrong: anchored runs with a scan that is wrong by over 0.5 m or 5 degrees", wrong, over),
        Claim("Runs with such a scan and no alarm", rare(truth(rows, "silent"), rows.building), over),
        Claim(
            "Runs that are anchored where no place is right", rare(truth(nowhere, "anchored"), nowhere.building), over
        ),
    ]


QUICK = Choice(
    buildings=("institute", "office", *HOUSES, *generated(70, 71, kinds=KINDS)),
    severities=(3,),
    carriers=("wheeled", "handheld", "pole", RECORDING),
    effects=((),),
    seconds=40.0,
    per_cell=4,
)
STUDY = study_of_runs(
    "trust", "whether a run is ever anchored at a wrong place, whatever goes wrong", QUICK, cases, tables, claims
)
