"""What real sensors meet, in the simulation: glass, people, doors, furniture, tolerance, returns, steps."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from small_ifc import PANE, ROOMS, SmallBuilding

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.scans import ScanFolder
from data.simulation import Sensor, SimulatedRun
from data.simulation.carriers import HANDHELD, WHEELED
from data.simulation.effects import EFFECTS, World, checked
from data.simulation.furniture import FROM_WALLS, RISE
from data.simulation.simulate import simulate
from data.simulation.storey_model import load_storeys

SENSOR = Sensor(azimuths=180, rate=5.0)
Array = NDArray[np.float64]


def driven(building: SmallBuilding, out: Path, *effects: str, seconds: float = 20.0, **options: Any) -> SimulatedRun:
    return simulate(building.path, "Ground", out, 1, 3, 20.0, SENSOR, effects=effects, seconds=seconds, **options)


def points(run: SimulatedRun, building: SmallBuilding) -> list[Array]:
    """Each scan's in the building's frame."""
    scans = zip(ScanFolder(run.out_dir / "scans"), run.truth.poses, strict=True)
    return [building.from_bim(scan.points @ T[:3, :3].T + T[:3, 3]) for scan, T in scans]


def test_seven_of_ten_rays_pass_a_pane(building: SmallBuilding) -> None:
    (model,) = load_storeys(building.path, ["Ground"])
    glazed = model.solid[model.glazed].reshape(-1, 3)
    np.testing.assert_allclose(building.from_bim(glazed).min(axis=0), PANE[:3], atol=1e-6)
    np.testing.assert_allclose(building.from_bim(glazed).max(axis=0), PANE[3:], atol=1e-6)
    world = World(TriangleScene(model.solid[~model.glazed]), TriangleScene(model.solid[model.glazed]))
    rng = np.random.default_rng(0)
    inside = np.column_stack([rng.uniform(1.2, 2.3, 4000), np.full(4000, 6.0), rng.uniform(1.0, 2.0, 4000)])
    ranges = world.at(0.0, rng).distances(building.to_bim(inside), np.tile(building.T_bim_building[:3, 1], (4000, 1)))
    assert np.mean(np.isinf(ranges)) == pytest.approx(0.7, abs=0.03)
    np.testing.assert_allclose(ranges[np.isfinite(ranges)], 1.08, atol=1e-4)


def test_one_person_follows_and_others_are_met(building: SmallBuilding, tmp_path: Path) -> None:
    plain, peopled = (driven(building, tmp_path / f"{len(own)}", *own) for own in ((), ("people",)))
    np.testing.assert_array_equal(plain.truth.poses, peopled.truth.poses)
    near, gaps = [], []
    for bare, seen, T in zip(points(plain, building), points(peopled, building), plain.truth.poses, strict=True):
        place = building.from_bim(T[None, :3, 3])[0]
        upright = seen[(seen[:, 2] > 0.3) & (seen[:, 2] < 1.6)]
        far = np.linalg.norm(upright[:, :2] - place[:2], axis=1)
        was = np.linalg.norm(bare[:, :2] - place[:2], axis=1)
        near.append(np.sum(far < 1.4) - np.sum(was < 1.4))
        gaps.append(far.min())
    assert np.mean(np.array(near) > 20) > 0.5  # the follower is seen in most scans
    assert np.min(gaps) > 0.2


def test_the_sensor_rises_over_a_step(building: SmallBuilding, tmp_path: Path) -> None:
    run = driven(building, tmp_path / "run", "steps", seconds=40.0, carrier=replace(WHEELED, height=0.9))
    places = building.from_bim(run.truth.positions)
    assert places[:, 2].min() < 0.95 + 0.05 and places[:, 2].max() > 0.9 + RISE - 0.06
    high = places[places[:, 2] > 0.9 + RISE - 0.06]
    inner = [(x0 + FROM_WALLS, y0 + FROM_WALLS, x1 - FROM_WALLS, y1 - FROM_WALLS) for x0, y0, x1, y1 in ROOMS.values()]
    off = [max(x0 - x, x - x1, y0 - y, y - y1) for x, y, _ in high for x0, y0, x1, y1 in inner]
    assert np.reshape(off, (len(high), -1)).min(axis=1).max() < 0.15  # on a platform, or a sway beside it
    floor = np.concatenate(points(run, building))
    assert np.sum(np.abs(floor[:, 2] - RISE) < 0.03) > 500
    assert run.rooms_entered >= 2


def test_all_together_is_that_of_its_seed(building: SmallBuilding, tmp_path: Path) -> None:
    def files(name: str) -> dict[str, bytes]:
        out = driven(building, tmp_path / name, "all", carrier=HANDHELD, seconds=3.0).out_dir
        return {str(p.relative_to(out)): p.read_bytes() for p in out.rglob("*") if p.is_file()}

    first, again = files("first"), files("again")
    assert first == again
    told = json.loads(first["run.json"])
    assert len(json.loads(first["tolerances.json"])) > 0
    assert set(told["effects"]) == set(EFFECTS)
    assert (told["carrier"], told["rolling"], told["times_told"], told["scans"]) == ("handheld", True, True, 15)


def test_times_are_written_where_the_sensor_moves_and_the_format_holds_them(
    building: SmallBuilding, tmp_path: Path
) -> None:
    ways: dict[str, dict[str, Any]] = {
        "moving": {"carrier": HANDHELD},
        "without times": {"carrier": HANDHELD, "scan_format": "bin"},
        "at rest": {"carrier": replace(HANDHELD, rolling=False)},
    }
    runs = {name: driven(building, tmp_path / name, seconds=1.0, **way) for name, way in ways.items()}
    scans = {name: list(ScanFolder(run.out_dir / "scans")) for name, run in runs.items()}
    for scan, other in zip(scans["moving"], scans["without times"], strict=True):
        np.testing.assert_array_equal(other.points, scan.points)
        assert other.stamp_ns == scan.stamp_ns and scan.point_times is not None and other.point_times is None
    assert all(scan.point_times is None for scan in scans["at rest"])
    np.testing.assert_allclose(runs["at rest"].truth.poses, runs["moving"].truth.poses, atol=1e-12)


def test_names_of_effects() -> None:
    assert checked(["all"]) == set(EFFECTS) and checked(["glass"]) == {"glass"}
    for gone in ("rain", "untimed", "snapshots"):
        with pytest.raises(UserError, match=f"'{gone}' is not an effect; give some of"):
            checked([gone])
