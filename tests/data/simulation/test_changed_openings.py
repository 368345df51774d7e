"""Doors, windows and columns that are elsewhere than planned, or absent, in the simulated building."""

from collections.abc import Iterable

import numpy as np
import pytest
from numpy.typing import NDArray
from small_ifc import DOORS, WINDOW, SmallBuilding

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.ifc.products import open_ifc
from data.simulation import Changes
from data.simulation.changes import AS_PLANNED
from data.simulation.storey_model import StoreyModel, load_storeys

Array = NDArray[np.float64]
BY = 0.15


def met(model: StoreyModel, T: Array, origin: Iterable[float], direction: Iterable[float]) -> float:
    """Metres to the first surface of a ray given in the building's frame."""
    rays = (T[:3, :3] @ [*direction])[None]
    return float(TriangleScene(model.solid).distances(T[:3, :3] @ [*origin] + T[:3, 3], rays)[0])


def test_displaced_openings_have_their_edges_where_told(building: SmallBuilding) -> None:
    before = building.path.read_bytes()
    changes = Changes(openings_displaced=1.0, displaced_by=BY)
    planned, built = (load_storeys(building.path, ["Ground"], c, seed=2)[0] for c in (AS_PLANNED, changes))
    model = open_ifc(building.path)
    assert [c.kind for c in built.changes] == ["displaced"] * 3 and building.path.read_bytes() == before
    assert len(built.doors) == 2 and built.glazed.sum() == planned.glazed.sum() > 0
    T = building.T_bim_building
    steps: dict[str, list[float]] = {}
    for change in built.changes:
        step = T[:2, :2].T @ change.offset_in_bim
        np.testing.assert_allclose(np.abs(step), [BY, 0.0], atol=1e-9)
        steps.setdefault(model.by_guid(change.id).is_a(), []).append(step[0])
    leaves = sorted(zip(planned.doors, built.doors, strict=True), key=lambda pair: building.from_bim(pair[0][0])[0, 0])
    for (was, now), door in zip(leaves, DOORS, strict=True):
        step = (now - was).reshape(-1, 3) @ T[:3, :3]
        np.testing.assert_allclose(step, np.broadcast_to(step[0], step.shape), atol=1e-9)
        assert np.isclose(step[0, 0], steps["IfcDoor"]).any()
        middle = [(door[0] + door[3]) / 2, 3.1, 1.0]
        for sense in (1.0, -1.0):
            assert abs(met(built, T, middle, [sense, 0, 0]) - (0.5 + sense * step[0, 0])) < 1e-3
    pane = planned.solid[planned.glazed], built.solid[built.glazed]
    np.testing.assert_allclose((pane[1] - pane[0]) @ T[:3, 0], steps["IfcWindow"][0], atol=1e-9)
    sill = [(WINDOW[0] + WINDOW[3]) / 2, 7.02, 1.5]  # on the inner side of the pane
    for sense in (1.0, -1.0):
        assert abs(met(built, T, sill, [sense, 0, 0]) - (0.75 + sense * steps["IfcWindow"][0])) < 1e-3


def test_a_filled_door_is_wall_and_a_filled_window_too(building: SmallBuilding) -> None:
    filled = Changes(openings_filled=1.0)
    planned, built = (load_storeys(building.path, ["Ground"], c)[0] for c in (AS_PLANNED, filled))
    T, door = building.T_bim_building, (DOORS[0][0] + DOORS[0][3]) / 2
    assert len(planned.doors) == 2 and not built.doors and planned.glazed.any() and not built.glazed.any()
    assert [c.kind for c in built.changes] == ["filled"] * 3
    assert met(built, T, [door, 2.5, 1.0], [0, 1, 0]) == pytest.approx(0.5, abs=1e-3)
    assert met(planned, T, [door, 2.5, 1.0], [0, 1, 0]) > 0.7


def test_impossible_numbers_are_refused() -> None:
    for numbers, message in (
        ({"openings_displaced": 0.7, "openings_filled": 0.7}, r"displaced \(0.7\) and filled \(0.7\) openings"),
        ({"columns_absent": float("nan")}, "columns: give 0 to 1 in all"),
        ({"displaced_by": 0.5}, "displaced by 0.5 m: give more than 0, and at most 0.3"),
    ):
        with pytest.raises(UserError, match=message):
            Changes(**numbers)
