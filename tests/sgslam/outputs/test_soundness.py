"""Whether a placed map is sound: what each signal says for and against it, and rays through walls."""

from dataclasses import replace

import numpy as np
import pytest
from boxes import Array, pose

from data import Floor, SceneGraph, WallSurface
from sgslam.anchoring.place_posterior import Place, PlacePosterior
from sgslam.anchoring.soundness import SoundnessModel, shipped
from sgslam.config import AnchorSettings
from sgslam.mapping import KeyframeClouds
from sgslam.session.soundness.quality import PlaceReport
from sgslam.session.soundness.standing_walls import share_looked_through

MODEL = SoundnessModel(
    sound={"plan_tilt_deg": (float(np.log(0.1)), 0.5), "planned_walls_crossed": (0.1, 0.1)},
    unsound={"plan_tilt_deg": (float(np.log(0.4)), 0.5), "planned_walls_crossed": (0.5, 0.5)},
    prior=1.0, share=0.5,
)  # fmt: skip
TYPICAL = {
    "plan_tilt_deg": 0.15,
    "map_against_odometry": 0.0004,
    "position_sigma_m": 0.03,
    "walls_looked_through": 0.005,
}


def test_each_signal_speaks_for_a_sound_map_or_against_it() -> None:
    """By hand: 2 ln 4 nats for a tilt like that of sound maps; it says nothing halfway, and never more than at the
    medians. A crossing is five times as probable in an unsound map, none 1.8 times as probable in a sound one."""
    tilts = [MODEL.nats("plan_tilt_deg", tilt) for tilt in (0.0, 0.05, 0.1, 0.2, 0.4, 4.0)]
    assert tilts == pytest.approx(2 * np.log(4) * np.array([1, 1, 1, 0, -1, -1]))
    crossed = [MODEL.nats("planned_walls_crossed", count) for count in range(4)]
    assert crossed == pytest.approx(np.log(1.8) - np.log(5) * np.arange(4))


def test_signals_that_depend_on_one_another_count_by_a_share() -> None:
    for unknown in ({}, {"other": 3.0}):
        assert MODEL.judged(unknown).probability == pytest.approx(1 / (1 + np.exp(-1)))
    found = MODEL.judged({"plan_tilt_deg": 0.4, "planned_walls_crossed": 1.0})
    assert found.nats == pytest.approx({"plan_tilt_deg": -2 * np.log(4), "planned_walls_crossed": np.log(1.8 / 5)})
    assert found.probability == pytest.approx(1 / (1 + np.exp(-1) * 4 * np.sqrt(5 / 1.8)))
    assert 0.0 <= MODEL.judged({"planned_walls_crossed": 1e4}).probability < 1e-9


def test_the_shipped_model_is_consistent() -> None:
    model = shipped()
    assert 0 < model.share <= 1
    assert model.sound.keys() == model.unsound.keys() == {*TYPICAL, "planned_walls_crossed"}
    for name, (middle, spread) in model.sound.items():
        is_count = name == "planned_walls_crossed"
        values = (0.0, 5.0) if is_count else tuple(np.exp([middle, model.unsound[name][0]]))
        assert spread > 0 and model.unsound[name][1] > 0 and (not is_count or max(spread, model.unsound[name][1]) < 1)
        assert model.nats(name, values[0]) >= model.nats(name, values[1])


def test_sliding_doors_are_forgiven_and_a_warped_map_is_not() -> None:
    model, withdraw, kept = shipped(), AnchorSettings().withdraw, []
    for crossed in range(6):
        kept.append(model.judged(TYPICAL | {"planned_walls_crossed": float(crossed)}).probability)
    assert kept[5] > withdraw and kept == sorted(kept, reverse=True) and kept[0] != kept[1]
    warped = {
        "plan_tilt_deg": 0.7,
        "map_against_odometry": 0.015,
        "position_sigma_m": 0.3,
        "walls_looked_through": 0.25,
    }
    assert model.judged(warped).probability < withdraw


def test_a_report_of_a_place_is_of_the_best_one_and_whether_the_map_is_sound_there() -> None:
    places = tuple(Place((0.0, 1.0, 2.0), floor, p) for floor, p in (("eg", 0.8), ("og", 0.1)))
    signals, nothing = TYPICAL | {"planned_walls_crossed": 1.0}, PlaceReport(PlacePosterior()).to_dict()
    sound = shipped().judged(signals)
    told = PlaceReport(PlacePosterior(places, 0.06), sound, signals, SENSOR).to_dict()
    assert told["probability"] == pytest.approx(0.8 * sound.probability) and told["sound"] == sound.probability
    assert (told["storey"], told["runner_up"], told["runner_up_storey"]) == ("eg", 0.1, "og")
    assert told["outside"] == pytest.approx(0.04) and told["mirrored"] == 0.06 and told["T_bim_map"][:2] == [2.0, 1.5]
    assert {name: own["value"] for name, own in told["signals"].items()} == signals
    assert (nothing["probability"], nothing["storey"]) == (0.0, None)
    assert (nothing["outside"], nothing["T_bim_map"]) == (1.0, None)


