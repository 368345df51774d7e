"""Keyframes' points on the disk: kept as they were, read again after a crash, and no reason for a run to fail."""

import contextlib
import errno
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from data.common.errors import UserError
from data.common.files import write_atomically
from sgslam.mapping import KeyframeClouds


def some_points(seed: int, count: int = 500) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-8.0, 8.0, (count, 3)).astype(np.float32)


@pytest.fixture
def three(tmp_path: Path) -> Path:
    """The file of three keyframes."""
    clouds = KeyframeClouds(tmp_path / "clouds.bin", voxel=1e-4)  # so small that all points are kept
    for keyframe in (0, 1, 3):
        clouds.add(keyframe, some_points(keyframe))
    assert list(clouds) == [0, 1, 3] and clouds[2].shape == (0, 3)
    np.testing.assert_array_equal(clouds[1], some_points(1))
    return tmp_path / "clouds.bin"


@pytest.mark.parametrize(
    ("lost", "keyframes", "kept", "added"),
    [(0, None, [0, 1, 3], 4), (700, None, [0, 1], 2), (0, 1, [0], 1)],
    ids=["whole", "broken off", "goes on from an earlier keyframe"],
)
def test_a_file_is_read_as_far_as_it_goes_and_added_to(
    three: Path, lost: int, keyframes: int | None, kept: list[int], added: int
) -> None:
    three.write_bytes(three.read_bytes()[: -lost or None])
    again = KeyframeClouds.open(three, keyframes=keyframes, voxel=1e-4)
    assert list(again) == kept
    again.add(added, some_points(9))
    read = KeyframeClouds.open(three)
    assert list(read) == [*kept, added]
    np.testing.assert_array_equal(read[added], some_points(9))
    np.testing.assert_array_equal(read[0], some_points(0))


def test_a_nameless_store_is_copied_whole_and_what_is_no_file_of_clouds_is_refused(tmp_path: Path) -> None:
    clouds = KeyframeClouds(voxel=1e-4)
    clouds.add(0, some_points(0, 100_000))
    clouds.copy_to(tmp_path / "copy.bin")
    np.testing.assert_array_equal(KeyframeClouds.open(tmp_path / "copy.bin")[0], clouds[0])
    (tmp_path / "other").write_bytes(b"something else")
    for name in ("other", "missing"):
        with pytest.raises(UserError, match=name):
            KeyframeClouds.open(tmp_path / name)


def test_thinning_does_not_move_a_noisy_wall() -> None:
    """Cells in space would: of a wall beside the border of two cells, one point beyond counts as much as all others."""
    rng, clouds = np.random.default_rng(0), KeyframeClouds(voxel=0.1)
    for keyframe, distance in enumerate((2.95, 2.98, 3.0, 3.03)):
        wall = np.column_stack([np.full(60_000, distance), *rng.uniform(-2.0, 2.0, (2, 60_000))])
        clouds.add(keyframe, wall * (1 + rng.normal(0.0, 0.02, len(wall)) / np.linalg.norm(wall, axis=1))[:, None])
        kept = clouds[keyframe]
        assert 500 < len(kept) < 3000
        assert abs(float(kept[:, 0].mean()) - distance) < 0.002  # the standard deviation of the mean is 0.6 mm


def test_on_a_full_disk_clouds_make_room_for_the_results(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    small = tmp_path / "small"
    small.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1500k", "tmpfs", str(small)]
    if os.geteuid() or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("a small disk can only be made by root")
    try:
        clouds = KeyframeClouds(small / "clouds.bin")
        clouds.add(0, 4 * some_points(0, 40_000))
        with (small / "filler").open("wb") as file, contextlib.suppress(OSError):
            file.write(bytes(1 << 21))
        for keyframe in (1, 2):
            clouds.add(keyframe, some_points(keyframe))
        assert list(clouds) == [0] and clouds[1].shape == (0, 3) and len(caplog.records) == 1  # and the run goes on
        with pytest.raises(OSError) as full:
            write_atomically(small / "trajectory.tum", bytes(200_000))
        assert full.value.errno == errno.ENOSPC and full.value.filename == str(small / "trajectory.tum")
        clouds.make_room()
        write_atomically(small / "trajectory.tum", bytes(200_000))
        assert len(clouds) == 0 and (small / "trajectory.tum").stat().st_size == 200_000
    finally:
        subprocess.run(["umount", "--lazy", str(small)], check=True)  # the clouds hold a file on it
