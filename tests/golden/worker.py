"""What is measured of A-graphs and matches: run as a script with the measured code in PYTHONPATH, of any commit.

    python worker.py graphs SET DATA OUT.json.gz
    python worker.py maps DATA OUT.json.gz
    python worker.py matches METHOD MAPS.json.gz OUT.json.gz [REFERENCE.json.gz]

It calls public names of the measured code only, within the functions, and nothing else of these tests.
"""

import gzip
import json
import logging
import signal
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

Plans = dict[str, dict[str, Any]]  # by name: {"graph", "notices"}, or {"error"}
GENERATED = 5  # buildings of each kind, of which there are eight
FIRST_SEED = 4_000  # of generated buildings, apart from those of the training data and the studies
SETS = ("ifc", "swiss_floors", "msd", "resplan", "lifull", "meshes", "scans", "slam_graphs", "generated")
MAPS = 400
ROOMS = (1, 2, 3, 4, 6, 9, 14, None)  # rooms that a map shows, None: a whole floor
NEGATIVE = "negative"  # maps of another building
SLOW = ("combinatorial",)  # ends after a limit of wall-clock time: compared where far from it
SLOW_MAPS = 150  # those with the fewest possible pairs of rooms and of walls
SLOW_S = 3.0  # s in which the reference must have an answer, a twentieth of that limit


def graphs(name: str, data: Path) -> Plans:
    """The A-graphs of one of `SETS`; empty where the folder of public plans lacks it."""
    if name == "generated":
        return generated(GENERATED)
    folders = {"ifc": "ifc/*.ifc", "meshes": "meshes/*.[ds][at][el]", "scans": "scans/*/*.geojson",
               "slam_graphs": "slam_graphs/*.json"}  # fmt: skip
    if name in folders:
        return {file.name: _read(file) for file in sorted(data.glob(folders[name]))}
    path = data / "floorplans" / ("lifull.tar.gz" if name == "lifull" else name)
    return _plan_set(path) if path.exists() else {}


def generated(count: int) -> Plans:
    """`count` generated buildings of each kind."""
    from data.generation.buildings import KINDS, generate_plan

    plans = (generate_plan(kind, FIRST_SEED + n) for kind in KINDS for n in range(count))
    return {plan.name: {"graph": plan.graph.to_dict(), "notices": []} for plan in plans}


def _read(file: Path) -> dict[str, Any]:
    from data import SceneGraph, UserError
    from data.plans import load_bim
    from data.plans.mesh_plan import read_mesh

    try:
        if file.suffix in (".dae", ".stl"):
            return {"graph": read_mesh(file).graph.to_dict(), "notices": []}
        if file.parent.name == "slam_graphs":
            return {"graph": SceneGraph.load(file, "a_graph").to_dict(), "notices": []}
        bim = load_bim(file)
        return {"graph": bim.graph.to_dict(), "notices": _without(file.parent, bim.notices)}
    except UserError as error:
        return {"error": _without(file.parent, [str(error)])[0]}


def _plan_set(path: Path) -> Plans:
    from data.plans import read_plans

    skipped: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: skipped.append(record.getMessage())  # type: ignore[method-assign]
    logging.getLogger("data.plans").addHandler(handler)
    found: Plans = {p.name: {"graph": p.graph.to_dict(), "notices": []} for p in read_plans(path)}
    return found | {f"skipped {n}": {"error": text} for n, text in enumerate(_without(path.parent, skipped))}


def _without(folder: Path, lines: Sequence[str]) -> list[str]:
    return [line.replace(f"{folder}/", "") for line in lines]


