"""Damaged files to every reader: read or refused in one line, and nothing else (`--fuzz N` for a long run)."""

import faulthandler
import io
import json
import re
import resource
import signal
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

import pytest
from fuzzed_readers import READERS, Reader
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from data.common.errors import UnreadableScanError, UserError

MEMORY = 3 << 30  # bytes a reader may allocate, on top of what is loaded
SECONDS = 60.0  # for an input; the machine may be shared
NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
WORDS = "nan inf -1 0 1e999 -1e308 1e-320 99999999999999999999 4294967295 1e30 0x10 $ * ' # () [] {} null &a [*a]"
TEXTS = (*WORDS.encode().split(), b"", b'"', b"\n", b"\x00", b"\xff\xfe", b"9" * 5000, b"!!python/object:os.system")
EDGES = (0, 1, 127, 255, 32767, 65535, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63 - 1, 2**64 - 1)
ODD = '[null, true, 0, -1, 1e308, 1e-320, NaN, Infinity, "", "x", "nan", [], {}, [[]], [0, 0], {"x": 1}, 0.5]'
VALUES: list[Any] = [*json.loads(ODD), 10**30, "9" * 400, [None] * 4]


def _place(rng: Random, raw: bytes) -> int:
    """Anywhere, but often in the header, where a little does much."""
    return rng.randint(0, max(0, min(rng.choice((32, 512, len(raw), len(raw))), len(raw)) - 1))


def _cut(rng: Random, raw: bytes) -> bytes:
    return raw[: rng.randint(0, len(raw))]


def _overwrite(rng: Random, raw: bytes) -> bytes:
    size, at = rng.choice((1, 2, 4, 8)), _place(rng, raw)
    flipped = int.from_bytes(raw[at : at + size], "little") ^ 1 << rng.randint(0, 8 * size - 1)
    number = rng.choice((flipped, rng.getrandbits(64), *EDGES)) & ((1 << 8 * size) - 1)
    return raw[:at] + number.to_bytes(size, rng.choice(("little", "big"))) + raw[at + size :]


def _renumber(rng: Random, raw: bytes) -> bytes:
    """Where a number is written: a text, or another of the numbers, as a reference astray."""
    found = list(NUMBER.finditer(raw, 0, rng.choice((2000, len(raw)))))
    if not found:
        return _overwrite(rng, raw)
    hit, other = rng.choice(found), rng.choice(found).group()
    return raw[: hit.start()] + rng.choice((*TEXTS, other, other)) + raw[hit.end() :]


def _insert(rng: Random, raw: bytes) -> bytes:
    at = _place(rng, raw)
    return raw[:at] + rng.choice((*TEXTS, rng.randbytes(20))) + raw[at:]


def _move(rng: Random, raw: bytes) -> bytes:
    """A piece or a line is taken out, or put elsewhere once or several times."""
    a, b = _place(rng, raw), _place(rng, raw)
    size = rng.choice((1, 4, 16, 100, 1000))
    if rng.random() < 0.3:
        a, size = raw.rfind(b"\n", 0, a) + 1, raw.find(b"\n", a) - raw.rfind(b"\n", 0, a)
    rest = raw[:a] + raw[a + size :]
    return rest[:b] + raw[a : a + size] * rng.randint(0, 3) + rest[b:]


DAMAGES = (_cut, _overwrite, _overwrite, _overwrite, _renumber, _renumber, _renumber, _insert, _move, _move)


def damaged(rng: Random, raw: bytes) -> bytes:
    for damage in rng.choices(DAMAGES, k=rng.choice((1, 1, 1, 2, 4))):
        raw = damage(rng, raw)
    return raw


def damaged_json(rng: Random, raw: bytes) -> bytes:
    """Some values exchanged, doubled, scaled or taken out."""
    whole = json.loads(raw)
    for _ in range(rng.randint(1, 4)):
        node = holder = whole
        for _ in range(rng.randint(1, 10)):
            if isinstance(node, (dict, list)) and node:
                holder, node = node, rng.choice(list(node.values()) if isinstance(node, dict) else node)
        keys: list[Any] = list(holder if isinstance(holder, dict) else range(len(holder)))
        if not keys:
            continue
        key, other, kind = rng.choice(keys), rng.choice(keys), rng.randint(0, 3)
        if kind == 0:
            del holder[key]
        elif kind == 1:
            holder[key], holder[other] = holder[other], holder[key]
        elif kind == 2 and isinstance(holder[key], (int, float)):
            holder[key] *= rng.choice((-1, 0, 1e-9, 1e9, 1e300, 1000))
        else:
            holder[key] = rng.choice(VALUES)
    return json.dumps(whole).encode()


def damaged_zip(rng: Random, raw: bytes) -> bytes:
    """With a file in it damaged."""
    with zipfile.ZipFile(io.BytesIO(raw)) as archive, zipfile.ZipFile(packed := io.BytesIO(), "w") as out:
        struck = rng.choice(archive.namelist())
        for name in archive.namelist():
            own = archive.read(name)
            out.writestr(name, damaged(rng, own) if name == struck else own)
    return packed.getvalue()


FORMS = {"bytes": damaged, "json": damaged_json, "zip": damaged_zip}


@st.composite
def inputs(draw: Callable[[st.SearchStrategy[Any]], Any], samples: list[bytes], form: str) -> bytes:
    """One of the samples, damaged anywhere with the same chance; now and then without regard to its form."""
    rng = draw(st.randoms(use_true_random=True))
    damage = FORMS[form] if rng.random() < 0.8 else damaged
    return damage(rng, rng.choice(samples))


class StuckError(BaseException):
    """No reader takes it for a fault of the file."""


@contextmanager
def bounded() -> Iterator[None]:
    """Raises StuckError after a time, ends the process if that is of no use, and limits the memory."""

    def stuck(*_: object) -> None:
        raise StuckError

    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    memory, before = resource.getrlimit(resource.RLIMIT_AS), signal.signal(signal.SIGALRM, stuck)
    faulthandler.dump_traceback_later(2 * SECONDS, exit=True)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, memory[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, memory)
        signal.setitimer(signal.ITIMER_REAL, 0)
        faulthandler.cancel_dump_traceback_later()
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_damage_is_read_or_refused(reader: Reader, tmp_path: Path, pytestconfig: pytest.Config) -> None:
    """The last input of a process that ended lies in its folder of temporary files, as `input` with the suffix."""
    count = pytestconfig.getoption("fuzz") * reader.share / sum(r.share for r in READERS)
    samples, path = reader.samples(tmp_path), tmp_path / f"input{reader.suffix}"
    for whole in samples:
        path.write_bytes(whole)
        reader.read(path)

    @settings(
        max_examples=max(1, round(count)), deadline=None, database=None, suppress_health_check=list(HealthCheck),
        derandomize=pytestconfig.getoption("hypothesis_seed") is None,
    )  # fmt: skip
    @given(inputs(samples, reader.form))
    def check(raw: bytes) -> None:
        path.write_bytes(raw)
        try:
            with bounded():
                reader.read(path)
        except (UserError, UnreadableScanError) as error:
            assert "\n" not in str(error)

    check()
