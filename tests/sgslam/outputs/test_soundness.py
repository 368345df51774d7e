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
from sgslam.session.place_report import PlaceReport
from sgslam.session.soundness.free_space import share_looked_through

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
    assert (nothing["probability"], nothing["storey"]) == (0.0, None)
    assert (nothing["outside"], nothing["T_bim_map"]) == (1.0, None)


def wall(x: float, y: float, normal: tuple[float, float], length: float, whole: bool = True) -> WallSurface:
    return WallSurface(f"{x},{y}", None, (x, y), normal, length, parts=(("w", -length / 2, length / 2, whole),))


BETWEEN = wall(4.0, 1.5, (-1.0, 0.0), 3.0)
ROOM = SceneGraph("bim", (), (
    wall(0.0, 1.5, (1.0, 0.0), 3.0), wall(2.0, 0.0, (0.0, 1.0), 4.0), wall(2.0, 3.0, (0.0, -1.0), 4.0), BETWEEN,
))  # fmt: skip
SENSOR = pose(2.0, 1.5, 1.0, yaw=0.7, roll=0.02)


def share(standing: SceneGraph, *ends: tuple[float, float], T: Array = SENSOR) -> float:
    """Of one keyframe, whose rays end at places in the building."""
    clouds, inverse = KeyframeClouds(voxel=1e-4), np.linalg.inv(T)
    points = np.array([[x, y, 0.5 + 0.01 * k, 1.0] for k, (x, y) in enumerate(ends)])
    clouds.add(3, (points @ inverse.T)[:, :3])
    assert len(clouds[3]) == len(ends)
    return share_looked_through(np.stack([T]), [3], clouds, standing)


SIDES = [(0.01 * k, 0.02) for k in range(50, 350, 5)]  # 60 rays to the walls of the room
BEYOND = [(5.0, 0.05 * k) for k in range(10, 50)]  # 40 rays to the next one


def test_rays_end_at_walls_unless_the_map_is_bent() -> None:
    assert share(ROOM, *SIDES) == 0.0
    assert share(ROOM, *SIDES, *BEYOND) == pytest.approx(0.4)
    assert share(replace(ROOM, wall_surfaces=(BETWEEN, replace(BETWEEN, id="other face"))), *SIDES, *BEYOND) == 0.4
    whole = [(0.02, 1.0 + 0.01 * k) for k in range(100)]
    clouds, poses = KeyframeClouds(voxel=1e-4), np.stack([np.eye(4)] * 3)
    poses[:, :2, 3] = 2.0, 1.5
    for keyframe, ends in enumerate((whole, [(5.0, y) for _, y in whole], [])):
        clouds.add(keyframe, np.array([[x - 2.0, y - 1.5, 0.0] for x, y in ends]).reshape(-1, 3))
    assert share_looked_through(poses, [0, 1, 2], clouds, ROOM) == pytest.approx(0.5)


def test_a_long_run_is_looked_at_evenly() -> None:
    clouds, poses = KeyframeClouds(voxel=1e-4), np.stack([SENSOR] * 200)
    for keyframe in range(200):
        y = np.linspace(0.5, 2.5, 400)
        ends = np.column_stack([np.full(400, 5.0 if keyframe % 100 < 50 else 3.98), y, np.ones((400, 2))])
        clouds.add(keyframe, (ends @ np.linalg.inv(SENSOR).T)[:, :3])
    assert share_looked_through(poses, list(range(200)), clouds, ROOM) == pytest.approx(0.5, abs=0.02)


def test_only_what_stands_up_to_the_ceiling_hides_what_is_behind_it() -> None:
    for parts in ((("w", -1.5, 1.5, False),), (("w", -1.5, -1.4, True), ("w", 1.4, 1.5, True)), ()):
        assert share(replace(ROOM, wall_surfaces=(replace(BETWEEN, parts=parts),)), *SIDES, *BEYOND) == 0.0


@pytest.mark.parametrize(("end", "through"), [(4.35, False), (4.45, True)])
def test_a_ray_that_ends_just_behind_a_wall_does_not_lead_through_it(end: float, through: bool) -> None:
    assert (share(ROOM, *[(end, y) for _, y in BEYOND]) > 0.9) is through


@pytest.mark.parametrize(("x", "through"), [(3.75, False), (3.65, True)])
def test_a_sensor_in_a_door_sees_both_rooms(x: float, through: bool) -> None:
    assert (share(ROOM, *[(7.0, y) for _, y in BEYOND], T=pose(x, 1.5, 1.0)) > 0.9) is through


def test_walls_of_other_storeys_and_the_nearest_things_tell_nothing() -> None:
    floors = (Floor("low", "", 0.0), Floor("high", "", 3.0))
    walls = (replace(BETWEEN, floor="high"), replace(ROOM.wall_surfaces[0], floor="low"))
    both = SceneGraph("bim", (), walls, floors=floors)
    assert share(both, *BEYOND) == 0.0 and share(both, *BEYOND, T=pose(2.0, 1.5, 4.0)) == 1.0
    assert share(ROOM, (2.3, 1.5), (2.0, 1.9)) == share(SceneGraph("bim"), *BEYOND) == 0.0
