"""What a state file gives back is what went in; what was damaged on the way is refused in one line."""

import dataclasses
import os
import pickle
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from data.common.errors import UserError
from data.common.files import atomic_file
from sgslam.config import Config
from sgslam.config.models import LoopSettings
from sgslam.registration.window import MotionPrior
from sgslam.serialization import pack, read_state, unpack, write_state
from sgslam.types import Motion


def there_and_back(value: Any) -> Any:
    return unpack(pack(value, Config()), Config())


def same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        alike = isinstance(b, np.ndarray) and a.dtype == b.dtype and a.flags.c_contiguous == b.flags.c_contiguous
        return alike and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(same(v, getattr(b, k)) for k, v in vars(a).items())
    if isinstance(a, (list, tuple)):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict):
        return isinstance(b, dict) and same(list(a.items()), list(b.items()))
    return type(a) is type(b) and (a == b or (a != a and b != b))


VALUES: list[Any] = [
    *[None, True, -3, 2**70, 0.1, float("inf"), float("nan"), "w1@r2", np.float64(0.1)],
    [[], (), {}, set(), np.empty((0, 3))],
    {(1, "frame"): {"a": (1.0, 2.0)}, 3: None},
    [np.eye(4), np.arange(5), np.array(2.5), np.array([True, False]), np.float32([1, 2])],
    [np.arange(9.0).reshape(3, 3).T, np.eye(3)] * 4,
    [Motion(np.full(3, k / 7), np.eye(4)) for k in range(20)],
    MotionPrior(np.zeros(6), np.ones(6), np.eye(6)),
]


@pytest.mark.parametrize("value", VALUES)
def test_a_value_comes_back_as_it_was(value: Any) -> None:
    assert same(there_and_back(value), value)


def test_what_was_one_object_is_one_again_and_what_was_given_is_what_is_given_now() -> None:
    motion, before, now = Motion(np.zeros(3), np.eye(4)), Config(), Config(loops=LoopSettings(gap=20.0))
    raw = pack([motion, [motion], before.loops, VALUES], before, plan=VALUES)
    one, other, settings, plan = unpack(raw, now)
    assert one is other[0] and settings is now.loops and plan is None


@pytest.mark.parametrize("value", [Path("x"), Counter("x"), lambda: None, sys])
def test_what_a_state_cannot_hold_is_not_packed(value: Any) -> None:
    with pytest.raises((TypeError, pickle.PicklingError, AttributeError)):
        pack(value, Config())


@pytest.mark.parametrize("value", [os.system, object(), Path("x"), subprocess.Popen, atomic_file])
def test_nothing_of_others_is_unpacked(value: Any) -> None:
    with pytest.raises(ValueError, match="no state holds"):
        unpack(pickle.dumps(value), Config())


def test_another_version_and_another_file_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sgslam.serialization.VERSION", 99)
    write_state(tmp_path / "a", {}, {})
    monkeypatch.undo()
    with pytest.raises(UserError, match="version 99"):
        read_state(tmp_path / "a")
    np.savez(tmp_path / "b.npz", x=np.zeros(3))
    (tmp_path / "c").write_bytes(b"")
    for name in ("b.npz", "c", "nothing"):
        with pytest.raises(UserError, match=name):
            read_state(tmp_path / name)


def test_a_damaged_file_is_refused_or_tells_the_same(tmp_path: Path) -> None:
    told = {"scans": 3}, {"map": bytes(range(256)) * 4, "tracking": b""}
    write_state(tmp_path / "a", *told)
    whole = (tmp_path / "a").read_bytes()
    rng, path, refused = np.random.default_rng(0), tmp_path / "b", 0
    for turn in range(400):
        raw = bytearray(whole)
        if turn % 4:
            raw[int(rng.integers(len(raw)))] ^= 1 << int(rng.integers(8))
        else:
            del raw[int(rng.integers(len(raw))) :]
        path.write_bytes(bytes(raw))
        try:
            assert read_state(path) == told
        except UserError as error:
            assert "\n" not in str(error) and str(path) in str(error)
            refused += 1
    assert refused > 300
