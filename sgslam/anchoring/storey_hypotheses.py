"""Storey hypotheses: which storeys the floors of a map can be, by the heights between them."""

from data import Floor, SceneGraph, UserError
from sgslam.config.sensor import BUILDING

Assignment = dict[int, str]  # floor of the map -> storey of the plan


def floor_named(a_graph: SceneGraph, name: str) -> Floor:
    """The storey of that name or id, ignoring case; raises UserError where there is none."""
    for floor in a_graph.floors:
        if name.casefold() in (floor.name.casefold(), floor.id.casefold()):
            return floor
    names = ", ".join(floor.name or floor.id for floor in a_graph.floors) or "none"
    raise UserError(f"storey {name}: no such storey; there are: {names}")


def check_storey(a_graph: SceneGraph, name: str | None) -> None:
    """Raises UserError for an unknown `--storey`; None is accepted."""
    if name is not None:
        try:
            floor_named(a_graph, name)
        except UserError as error:
            raise UserError(f"--{error}") from None


def assignments(heights: dict[int, float], planned: tuple[Floor, ...], start: str | None) -> list[Assignment] | None:
    """The possible storeys of the map's floors, given their heights (m); `start` is the storey of floor 0 if known.

    Where the plan has no elevations: None, or only `start`.
    """
    known = {f.id: f.elevation for f in planned if f.elevation is not None}
    if len(known) < len(planned) or not known:
        return None if start is None else [{0: start}]
    found = []
    for base, elevation in known.items():
        if start is not None and base != start:
            continue
        assigned: Assignment = {}
        for number, height in heights.items():
            z = elevation + height - heights[0]
            nearest = min(known, key=lambda f: abs(known[f] - z))
            if abs(known[nearest] - z) < BUILDING.raised:
                assigned[number] = nearest
        if len(assigned) == len(heights):
            found.append(assigned)
    return found
