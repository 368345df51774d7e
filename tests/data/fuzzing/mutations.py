"""Damage to files: cut off, bits turned, numbers made absurd, pieces moved, JSON values put in each other's places."""

import io
import json
import random
import re
import zipfile
from collections.abc import Callable
from copy import deepcopy
from itertools import pairwise
from typing import Any

Mutate = Callable[[list[bytes], random.Random], bytes]
PAGE = 1024  # bytes of E57

_NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_TEXTS = (
    b"", b"nan", b"inf", b"-1", b"0", b"1e999", b"-1e308", b"1e-320", b"99999999999999999999", b"4294967295",
    b"9223372036854775807", b"-9223372036854775808", b"1e30", b"0x10", b"$", b"*", b"'", b'"', b"\xff\xfe", b"9" * 5000,
    b"\n", b"#", b"()", b"[]", b"{}", b"null", b"!!python/object:os.system", b"&a [*a]", b"\x00",
)  # fmt: skip
_INTEGERS = (0, 1, 2, 127, 128, 255, 256, 32767, 65535, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63 - 1, 2**64 - 1)
_VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1e308, 1e-320, float("nan"), float("inf"), 10**30, 2**63, "", "x", "nan", [], {}, [[]], [0, 0],
    {"x": 1}, "9" * 400, [None] * 4, 1e6, 0.5,
)  # fmt: skip


def mutate(seeds: list[bytes], rng: random.Random) -> bytes:
    """One of the seeds, damaged once to several times."""
    raw = rng.choice(seeds)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        raw = rng.choice(_DAMAGES)(raw, rng)
    if rng.random() < 0.03:
        raw = _cut(raw, rng) + rng.choice(seeds)[_place(raw, rng) :]
    return raw


def mutate_json(seeds: list[bytes], rng: random.Random) -> bytes:
    """A JSON seed with some of its values exchanged, doubled or taken out; now and then its text damaged."""
    if rng.random() < 0.25:
        return mutate(seeds, rng)
    value = json.loads(rng.choice(seeds))
    for _ in range(rng.choice((1, 1, 2, 5))):
        _change_node(value, rng)
    return json.dumps(value).encode()


def mutate_zip(seeds: list[bytes], rng: random.Random) -> bytes:
    """An archive with a file in it damaged, or, three times in ten, damaged itself."""
    if rng.random() < 0.3:
        return mutate(seeds, rng)
    packed = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(rng.choice(seeds))) as archive:
        names = archive.namelist()
        struck = rng.choice([*names, *names[:2], *names[:2]])
        with zipfile.ZipFile(packed, "w", archive.infolist()[0].compress_type) as out:
            for name in names:
                raw = archive.read(name)
                out.writestr(name, mutate([raw], rng) if name == struck else raw)
    return packed.getvalue()


def mutate_e57(seeds: list[bytes], rng: random.Random) -> bytes:
    """Mostly with size and checksums made right again, since else nothing behind them is ever reached."""
    raw = mutate(seeds, rng)
    if rng.random() < 0.2:
        return raw
    pages = bytearray(raw)
    pages[16:24] = len(raw).to_bytes(8, "little")
    for at in range(0, len(pages) - PAGE + 1, PAGE):
        pages[at + PAGE - 4 : at + PAGE] = crc32c(pages[at : at + PAGE - 4]).to_bytes(4, "big")
    return bytes(pages)


def crc32c(data: bytes | bytearray) -> int:
    """The checksum of E57's pages (Castagnoli's polynomial)."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0x82F63B78 * (crc & 1)
    return crc ^ 0xFFFFFFFF


def _cut(raw: bytes, rng: random.Random) -> bytes:
    return raw[: rng.randrange(len(raw) + 1)]


def _turn_bits(raw: bytes, rng: random.Random) -> bytes:
    changed = bytearray(raw)
    for _ in range(rng.choice((1, 1, 4, 16)) if raw else 0):
        changed[_place(raw, rng)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _overwrite(raw: bytes, rng: random.Random) -> bytes:
    size, at = rng.choice((1, 2, 4, 8)), _place(raw, rng)
    number = rng.choice((*_INTEGERS, rng.getrandbits(64))) & ((1 << 8 * size) - 1)
    return raw[:at] + number.to_bytes(size, rng.choice(("little", "big"))) + raw[at + size :]


def _number(raw: bytes, rng: random.Random) -> bytes:
    """Where one of the first numbers is written, or any: a text, or another of the numbers, as a reference astray."""
    found = list(_NUMBER.finditer(raw, 0, 2000 if rng.random() < 0.3 else len(raw)))
    if not found:
        return _overwrite(raw, rng)
    hit, other = rng.choice(found), rng.choice(found).group()
    return raw[: hit.start()] + rng.choice((other, rng.choice(_TEXTS), rng.choice(_TEXTS))) + raw[hit.end() :]


def _insert(raw: bytes, rng: random.Random) -> bytes:
    at = _place(raw, rng)
    return raw[:at] + rng.choice((rng.choice(_TEXTS), rng.randbytes(rng.randrange(1, 20)))) + raw[at:]


def _rearrange(raw: bytes, rng: random.Random) -> bytes:
    """Pieces or lines taken out, doubled, exchanged, or put together in any order."""
    a, size, b = _place(raw, rng), rng.choice((1, 4, 16, 100, 1000)), _place(raw, rng)
    pieces = [raw[i:j] for i, j in pairwise([0, *sorted((a, a + size, b)), len(raw)])]
    if rng.random() < 0.3:
        pieces = raw.splitlines(keepends=True) or [raw]
    i, j, kind = rng.randrange(len(pieces)), rng.randrange(len(pieces)), rng.randrange(4)
    if kind == 0:
        del pieces[i]
    elif kind == 1:
        pieces.insert(j, pieces[i])
    elif kind == 2:
        pieces[i], pieces[j] = pieces[j], pieces[i]
    else:
        pieces = rng.choices(pieces, k=rng.randrange(2 * len(pieces)))
    return b"".join(pieces)


def _place(raw: bytes, rng: random.Random) -> int:
    """Anywhere, but often in the header, where a little does much."""
    reach = rng.choice((32, 128, 512, len(raw), len(raw)))
    return rng.randrange(max(1, min(reach, len(raw))))


_DAMAGES = (
    _cut, _turn_bits, _turn_bits, _overwrite, _overwrite, _number, _number, _number, _insert, _rearrange, _rearrange,
)  # fmt: skip


def _change_node(value: Any, rng: random.Random) -> None:
    """Goes down to some list or object and changes one of its entries."""
    node, holder = value, value
    for _ in range(rng.randrange(1, 10)):
        if isinstance(node, (dict, list)) and node:
            holder = node
            node = rng.choice(list(node.values()) if isinstance(node, dict) else node)
    if not isinstance(holder, (dict, list)) or not holder:
        return
    keys: list[Any] = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
    key, other, kind = rng.choice(keys), rng.choice(keys), rng.randrange(5)
    if kind == 0:
        del holder[key]
    elif kind == 1 and isinstance(holder[key], (int, float)):
        holder[key] = holder[key] * rng.choice((-1, 0, 1e-9, 1e9, 1e300, 1000))
    elif kind == 2 and isinstance(holder, list):
        holder.insert(other, deepcopy(holder[key]))
    elif kind == 3:
        holder[key], holder[other] = holder[other], holder[key]
    else:
        holder[key] = deepcopy(rng.choice(_VALUES))
