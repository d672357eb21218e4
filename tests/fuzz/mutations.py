"""Ways to break a file: tables, numbers in text, headers, arrays, and bytes of any kind."""

from __future__ import annotations

import io
import json
import math
import re
import struct
from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np

DIGITS = "9" * 5000
"""A whole number that Python refuses to read."""


class Raw(str):
    """Text that stands in TOML and JSON as it is."""


NUMBERS: tuple[Any, ...] = (
    0, -1, 1, 2, 3, 7, 255, 1e-300, 1e-9, 0.5, -0.5, 1e6, 1e9, 1e15, 1e30, 1e150, 1e200, 1e300, 1e308, -1e308, math.inf,
    -math.inf, math.nan, 2**31, 2**32, 2**63, 2**64, -(2**63), 10**20, 10**30, 10**308, 10**400, Raw(DIGITS), True,
    False, "1", "inf",
)  # fmt: skip
TEXTS = (
    "", " ", ".", "..", "/", "/dev/zero", "pipe", "folder", "[/b]", "\\[/b]", ":smile:", "[red]", "\x1b[31m", "\0",
    "a\nb", "x" * 3000, "~nobody/x", "é" * 300, "\u202e", "%s{}$HOME", "self", "scene.glb", "task.toml", "archive.zip",
)  # fmt: skip
KEYS = ("self", "cls", "data", "folder", "goals", "kind", "shape", "use", "__class__", "model_config", "name", "x", "")
"""Names that mean something in Python, or in another table."""
WORDS = (
    b"nan",
    b"inf",
    b"1e300",
    b"-1e308",
    b"1e-300",
    b"0",
    b"-1",
    b"99999999999",
    b"x",
    b"",
    b"1e15",
    b"3 3",
    b"2.5",
)


def nested(depth: int, opening: str = "[", closing: str = "]") -> Raw:
    """Lists in lists, as text: parsers must not be made to recurse without end."""
    return Raw(opening * depth + closing * depth)


def value(rng: Random) -> Any:
    """Anything that a file may hold where something else belongs."""
    kinds: tuple[Callable[[], Any], ...] = (
        lambda: rng.choice(NUMBERS),
        lambda: rng.choice(NUMBERS),
        lambda: rng.choice(TEXTS),
        lambda: [rng.choice(NUMBERS) for _ in range(rng.choice((0, 1, 2, 3, 4, 200)))],
        lambda: [[rng.choice(NUMBERS) for _ in range(3)] for _ in range(rng.randrange(3))],
        lambda: {rng.choice(KEYS): rng.choice(NUMBERS)},
        lambda: nested(rng.choice((1, 5, 90, 2000))),
        lambda: rng.uniform(-10, 10),
    )
    return rng.choice(kinds)()


def places(table: Any) -> list[tuple[Any, Any]]:
    """Every table or list inside a value, with each key or index in it."""
    found: list[tuple[Any, Any]] = []
    if isinstance(table, dict | list):
        for key in list(table) if isinstance(table, dict) else range(len(table)):
            found.append((table, key))
            found += places(table[key])
    return found


def table(rng: Random, original: Any, most: int = 3) -> Any:
    """A copy of a table with some of its values changed, exchanged, removed, repeated, or given another key."""
    changed = json.loads(json.dumps(original))
    for _ in range(rng.choice((1, 1, most))):
        spots = places(changed)
        if not spots:
            break
        holder, key = rng.choice(spots)
        other, there = rng.choice(spots)
        way = rng.randrange(12)
        if way <= 6:
            spots = [(h, k) for h, k in spots if type(h[k]) in (int, float)] or spots
            holder, key = rng.choice(spots) if way > 2 else (holder, key)
            numbers = isinstance(holder[key], int | float) and rng.random() < 0.8
            holder[key] = rng.choice(NUMBERS) if numbers else value(rng)
        elif way == 7:
            del holder[key]
        elif way == 8 and isinstance(holder, dict):
            holder[rng.choice((*KEYS, *(str(k) for _, k in spots)))] = holder.pop(key)
        elif way == 9 and isinstance(holder, dict):
            holder[rng.choice((*KEYS, *(str(k) for _, k in spots)))] = value(rng)
        elif way == 10 and isinstance(holder[key], list):
            holder[key] = holder[key] * rng.choice((0, 2, 3, 40))
        else:
            holder[key] = json.loads(json.dumps(other[there], default=str))
    return changed


def toml(value: Any, top: bool = True) -> str:
    """A value as TOML: the outer table a line for each key, what is in it inline."""
    match value:
        case Raw():
            return str(value)
        case bool():
            return "true" if value else "false"
        case int():
            return str(value)
        case float():
            return repr(value) if math.isfinite(value) else {math.inf: "inf", -math.inf: "-inf"}.get(value, "nan")
        case str():
            return _quoted(value)
        case list():
            return "[" + ", ".join(toml(item, False) for item in value) + "]"
        case dict():
            pairs = [f"{toml(str(key))} = {toml(item, False)}" for key, item in value.items()]
            return "\n".join(pairs) + "\n" if top else "{" + ", ".join(pairs) + "}"
    raise TypeError(type(value))


def _quoted(text: str) -> str:
    """A TOML string: as JSON has them, but no pairs of surrogates, and DEL escaped."""
    plain = {"\b": "\\b", "\t": "\\t", "\n": "\\n", "\f": "\\f", "\r": "\\r", '"': '\\"', "\\": "\\\\"}
    letters = (plain.get(c) or (c if " " <= c < "\x7f" else f"\\U{ord(c):08x}") for c in text)
    return '"' + "".join(letters) + '"'