def maps(data: Path, count: int = MAPS) -> dict[str, Any]:
    """`count` S-graphs drawn from plans: {"plans": {name: A-graph}, "maps": [{"name", "plan", "s_graph"}]}.

    Every second plan is a generated one, where there are public plans, else all of them are.
    """
    from data import SceneGraph
    from data.synthetic_maps.noise_models import NOISE_MODELS

    public = [(f"{s}/{n}", p) for s in ("swiss_floors", "ifc", "msd", "resplan") for n, p in graphs(s, data).items()]
    made = generated(max(1, count // 30))
    sources = [[(f"generated/{n}", p) for n, p in made.items()], public]
    usable = [
        [(n, SceneGraph.from_dict(p["graph"])) for n, p in of if p.get("graph", {}).get("rooms")] for of in sources
    ]
    result: dict[str, Any] = {"plans": {}, "maps": []}
    for k in range(count):
        regime = (*NOISE_MODELS, NEGATIVE)[k % (len(NOISE_MODELS) + 1)]
        name, plan, s = _drawn(usable[k % 2] or usable[0], k, regime)
        result["plans"][name] = plan.to_dict()
        result["maps"].append({"name": f"{k:03d} {regime} {name}", "plan": name, "s_graph": s.to_dict()})
    return result


def _drawn(plans: list[tuple[str, Any]], number: int, regime: str) -> tuple[str, Any, Any]:
    """The name of a plan, the plan, and a map of it; of another plan if it is `NEGATIVE`."""
    import numpy as np

    from data.synthetic_maps.noise_models import draw

    rng = np.random.default_rng([FIRST_SEED, number])
    first, second = rng.permutation(len(plans))[:2]
    shown = plans[second if regime == NEGATIVE else first][1]
    drawn = draw(shown, "real" if regime == NEGATIVE else regime, rng, ROOMS[int(rng.integers(len(ROOMS)))])
    return *plans[first], drawn.s_graph


def matches(method: str, of: dict[str, Any], known: dict[str, Any] | None = None) -> dict[str, Any]:
    """The answers of a method to maps, by their names, without times. Those of a slow method are of the maps that
    `known` answers are of; without any, of small maps that are answered soon."""
    from data import SceneGraph
    from matching import Matcher

    matcher, plans = Matcher.load(method), {name: SceneGraph.from_dict(p) for name, p in of["plans"].items()}
    chosen = of["maps"]
    if known is not None:
        chosen = [m for m in chosen if m["name"] in known]
    elif method in SLOW:
        chosen = sorted(chosen, key=lambda m: _size(m["s_graph"]) * _size(of["plans"][m["plan"]]))[:SLOW_MAPS]
    answers = {}
    for one in chosen:
        with_limit = method in SLOW and known is None
        s = SceneGraph.from_dict(one["s_graph"])
        for answer in _within(SLOW_S if with_limit else 0.0, lambda s=s, one=one: matcher.match(s, plans[one["plan"]])):
            answers[one["name"]] = {key: value for key, value in answer.to_dict().items() if key != "seconds"}
    return answers


def _size(graph: dict[str, Any]) -> int:
    return len(graph["rooms"]) * len(graph["wall_surfaces"])


def _within(seconds: float, work: Any) -> Iterator[Any]:
    """What `work` returns, unless it takes longer than so many seconds; 0 for no limit."""

    def late(number: int, frame: Any) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield work()
    except TimeoutError:
        return
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def load(path: Path) -> Any:
    """The content of a compressed JSON file."""
    return json.loads(gzip.decompress(path.read_bytes()))


def save(path: Path, value: Any) -> None:
    """Writes a compressed JSON file."""
    path.write_bytes(gzip.compress(json.dumps(value).encode(), mtime=0))


def main(kind: str, *words: str) -> None:
    """See above."""
    if kind == "graphs":
        save(Path(words[2]), graphs(words[0], Path(words[1])))
    elif kind == "maps":
        save(Path(words[1]), maps(Path(words[0])))
    else:
        known = load(Path(words[3])) if len(words) > 3 else None
        save(Path(words[2]), matches(words[0], load(Path(words[1])), known))


if __name__ == "__main__":
    main(*sys.argv[1:])
