"""The memory of a run as octets: so that another process goes on where one has ended, as if it were the same.

A ZIP of a document and of arrays, as they are in memory. What may be read is told by the types of the fields of the
memory, so that nothing in the file chooses what is built from it.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from maritrack.chain import Chain, ChainState
from maritrack.errors import BROKEN_ZIP, InputError

DOCUMENT = "state.json"
PARTS = ("tracker", "alive", "background")  # of a ChainState


def state_octets(state: ChainState) -> bytes:
    """The memory of a run; equal ones give equal octets."""
    arrays: list[NDArray[Any]] = []
    document = [_packed(getattr(state, part), arrays) for part in PARTS]
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        _add(file, DOCUMENT, json.dumps(document).encode())
        for i, array in enumerate(arrays):
            content = io.BytesIO()
            np.lib.format.write_array(content, array, version=(1, 0), allow_pickle=False)
            _add(file, f"{i}.npy", content.getvalue())
    return buffer.getvalue()


def read_state(data: bytes, chain: Chain, *, name: str) -> ChainState:
    """The memory of a run of this chain. InputError where it is damaged, or that of another tracker."""
    kinds = get_type_hints(ChainState) | {"tracker": type(chain.tracker.init())}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as file:
            document = json.loads(file.read(DOCUMENT))
            arrays = [
                np.lib.format.read_array(io.BytesIO(file.read(f"{i}.npy")), allow_pickle=False)
                for i in range(len(file.namelist()) - 1)
            ]
        return ChainState(**{
            part: _unpacked(kinds[part], node, arrays) for part, node in zip(PARTS, document, strict=True)
        })  # fmt: skip
    except (*BROKEN_ZIP, KeyError, IndexError, TypeError, ValueError) as error:
        raise InputError(f"{name}: no memory of a run with this tracker: {error}") from None


def _add(file: zipfile.ZipFile, name: str, octets: bytes) -> None:
    file.writestr(zipfile.ZipInfo(name), octets, zipfile.ZIP_DEFLATED, compresslevel=1)


def _packed(value: Any, arrays: list[NDArray[Any]]) -> Any:
    """A value as a node of the document; arrays are numbers of what is beside it."""
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return len(arrays) - 1
    if is_dataclass(value) and not isinstance(value, type):
        return [_packed(getattr(value, field.name), arrays) for field in fields(value)]
    if isinstance(value, Mapping):
        return [[_packed(key, arrays), _packed(item, arrays)] for key, item in value.items()]
    if isinstance(value, tuple):
        return [_packed(item, arrays) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _unpacked(kind: Any, node: Any, arrays: list[NDArray[Any]]) -> Any:
    """The value of this type that a node stands for."""
    origin, inside = get_origin(kind) or kind, get_args(kind)
    if origin is np.ndarray:
        return _array(kind, arrays[node])
    if is_dataclass(origin):
        hints = get_type_hints(origin)
        names = [field.name for field in fields(origin)]
        values: dict[str, Any] = {
            name: _unpacked(hints[name], item, arrays) for name, item in zip(names, node, strict=True)
        }
        return origin(**values)  # type: ignore[operator]
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {_unpacked(inside[0], key, arrays): _unpacked(inside[1], item, arrays) for key, item in node}
    if origin is tuple:
        kinds = inside[:1] * len(node) if inside[1:] == (...,) else inside
        return tuple(_unpacked(one, item, arrays) for one, item in zip(kinds, node, strict=True))
    if type(node) is not kind and not (kind is float and type(node) is int):
        raise TypeError(f"{node!r} is no {getattr(kind, '__name__', kind)}")
    return kind(node)


def _array(kind: Any, array: NDArray[Any]) -> NDArray[Any]:
    """The array, if it is of the type that is told."""
    (dtype,) = get_args(get_args(kind)[1])
    if array.dtype != np.dtype(dtype):
        raise TypeError(f"an array of {array.dtype}, not of {np.dtype(dtype)}")
    return array
