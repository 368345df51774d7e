"""Damaged files to every reader, for some seconds: read or refused in one line, and nothing else."""

import faulthandler
import random
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import fuzzing.run as fuzz
from fuzzing.mutations import crc32c, mutate, mutate_json
from fuzzing.readers import READERS, Reader

BY_NAME = {reader.name: reader for reader in READERS}
SLOW = {"IFC", "IFC, packed", "DXF", "mesh .stl", "mesh .obj", "network's input", "network of torch"}  # the command's
QUICK = [name for name in BY_NAME if name not in SLOW]
fuzz.raise_on_timeout()
_samples: dict[str, list[bytes]] = {}


def samples_of(reader: Reader, folder: Path) -> list[bytes]:
    if reader.name not in _samples:
        folder.mkdir(exist_ok=True)
        _samples[reader.name] = reader.samples(folder)
    return _samples[reader.name]


@pytest.mark.parametrize("name", QUICK)
def test_damage_is_read_or_refused(name: str, tmp_path: Path) -> None:
    reader = BY_NAME[name]
    seeds, path = samples_of(reader, tmp_path / "samples"), tmp_path / f"input{reader.suffix}"
    for number in range(25):
        path.write_bytes(fuzz.input_of(reader, seeds, 1, number))
        outcome, what = fuzz.outcome_of(reader, path)
        assert outcome != "crashes", f"input {number}: {what}"


@settings(max_examples=150, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(name=st.sampled_from(["scene graph", "GeoJSON", "trajectory", "g2o", "settings", "bag mcap"]), data=st.data())
def test_pieces_in_any_order(name: str, data: st.DataObject, tmp_path: Path) -> None:
    """Hypothesis cuts the samples into pieces and puts them together again."""
    reader = BY_NAME[name]
    whole = samples_of(reader, tmp_path / "samples")[0]
    cuts = sorted(data.draw(st.lists(st.integers(0, len(whole)), min_size=1, max_size=6)))
    pieces = [whole[a:b] for a, b in zip([0, *cuts], [*cuts, len(whole)], strict=True)]
    order = data.draw(st.lists(st.integers(0, len(pieces) - 1), max_size=8))
    junk = data.draw(st.binary(max_size=8))
    path = tmp_path / f"input{reader.suffix}"
    path.write_bytes(junk.join(pieces[k] for k in order))
    outcome, what = fuzz.outcome_of(reader, path)
    assert outcome != "crashes", what


def test_the_same_seed_makes_the_same_inputs(tmp_path: Path) -> None:
    reader = BY_NAME["scene graph"]
    seeds = samples_of(reader, tmp_path)
    first = [fuzz.input_of(reader, seeds, 3, k) for k in range(20)]
    assert first == [fuzz.input_of(reader, seeds, 3, k) for k in range(20)]
    assert len(set(first)) > 15 and first != [fuzz.input_of(reader, seeds, 4, k) for k in range(20)]
    assert mutate([b""], random.Random(0)) is not None and mutate_json([b"[]"], random.Random(0)) is not None
    assert crc32c(b"123456789") == 0xE3069283  # of the standard (RFC 3720)


def _fails(path: Path) -> None:
    raw = path.read_bytes()
    if raw.startswith(b"whole"):
        return
    if b"1" in raw:
        raise KeyError("one")
    if b"2" in raw:
        faulthandler.disable()  # in the reading process alone: it is no crash to tell of
        signal.raise_signal(signal.SIGSEGV)
    if b"3" in raw:
        bytearray(1 << 40)
    if b"4" in raw:
        signal.pause()


@pytest.mark.slow
def test_crashes_of_every_kind_are_counted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    texts = [b"one 1", b"two 2", b"three 3", b"four 4", b"five 5"]
    bad = Reader("bad", ".x", lambda folder: [b"whole"], _fails, lambda seeds, rng: texts[rng.randrange(5)])
    monkeypatch.setattr(fuzz, "READERS", (bad,))
    monkeypatch.setattr(fuzz, "HANG", 1)
    monkeypatch.setattr(fuzz, "WAIT", 1)
    numbers = [random.Random(f"0 bad {k}").randrange(5) for k in range(12)]
    assert set(numbers) == {0, 1, 2, 3, 4}
    counts = fuzz.fuzz(["bad"], 12, 60, 0, tmp_path, 1)["bad"]
    assert counts["read"] == numbers.count(4) and counts["crashes"] == 12 - numbers.count(4)
    assert len(list(tmp_path.iterdir())) == counts["crashes"]
