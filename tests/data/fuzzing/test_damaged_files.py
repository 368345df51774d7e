"""Damaged files to every reader: read or refused in one line, and nothing else (`--fuzz N` for a long run)."""

import faulthandler
import random
import signal
from collections import Counter
from pathlib import Path

import pytest

from fuzzing import isolated
from fuzzing.isolated import input_of, outcomes
from fuzzing.mutations import crc32c, mutate, mutate_json
from fuzzing.readers import READERS, Reader

pytestmark = pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")  # the child needs no thread of its parent


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_damage_is_read_or_refused(reader: Reader, tmp_path: Path, pytestconfig: pytest.Config) -> None:
    count = pytestconfig.getoption("fuzz") * reader.share / sum(r.share for r in READERS)
    found = outcomes(reader, tmp_path, pytestconfig.getoption("fuzz_seed"), max(1, round(count)))
    print(dict(Counter(found)))
    crashes = {tmp_path / f"{k}{reader.suffix}": o for k, o in enumerate(found) if o not in ("read", "refused")}
    assert not crashes


def test_the_same_seed_makes_the_same_inputs(tmp_path: Path) -> None:
    reader = next(r for r in READERS if r.name == "scene graph")
    seeds = reader.samples(tmp_path)
    first = [input_of(reader, seeds, 3, k) for k in range(20)]
    assert first == [input_of(reader, seeds, 3, k) for k in range(20)]
    assert len(set(first)) > 15 and first != [input_of(reader, seeds, 4, k) for k in range(20)]
    assert mutate([b""], random.Random(0)) is not None and mutate_json([b"[]"], random.Random(0)) is not None
    assert crc32c(b"123456789") == 0xE3069283  # of the standard (RFC 3720)


def _fails(path: Path) -> None:
    match path.read_bytes():
        case b"key":
            raise KeyError("one")
        case b"signal":
            faulthandler.disable()  # in the reading process alone: it is no crash to tell of
            signal.raise_signal(signal.SIGSEGV)
        case b"memory":
            bytearray(1 << 40)
        case b"wait":
            signal.pause()
        case b"busy":
            while True:
                pass


@pytest.mark.slow
def test_crashes_of_every_kind_are_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    told = {b"key": "KeyError('one') (", b"signal": "the process ended with SIGSEGV", b"memory": "MemoryError() (",
            b"wait": "the process ended with SIGALRM", b"busy": "the process ended with SIGPROF",
            b"good": "read"}  # fmt: skip
    bad = Reader("bad", ".x", lambda folder: [b"whole"], _fails, lambda seeds, rng: rng.choice(list(told)))
    monkeypatch.setattr(isolated, "SECONDS", 0.1)
    inputs = [input_of(bad, [], 1, k) for k in range(7)]
    assert set(inputs) == set(told)
    found = outcomes(bad, tmp_path, 1, 7)
    assert [o.startswith(told[raw]) for raw, o in zip(inputs, found, strict=True)] == [True] * 7, found
    assert {p.name for p in tmp_path.glob("[0-9]*.x")} == {f"{k}.x" for k, raw in enumerate(inputs) if raw != b"good"}