def as_json(value: Any) -> bytes:
    """A value as JSON, in which `Raw` stands as it is."""
    marked: list[str] = []

    def plain(item: Any) -> Any:
        if isinstance(item, Raw):
            marked.append(item)
            return f"@raw{len(marked) - 1}@"
        if isinstance(item, dict):
            return {str(key): plain(inner) for key, inner in item.items()}
        return [plain(inner) for inner in item] if isinstance(item, list) else item

    text = json.dumps(plain(value))
    return re.sub(r'"@raw(\d+)@"', lambda found: marked[int(found[1])], text).encode()


def words(rng: Random, text: bytes) -> bytes:
    """A text file with some of its numbers replaced, or lines removed, repeated, exchanged or cut."""
    for _ in range(rng.randint(1, 3)):
        lines = text.splitlines(keepends=True)
        numbers = list(re.finditer(rb"[-+]?\d+\.?\d*(e[-+]?\d+)?", text))
        way = rng.randrange(8)
        if way <= 3 and numbers:
            found = rng.choice(numbers)
            text = text[: found.start()] + rng.choice(WORDS) + text[found.end() :]
        elif way == 4 and lines:
            del lines[rng.randrange(len(lines))]
            text = b"".join(lines)
        elif way == 5 and lines:
            lines.insert(rng.randrange(len(lines)), rng.choice(lines) * rng.choice((1, 1, 50)))
            text = b"".join(lines)
        elif way == 6 and len(lines) > 1:
            i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
            lines[i], lines[j] = lines[j].rstrip(b"\n"), lines[i]
            text = b"".join(lines)
        else:
            text = binary(rng, text, 1)
    return text


def binary(rng: Random, data: bytes, most: int = 4) -> bytes:
    """Bytes cut, flipped, moved, repeated, overwritten with numbers that break programs, or with a mark before them."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, most)):
        at = rng.randrange(len(changed) + 1)
        way = rng.randrange(9)
        if way == 0:
            del changed[at:]
        elif way <= 3 and changed:
            for _ in range(rng.choice((1, 1, 8))):
                changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
        elif way <= 5:
            form, number = rng.choice(
                (("<I", 2**32 - 1), ("<I", 2**31 - 1), ("<I", 0), ("<f", math.nan), ("<f", math.inf), ("<f", 1e30),
                 ("<d", 1e300), ("<d", math.nan), ("<Q", 2**63), ("<H", 2**16 - 1))
            )  # fmt: skip
            code = struct.pack(form, number)
            changed[at : at + len(code)] = code
        elif way == 6:
            del changed[at : at + rng.choice((1, 4, 64))]
        elif way == 7:
            changed[at:at] = changed[at : at + rng.choice((1, 4, 256))]
        else:
            changed[:0] = rng.choice((b"\xef\xbb\xbf", b"\xff\xfe", b"\0", b"PK\x03\x04", b" "))
        changed = changed[: 1 << 22]
    return bytes(changed)


def array(rng: Random, given: np.ndarray) -> np.ndarray:
    """An array of another type or shape, or with numbers in it that are none."""
    flat = np.array(given, copy=True)
    way = rng.randrange(8)
    if way == 0:
        kind = rng.choice(("float16", "float64", "int64", "bool", "complex64", "U3", "S2", "uint8", "datetime64[s]"))
        with np.errstate(all="ignore"):
            return flat.astype(kind) if flat.dtype.kind in "fiu" and kind[0] != "d" else np.zeros(flat.shape, kind)
    if way == 1:
        return flat.reshape(-1)
    if way == 2:
        return flat[..., None]
    if way == 3:
        return flat[:0] if flat.ndim else flat
    if way == 4:
        return np.asarray(flat.reshape(-1)[0] if flat.size else 0.0)
    if way == 5:
        return np.concatenate([flat, flat]) if flat.ndim else np.stack([flat, flat])
    if way == 6:
        return flat[..., :-1] if flat.ndim else flat
    if flat.dtype.kind == "f" and flat.size:
        where = rng.randrange(flat.size)
        flat.reshape(-1)[where :: rng.choice((flat.size, 1))] = rng.choice((math.nan, math.inf, 1e30, -1e20, 0.0))
    return flat


def archive(rng: Random, arrays: dict[str, np.ndarray]) -> bytes:
    """An .npz file with an array changed, left out, or under another name; sometimes its bytes broken as well."""
    changed = dict(arrays)
    for _ in range(rng.randint(1, 2)):
        name = rng.choice(sorted(changed) or [""])
        way = rng.randrange(8)
        if way == 0:
            changed.pop(name, None)
        elif way == 1 and name in changed:
            changed[rng.choice(("other", "joints", "values", "valid", "a" * 300))] = changed.pop(name)
        elif name in changed:
            changed[name] = array(rng, changed[name])
    buffer = io.BytesIO()
    np.savez(buffer, **changed)
    data = buffer.getvalue()
    return binary(rng, data) if rng.random() < 0.3 else data


def headed(rng: Random, data: bytes, begin: int, size: str) -> bytes:
    """Binary data whose JSON header, of a stated size before it, is changed as a table, with the size kept true."""
    length = struct.unpack_from(size, data, begin)[0]
    start = begin + struct.calcsize(size) + (4 if size == "<I" else 0)  # GLB states a chunk's type after its size
    text = as_json(table(rng, json.loads(data[start : start + length])))
    text += b" " * (-len(text) % 8)
    changed = bytearray(data[:start] + text + data[start + length :])
    struct.pack_into(size, changed, begin, len(text))
    if size == "<I":
        struct.pack_into("<I", changed, 8, len(changed))  # length of the whole GLB file
    return binary(rng, bytes(changed)) if rng.random() < 0.1 else bytes(changed)
