"""MATLAB 5 files: numbers, texts, cells and structs. What else there may be is refused.

From the published description of the format. Not scipy's reader: damaged files end the process there.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from struct import Struct
from typing import Any, NamedTuple

import numpy as np

from maritrack.errors import InputError

HEADER = 128
ORDER = {b"IM": "<", b"MI": ">"}
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
MATRIX, COMPRESSED = 14, 15
CELL, STRUCT, CHAR, NUMERIC = 1, 2, 4, range(6, 16)  # classes of arrays
COMPLEX = 0x0800
MAX_DEPTH = 16
MAX_INFLATED = 1 << 28


class _Element(NamedTuple):
    kind: int
    octets: memoryview


def read_mat(data: bytes) -> dict[str, Any]:
    """The variables of a file by name. InputError with the octet where it is damaged.

    A number is a number, more are an array without dimensions of length 1; a cell array is a list, a
    struct a dictionary, several structs a list of them; both in MATLAB's order, columns first.
    """
    order = ORDER.get(data[126:128])
    if len(data) < HEADER or order is None:
        raise InputError(f"not a MATLAB 5 file: {len(data)} octets")
    view, variables = memoryview(data), dict[str, Any]()
    for element in _elements(view[HEADER:], order):
        packed = element.kind == COMPRESSED
        inner = next(_elements(memoryview(_inflated(element.octets)), order), element) if packed else element
        name, value = _array(_matrix(inner), order, depth=0)
        variables[name] = value
    return variables


def _elements(view: memoryview, order: str) -> Iterator[_Element]:
    """The elements that follow each other in a stretch of octets."""
    header, at = Struct(f"{order}II"), 0
    while at < len(view):
        if at + 8 > len(view):
            raise InputError("damaged MATLAB file: it ends within an element")
        word, size = header.unpack_from(view, at)
        if word >> 16:  # a small one: type and size share a word
            kind, size, begin, step = word & 0xFFFF, word >> 16, at + 4, 8
            if size > 4:
                raise InputError("damaged MATLAB file: a small element that is large")
        else:
            kind, begin = word, at + 8
            step = 8 + (size if kind == COMPRESSED else size + (-size) % 8)
        if begin + size > len(view):
            raise InputError("damaged MATLAB file: it ends within an element")
        yield _Element(kind, view[begin : begin + size])
        at += step


def _inflated(octets: memoryview) -> bytes:
    try:
        unpacker = zlib.decompressobj()
        data = unpacker.decompress(octets, MAX_INFLATED)
    except zlib.error as error:
        raise InputError(f"damaged MATLAB file: {error}") from None
    if not unpacker.eof:
        raise InputError("damaged MATLAB file: compressed data that end early or are too large")
    return data


def _array(octets: memoryview, order: str, *, depth: int) -> tuple[str, Any]:
    """Name and value of an array."""
    if len(octets) == 0:
        return "", np.empty(0)
    if depth > MAX_DEPTH:
        raise InputError("damaged MATLAB file: nested too deeply")
    parts = _elements(octets, order)
    flags = _numbers(next(parts, None), order)
    shape = [int(n) for n in _numbers(next(parts, None), order)]
    name = _text(next(parts, None), order)
    if len(flags) == 0 or not shape or min(shape) < 0:
        raise InputError("damaged MATLAB file: an array without a shape")
    kind, n = int(flags[0]) & 0xFF, math.prod(shape)
    if kind == CELL:
        return name, _cells(parts, order, n, depth=depth)
    if kind == STRUCT:
        return name, _structs(parts, order, n, depth=depth)
    if kind == CHAR:
        return name, _text(next(parts, None), order) if n else ""
    if kind in NUMERIC and not int(flags[0]) & COMPLEX:
        return name, _shaped(_numbers(next(parts, None), order), shape)
    raise InputError(f"MATLAB file with an array of class {kind}: numbers, texts, cells and structs are read")


def _shaped(values: np.ndarray[Any, Any], shape: list[int]) -> Any:
    if len(values) != math.prod(shape):
        raise InputError("damaged MATLAB file: numbers that do not fill their array")
    if len(values) == 1:
        return values[0].item()
    return values.reshape(shape, order="F").squeeze()


def _cells(parts: Iterator[_Element], order: str, n: int, *, depth: int) -> list[Any]:
    cells = [_array(_matrix(part), order, depth=depth + 1)[1] for part in parts]
    if len(cells) != n:
        raise InputError(f"damaged MATLAB file: {len(cells)} of {n} cells")
    return cells


def _structs(parts: Iterator[_Element], order: str, n: int, *, depth: int) -> Any:
    width = _numbers(next(parts, None), order)
    names = _octets(next(parts, None))
    if len(width) != 1 or not 0 < int(width[0]) <= 64 or len(names) % int(width[0]):
        raise InputError("damaged MATLAB file: a struct without names")
    step = int(width[0])
    keys = [names[i : i + step].split(b"\0")[0].decode("latin-1") for i in range(0, len(names), step)]
    values = [_array(_matrix(part), order, depth=depth + 1)[1] for part in parts]
    if not keys or len(values) != n * len(keys):
        raise InputError(f"damaged MATLAB file: {len(values)} values in {n} structs of {len(keys)}")
    rows = [dict(zip(keys, values[i : i + len(keys)], strict=True)) for i in range(0, len(values), len(keys))]
    return rows[0] if n == 1 else rows


def _matrix(element: _Element) -> memoryview:
    if element.kind != MATRIX:
        raise InputError("damaged MATLAB file: an array was expected")
    return element.octets


def _octets(element: _Element | None) -> bytes:
    return b"" if element is None else bytes(element.octets)


def _numbers(element: _Element | None, order: str) -> np.ndarray[Any, Any]:
    kind = None if element is None else NUMBERS.get(element.kind)
    if element is None or kind is None or len(element.octets) % int(kind[1]):
        raise InputError("damaged MATLAB file: numbers were expected")
    return np.frombuffer(element.octets, dtype=order + kind)


def _text(element: _Element | None, order: str) -> str:
    kind = None if element is None else TEXTS.get(element.kind)
    if element is None or kind is None:
        raise InputError("damaged MATLAB file: a text was expected")
    suffix = ("-le" if order == "<" else "-be") if kind in ("utf-16", "utf-32") else ""
    return bytes(element.octets).decode(kind + suffix, "replace")
