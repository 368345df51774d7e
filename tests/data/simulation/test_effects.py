"""What real sensors meet, in the simulation: glass, people, doors, furniture, tolerance, returns, steps."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from small_ifc import DOORS, PANE, ROOMS, SmallBuilding

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene
from data.scans import ScanFolder
from data.scans.point_times import Stamped
from data.simulate import _parser
from data.simulation import SimulatedRun, SpinningSensor
from data.simulation.carriers import HANDHELD, WHEELED, Carrier
from data.simulation.effects import EFFECTS, checked, timing_of
from data.simulation.effects.doors import door_leaves
from data.simulation.effects.furniture import furniture
from data.simulation.effects.people import HEIGHT, RADIUS, People
from data.simulation.effects.platforms import FROM_WALLS, HEADROOM, RISE, platforms
from data.simulation.effects.returns import BIAS, Returns, noisy
from data.simulation.effects.world import World
from data.simulation.occupancy import build_grid
from data.simulation.route import plan_tour
from data.simulation.simulate import simulate
from data.simulation.storey_model import load_storey

SENSOR = SpinningSensor(azimuths=180, rate=5.0)
Array = NDArray[np.float64]


def driven(
    building: SmallBuilding, out: Path, effects: tuple[str, ...], seed: int = 1, carrier: Carrier = WHEELED,
    seconds: float = 20.0, height: float | None = None, stamped: Stamped = "start",
) -> SimulatedRun:  # fmt: skip
    return simulate(
        building.path, "Ground", out, seed, 3, 20.0, SENSOR, sensor_height=height, carrier=carrier, effects=effects,
        seconds=seconds, stamped=stamped,
    )  # fmt: skip


def points(run: SimulatedRun, building: SmallBuilding) -> list[Array]:
    """Each scan's in the building's frame."""
    scans = zip(ScanFolder(run.out_dir / "scans"), run.truth.poses, strict=True)
    return [building.from_bim(scan.points @ T[:3, :3].T + T[:3, 3]) for scan, T in scans]


def test_seven_of_ten_rays_pass_a_pane(building: SmallBuilding) -> None:
    model = load_storey(building.path, "Ground")
    glazed = model.solid[model.glazed].reshape(-1, 3)
    np.testing.assert_allclose(building.from_bim(glazed).min(axis=0), PANE[:3], atol=1e-6)
    np.testing.assert_allclose(building.from_bim(glazed).max(axis=0), PANE[3:], atol=1e-6)
    world = World(TriangleScene(model.solid[~model.glazed]), TriangleScene(model.solid[model.glazed]))
    rng = np.random.default_rng(0)
    inside = np.column_stack([rng.uniform(1.2, 2.3, 4000), np.full(4000, 6.0), rng.uniform(1.0, 2.0, 4000)])
    ranges = world.at(0.0, rng).distances(building.to_bim(inside), np.tile(building.T_bim_building[:3, 1], (4000, 1)))
    assert np.mean(np.isinf(ranges)) == pytest.approx(0.7, abs=0.03)
    np.testing.assert_allclose(ranges[np.isfinite(ranges)], 1.08, atol=1e-4)


def test_a_person_is_an_upright_cylinder_that_moves() -> None:
    crowd = People(np.array([[[4.0, 0, 0], [4.0, 1.0, 0]], [[40.0, 0, 0], [40.0, 0, 0]]]))  # 1 m in 0.1 s
    ahead = np.array([[1.0, 0, 0], [0, 1.0, 0], [0.8, 0, 0.6]])
    np.testing.assert_allclose(crowd.distances(np.array([0, 0, 1.0]), ahead, 0.0), [4 - RADIUS, np.inf, np.inf])
    seconds = np.array([0.0, 0.02, 0.1])
    seen = crowd.distances(np.array([0, 0, 1.0]), np.tile([1.0, 0, 0], (3, 1)), seconds)
    np.testing.assert_allclose(seen, [4 - RADIUS, 4 - np.sqrt(RADIUS**2 - 0.2**2), np.inf])
    down = crowd.distances(np.array([4.1, 0, 3.0]), np.array([[0, 0, -1.0]]), 0.0)
    np.testing.assert_allclose(down, 3.0 - HEIGHT)


def test_one_person_follows_and_others_are_met(building: SmallBuilding, tmp_path: Path) -> None:
    plain, peopled = (driven(building, tmp_path / name, (name,) * (name == "people")) for name in ("none", "people"))
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


def test_leaves_do_not_bar_the_way_and_other_doors_are_shut_or_ajar(building: SmallBuilding) -> None:
    model = load_storey(building.path, "Ground")
    seen = set()
    for seed in range(20):  # a way through the first door
        way = building.to_bim(np.column_stack([np.full(200, 2.5), np.linspace(1.0, 6.0, 200), np.zeros(200)]))[:, :2]
        leaves = door_leaves(model.doors, way, np.random.default_rng(seed))
        assert len(leaves) == len(DOORS)
        for leaf in leaves:
            corners = building.from_bim(leaf.triangles.reshape(-1, 3))
            assert corners[:, 2].max() < 2.11
            assert np.linalg.norm(way[:, None] - leaf.footprint, axis=2).min() > 0.2
            wide = np.ptp(corners[:, 1])
            first = corners[:, 0].max() < 4.5
            seen.add((first, "open" if wide > 0.8 else "shut" if wide < 0.1 else "ajar"))
    assert {(True, "open"), (False, "shut"), (False, "ajar")} <= seen and (True, "shut") not in seen


def test_furniture_stands_at_walls_beside_the_way(building: SmallBuilding) -> None:
    model = load_storey(building.path, "Ground")
    grid = build_grid(model, TriangleScene(model.solid), 1.75)
    for seed in range(2):
        way = np.concatenate(plan_tour(grid, 0.25, 3, 20.0, np.random.default_rng(seed)))
        pieces = furniture(grid, model.level, way, 0.25, model.doors, np.random.default_rng(seed))
        assert len(pieces) >= 5
        for piece in pieces:
            spots = building.from_bim(np.c_[piece.footprint, np.zeros(len(piece.footprint))])
            low, high = spots[:, :2].min(axis=0), spots[:, :2].max(axis=0)
            rooms = np.array(list(ROOMS.values()))
            beyond = np.max(np.hstack([rooms[:, :2] - low, high - rooms[:, 2:]]), axis=1).min()
            assert beyond < 0.04  # in one room; walls are known to a cell of 5 cm
            assert np.linalg.norm(way[::3, None] - piece.footprint, axis=2).min() > 0.29
            assert piece.high - model.level <= 1.9


def test_walls_stand_off_their_places_by_a_tolerance(building: SmallBuilding) -> None:
    planned = load_storey(building.path, "Ground")
    offsets = []
    for seed in range(8):
        built = load_storey(building.path, "Ground", None, seed, 0.015)
        assert not built.changes
        moved = np.linalg.norm((built.solid - planned.solid).mean(axis=1), axis=1)
        offsets += np.unique(moved[moved > 0].round(6)).tolist()
    assert len(offsets) > 32
    assert np.sqrt(np.mean(np.square(offsets))) == pytest.approx(0.015, rel=0.2)


def test_returns_have_noise_biases_reach_and_grazing_losses() -> None:
    sensor = noisy(SpinningSensor())
    assert (sensor.range_noise, sensor.max_range) == (0.03, 30.0)
    biases = np.concatenate([Returns.of(16, seed).bias for seed in range(50)])
    assert np.std(biases) == pytest.approx(BIAS, rel=0.15)
    returns, rng = Returns.of(2, 0), np.random.default_rng(0)
    flat = returns.measured(np.full(1000, 5.0), np.ones(1000), rng)
    np.testing.assert_allclose(flat, 5.0 + np.resize(returns.bias, 1000))
    edge = np.repeat([4.0, 8.0], 2)[np.arange(4000) // 2 % 2 * 2]  # each beam meets an edge with every ray
    between = returns.measured(edge, np.ones(4000), rng)
    assert 0.2 < np.mean((between > 4.1) & (between < 7.9)) < 0.4
    lost = [np.isinf(returns.measured(np.full(2000, 5.0), np.full(2000, np.cos(np.radians(a))), rng)).mean()
            for a in (79.0, 84.0, 89.0)]  # fmt: skip
    assert lost[0] == 0 and 0.3 < lost[1] < 0.7 and lost[2] == 1


@pytest.mark.parametrize("carrier", [WHEELED, HANDHELD])
def test_the_sensor_rises_over_a_step(building: SmallBuilding, tmp_path: Path, carrier: Carrier) -> None:
    run = driven(building, tmp_path / "run", ("steps", "snapshots"), carrier=carrier, seconds=40.0, height=0.9)
    places = building.from_bim(run.truth.positions)
    assert places[:, 2].min() < 0.95 + 0.05 and places[:, 2].max() > 0.9 + RISE - 0.06
    high = places[places[:, 2] > 0.9 + RISE - 0.06]
    inner = [(x0 + FROM_WALLS, y0 + FROM_WALLS, x1 - FROM_WALLS, y1 - FROM_WALLS) for x0, y0, x1, y1 in ROOMS.values()]
    off = [max(x0 - x, x - x1, y0 - y, y - y1) for x, y, _ in high for x0, y0, x1, y1 in inner]
    assert np.reshape(off, (len(high), -1)).min(axis=1).max() < 0.15  # on a platform, or a sway beside it
    floor = np.concatenate(points(run, building))
    assert np.sum(np.abs(floor[:, 2] - RISE) < 0.03) > 500
    assert run.rooms_entered >= 2


@pytest.mark.parametrize(("bottom", "raised"), [(HEADROOM - 0.01, False), (HEADROOM + 0.01, True)])
def test_nothing_is_raised_under_what_hangs_low(building: SmallBuilding, bottom: float, raised: bool) -> None:
    model = load_storey(building.path, "Ground")
    corners = building.to_bim(np.array([[3, 0, bottom], [7, 0, bottom], [5, 9, bottom]], float))
    way = building.to_bim(np.array([[x, 1.5, 0.0] for x in np.linspace(0.5, 9.5, 100)]))  # along the hall
    found = platforms([model], [way], TriangleScene(np.concatenate([model.solid, corners[None]])), seed=0)
    under, beside = building.to_bim(np.array([[5.0, 1.5, 0.0], [1.0, 1.5, 0.0]]))
    assert found.rise(np.stack([under, beside])).tolist() == [RISE * raised, RISE]


def test_all_together_is_that_of_its_seed(building: SmallBuilding, tmp_path: Path) -> None:
    def files(name: str) -> dict[str, bytes]:
        out = driven(building, tmp_path / name, ("all",), carrier=HANDHELD, seconds=3.0).out_dir
        return {str(p.relative_to(out)): p.read_bytes() for p in out.rglob("*") if p.is_file()}

    first, again = files("first"), files("again")
    assert first == again
    told = json.loads(first["run.json"])
    assert len(json.loads(first["tolerances.json"])) > 0
    assert set(told["effects"]) == set(EFFECTS) - {"snapshots", "untimed"}
    assert (told["carrier"], told["rolling"], told["times_told"], told["scans"]) == ("handheld", True, True, 15)


def test_times_are_written_or_not_and_stamps_may_be_of_another_instant(building: SmallBuilding, tmp_path: Path) -> None:
    runs = {
        name: driven(building, tmp_path / name, (name.split()[0],), carrier=HANDHELD, seconds=1.0, stamped=stamped)
        for name, stamped in (("rolling", "start"), ("untimed", "start"), ("snapshots", "start"),
                              ("rolling middle", "middle"), ("rolling end", "end"))
    }  # fmt: skip
    scans = {name: list(ScanFolder(run.out_dir / "scans")) for name, run in runs.items()}
    for name, share in (("untimed", 0.0), ("rolling middle", 0.5), ("rolling end", 1.0)):
        before = share / SENSOR.rate
        for scan, other in zip(scans["rolling"], scans[name], strict=True):
            np.testing.assert_array_equal(other.points, scan.points)
            assert other.stamp_ns - scan.stamp_ns == round(1e9 * before) and scan.point_times is not None
            if name != "untimed":
                np.testing.assert_allclose(other.point_times, scan.point_times - before, atol=1e-6)
    assert all(scan.point_times is None for name in ("untimed", "snapshots") for scan in scans[name])
    np.testing.assert_allclose(runs["snapshots"].truth.poses, runs["rolling"].truth.poses, atol=1e-12)
    np.testing.assert_allclose(runs["rolling end"].truth.poses[:-1], runs["rolling"].truth.poses[1:], atol=1e-6)
    with pytest.raises(UserError, match="a scan of one instant has no end to stamp"):
        driven(building, tmp_path / "a", ("snapshots",), carrier=HANDHELD, seconds=1.0, stamped="end")


def test_names_of_effects(capsys: pytest.CaptureFixture[str]) -> None:
    assert timing_of(checked([]), True) == "rolling" and timing_of(checked([]), False) == "snapshots"
    assert timing_of(checked(["all", "untimed"]), True) == "untimed"
    for names, message in (
        (["rain"], "'rain' is not known; give some of"),
        (["untimed", "rolling"], "rolling and untimed exclude each other"),
    ):
        with pytest.raises(UserError, match=message):
            checked(names)
    with pytest.raises(SystemExit):
        _parser().parse_args(["--bim", "a.ifc", "--out", "out", "--effects", "glass", "fog"])
    said = capsys.readouterr().err
    assert "comma-separated" in said and "'fog'" in said and len(said.splitlines()) == 1
