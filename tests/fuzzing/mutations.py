"""Damage to files: cut off, bits turned, numbers made absurd, pieces moved, JSON values put in each other's places."""

import io
import json
import random
import re
import zipfile
from collections.abc import Callable
from copy import deepcopy
from typing import Any

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
    if rng.random() < 0.03 and len(seeds) > 1:
        other = rng.choice(seeds)
        raw = raw[: rng.randrange(len(raw) + 1)] + other[rng.randrange(len(other) + 1) :]
    return raw


def mutate_json(seeds: list[bytes], rng: random.Random) -> bytes:
    """A JSON seed with some of its values exchanged, doubled or taken out; now and then its text damaged."""
    if rng.random() < 0.25:
        return mutate(seeds, rng)
    value = json.loads(rng.choice(seeds))
    for _ in range(rng.choice((1, 1, 2, 5))):
        _change_node(value, rng)
    return json.dumps(value).encode()


def mutate_zip(inner: Callable[[list[bytes], random.Random], bytes]) -> Callable[[list[bytes], random.Random], bytes]:
    """Damages one member of an archive with `inner`, or the archive."""

    def mutate(seeds: list[bytes], rng: random.Random) -> bytes:
        """One of the archives with a file in it changed, or, three times in ten, changed itself."""
        if rng.random() < 0.3:
            return mutate(seeds, rng)
        packed = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(rng.choice(seeds))) as archive:
            names = archive.namelist()
            struck = rng.choice([*names, *names[:2], *names[:2]])
            with zipfile.ZipFile(packed, "w", archive.infolist()[0].compress_type) as out:
                for name in names:
                    raw = archive.read(name)
                    out.writestr(name, inner([raw], rng) if name == struck else raw)
        return packed.getvalue()

    return mutate


def mutate_e57(seeds: list[bytes], rng: random.Random) -> bytes:
    """Mostly with the checksums of its pages made right again, since else nothing behind them is ever reached."""
    raw = mutate(seeds, rng)
    if rng.random() < 0.2:
        return raw
    pages = bytearray(raw)
    for at in range(0, len(pages) - PAGE + 1, PAGE):
        pages[at + PAGE - 4 : at + PAGE] = crc32c(pages[at : at + PAGE - 4]).to_bytes(4, "big")
    pages[16:24] = len(pages).to_bytes(8, "little")  # the size that the header tells
    if len(pages) >= PAGE:
        pages[PAGE - 4 : PAGE] = crc32c(pages[: PAGE - 4]).to_bytes(4, "big")
    return bytes(pages)


def crc32c(data: bytes | bytearray) -> int:
    """The checksum of E57's pages (Castagnoli's polynomial)."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc = _CRC_TABLE[(crc ^ byte) & 0xFF] ^ (crc >> 8)
    return crc ^ 0xFFFFFFFF


def _crc_row(crc: int) -> int:
    for _ in range(8):
        crc = (crc >> 1) ^ (0x82F63B78 if crc & 1 else 0)
    return crc


PAGE = 1024  # bytes
_CRC_TABLE = tuple(map(_crc_row, range(256)))


def _cut(raw: bytes, rng: random.Random) -> bytes:
    return raw[: rng.randrange(len(raw) + 1)]


def _turn_bits(raw: bytes, rng: random.Random) -> bytes:
    changed = bytearray(raw)
    for _ in range(rng.choice((1, 1, 4, 16))):
        if changed:
            changed[_place(changed, rng)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _overwrite(raw: bytes, rng: random.Random) -> bytes:
    size, at = rng.choice((1, 2, 4, 8)), _place(raw, rng)
    number = rng.choice(_INTEGERS) & ((1 << 8 * size) - 1)
    return raw[:at] + number.to_bytes(size, rng.choice(("little", "big"))) + raw[at + size :]


def _number(raw: bytes, rng: random.Random) -> bytes:
    """Another text where one of the first numbers, or any, is written."""
    found = list(_NUMBER.finditer(raw, 0, 2000 if rng.random() < 0.3 else len(raw)))
    if not found:
        return _overwrite(raw, rng)
    hit = rng.choice(found)
    return raw[: hit.start()] + rng.choice(_TEXTS) + raw[hit.end() :]


def _exchange_numbers(raw: bytes, rng: random.Random) -> bytes:
    """One number of the text in the place of another: references that lead elsewhere."""
    found = list(_NUMBER.finditer(raw))
    if len(found) < 2:
        return _turn_bits(raw, rng)
    a, b = rng.choice(found), rng.choice(found)
    return raw[: a.start()] + b.group() + raw[a.end() :]


def _insert(raw: bytes, rng: random.Random) -> bytes:
    at = _place(raw, rng)
    return raw[:at] + rng.choice((rng.choice(_TEXTS), rng.randbytes(rng.randrange(1, 20)))) + raw[at:]


def _move(raw: bytes, rng: random.Random) -> bytes:
    """A piece taken out, doubled, or put elsewhere."""
    a, size = _place(raw, rng), rng.choice((1, 4, 16, 100, 1000))
    piece, rest = raw[a : a + size], raw[:a] + raw[a + size :]
    kind, b = rng.randrange(3), _place(raw, rng)
    return rest if kind == 0 else raw[:b] + piece + raw[b:] if kind == 1 else rest[:b] + piece + rest[b:]


def _lines(raw: bytes, rng: random.Random) -> bytes:
    lines = raw.splitlines(keepends=True)
    if len(lines) < 3:
        return _move(raw, rng)
    a, b, kind = rng.randrange(len(lines)), rng.randrange(len(lines)), rng.randrange(3)
    if kind == 0:
        del lines[a]
    elif kind == 1:
        lines.insert(b, lines[a])
    else:
        lines[a], lines[b] = lines[b], lines[a]
    return b"".join(lines)


def _place(raw: bytes | bytearray, rng: random.Random) -> int:
    """Anywhere, but often in the header, where a little does much."""
    reach = rng.choice((32, 128, 512, len(raw), len(raw)))
    return rng.randrange(max(1, min(reach, len(raw))))


_DAMAGES = (
    _cut, _turn_bits, _turn_bits, _overwrite, _overwrite, _number, _number, _exchange_numbers, _insert, _move, _lines,
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
    key: Any = rng.choice(list(holder)) if isinstance(holder, dict) else rng.randrange(len(holder))
    kind = rng.randrange(5)
    if kind == 0:
        del holder[key]
    elif kind == 1 and isinstance(holder[key], (int, float)):
        holder[key] = holder[key] * rng.choice((-1, 0, 1e-9, 1e9, 1e300, 1000))
    elif kind == 2 and isinstance(holder, list):
        holder.insert(rng.randrange(len(holder) + 1), deepcopy(holder[key]))
    elif kind == 3:
        other = rng.choice(list(holder)) if isinstance(holder, dict) else rng.randrange(len(holder))
        holder[key], holder[other] = holder[other], holder[key]
    else:
        holder[key] = deepcopy(rng.choice(_VALUES))