def wall(x: float, y: float, normal: tuple[float, float], length: float, whole: bool = True) -> WallSurface:
    return WallSurface(f"{x},{y}", None, (x, y), normal, length, parts=(("w", -length / 2, length / 2, whole),))


BETWEEN = wall(4.0, 1.5, (-1.0, 0.0), 3.0)
ROOM = SceneGraph("bim", (), (
    wall(0.0, 1.5, (1.0, 0.0), 3.0), wall(2.0, 0.0, (0.0, 1.0), 4.0), wall(2.0, 3.0, (0.0, -1.0), 4.0), BETWEEN,
))  # fmt: skip
SENSOR = pose(2.0, 1.5, 1.0, yaw=0.7, roll=0.02)


def share(standing: SceneGraph, *ends: tuple[float, float], T: Array = SENSOR, keyframes: int = 1) -> float:
    """Of keyframes whose rays end at places in the building."""
    clouds, inverse = KeyframeClouds(voxel=1e-4), np.linalg.inv(T)
    points = np.array([[x, y, 0.5 + 0.01 * k, 1.0] for k, (x, y) in enumerate(ends)])
    for keyframe in range(keyframes):
        clouds.add(keyframe, (points @ inverse.T)[:, :3])
        assert len(clouds[keyframe]) == len(ends)
    clouds.add(keyframes, points[:0, :3])
    return share_looked_through(np.stack([T] * (keyframes + 1)), list(range(keyframes + 1)), clouds, standing)


SIDES = [(0.01 * k, 0.02) for k in range(50, 350, 5)]  # 60 rays to the walls of the room
# 40 rays to the next one: they meet the wall between, of 3 m, halfway, on 1.2 m
BEYOND = [(6.0, 1.5 + 2 * (0.615 + 0.03 * k - 1.5)) for k in range(40)]
ALONE = replace(ROOM, wall_surfaces=(BETWEEN,))


def test_rays_end_at_walls_unless_the_map_is_bent() -> None:
    assert share(ROOM, *SIDES) == 0.0
    assert share(ROOM, *SIDES, *BEYOND) == pytest.approx(1.2 / 14, abs=0.01)
    assert share(ALONE, *SIDES, *BEYOND) == pytest.approx(1.2 / 3, abs=0.05)
    faces = replace(ROOM, wall_surfaces=(BETWEEN, replace(BETWEEN, id="other face")))
    assert share(faces, *SIDES, *BEYOND) == share(ALONE, *SIDES, *BEYOND)


def test_a_single_ray_is_an_error_and_several_are_none() -> None:
    for every, keyframes, through in ((5, 1, False), (3, 1, True), (10, 2, False), (10, 3, True), (10, 300, True)):
        assert (share(ALONE, *BEYOND[::every], keyframes=keyframes) > 0.3) is through


def test_only_what_stands_up_to_the_ceiling_hides_what_is_behind_it() -> None:
    for parts in ((("w", -1.5, 1.5, False),), (("w", -1.5, -1.3, True), ("w", 1.3, 1.5, True)), ()):
        assert share(replace(ROOM, wall_surfaces=(replace(BETWEEN, parts=parts),)), *SIDES, *BEYOND) == 0.0


@pytest.mark.parametrize(("end", "through"), [(4.35, False), (4.6, True)])
def test_a_ray_that_ends_just_behind_a_wall_does_not_lead_through_it(end: float, through: bool) -> None:
    assert (share(ROOM, *[(end, 1.5 + 0.01 * k) for k in range(40)]) > 0) is through


@pytest.mark.parametrize(("x", "through"), [(3.75, False), (3.65, True)])
def test_a_sensor_in_a_door_sees_both_rooms(x: float, through: bool) -> None:
    assert (share(ROOM, *[(7.0, y) for _, y in BEYOND], T=pose(x, 1.5, 1.0)) > 0) is through


def test_walls_of_other_storeys_and_the_nearest_things_tell_nothing() -> None:
    floors = (Floor("low", "", 0.0), Floor("high", "", 3.0))
    walls = (replace(BETWEEN, floor="high"), replace(ROOM.wall_surfaces[0], floor="low"))
    both = SceneGraph("bim", (), walls, floors=floors)
    assert share(both, *BEYOND) == 0.0 and share(both, *BEYOND, T=pose(2.0, 1.5, 4.0)) > 0.1
    assert share(ROOM, (2.3, 1.5), (2.0, 1.9)) == share(SceneGraph("bim"), *BEYOND) == 0.0
