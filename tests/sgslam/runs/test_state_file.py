"""What a state file gives back is what went in; what was damaged on the way is refused in one line."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from data.common.errors import UserError
from sgslam.serialization import read_state, write_state


@dataclasses.dataclass(frozen=True)
class Place:
    name: str
    at: np.ndarray
    height: float | None = None


KNOWN = {"Place": Place}


def there_and_back(path: Path, value: Any) -> Any:
    write_state(path / "a.npz", {}, value, KNOWN)
    return read_state(path / "a.npz", KNOWN)[1]


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
    *[None, True, -3, 2**70, 0.1, float("inf"), float("nan"), "w1@r2"],
    [[], (), {}, set(), np.empty((0, 3))],
    [{1, 2, 3}, [1, 2.5, None, "x"], [True] * 9, [False, 1, 2, 3, 4, 5], list(range(100)), [None] * 9],
    [[0.1 * k for k in range(50)], [2**63 + k for k in range(9)], [1.0, None, 2.0, None, 3.0, 4.0]],
    [[(k, f"w{k}") for k in range(9)], [(0, k, 1) for k in range(9)], [[1], [], [2, 3], [4], [5]]],
    {(1, "frame"): {"a": (1.0, 2.0)}, 3: None},
    [np.eye(4), np.arange(5), np.array(2.5), np.array([True, False]), np.float32([1, 2])],
    [np.arange(9.0).reshape(3, 3).T, np.eye(3)] * 4,
    [[np.full((k, 3), k / 3) for k in range(9)], [np.eye(4)] * 9, [np.eye(3), np.eye(4)] * 4],
    [Place(f"p{k}", np.full(3, k / 7), None if k % 3 else 0.5) for k in range(20)],
    (Place("a", np.zeros((2, 2))), [Place("b", np.zeros(k)) for k in range(7)]),
]


@pytest.mark.parametrize("value", VALUES)
def test_a_tree_comes_back_as_it_was(tmp_path: Path, value: Any) -> None:
    assert same(there_and_back(tmp_path, value), value)


def test_what_was_one_object_is_one_again(tmp_path: Path) -> None:
    place = Place("a", np.zeros(3))
    back = there_and_back(tmp_path, {"first": place, "others": [place, Place("b", np.ones(3))]})
    assert back["first"] is back["others"][0] and back["others"][1] is not back["first"]


def test_what_a_state_cannot_hold_is_not_written(tmp_path: Path) -> None:
    for value in (object(), Path("x"), np.array(["x"]), np.array([None])):
        with pytest.raises(TypeError):
            write_state(tmp_path / "a.npz", {}, value, KNOWN)
    assert not list(tmp_path.iterdir())


def test_another_version_and_another_file_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sgslam.serialization.state_file.VERSION", 99)
    write_state(tmp_path / "a.npz", {}, 1, KNOWN)
    monkeypatch.undo()
    with pytest.raises(UserError, match="version 99"):
        read_state(tmp_path / "a.npz", KNOWN)
    np.savez(tmp_path / "b.npz", x=np.zeros(3))
    (tmp_path / "c.npz").write_bytes(b"")
    for name in ("b.npz", "c.npz", "nothing.npz"):
        with pytest.raises(UserError, match=name):
            read_state(tmp_path / name, KNOWN)


def test_a_damaged_file_is_refused_or_tells_the_same(tmp_path: Path) -> None:
    value = {"places": [Place(f"p{k}", np.full(3, k / 7), k / 9) for k in range(20)], "again": [(1, "x")] * 6}
    write_state(tmp_path / "a.npz", {"scans": 3}, value, KNOWN)
    whole = (tmp_path / "a.npz").read_bytes()
    rng, path, refused = np.random.default_rng(0), tmp_path / "b.npz", 0
    for turn in range(400):
        raw = bytearray(whole)
        if turn % 4:
            raw[int(rng.integers(len(raw)))] ^= 1 << int(rng.integers(8))
        else:
            del raw[int(rng.integers(len(raw))) :]
        path.write_bytes(bytes(raw))
        try:
            about, back = read_state(path, KNOWN)
        except UserError as error:
            assert "\n" not in str(error) and str(path) in str(error)
            refused += 1
        else:
            assert about == {"scans": 3} and same(back, value)
    assert refused > 300
