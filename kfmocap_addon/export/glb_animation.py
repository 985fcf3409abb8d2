"""Animations in binary glTF: reading their values, changing and packing them."""

from __future__ import annotations

import json
import struct
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.numerics import rotations
from ...core.numerics.arrays import Array

_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
_FLOAT = 5126
_COLUMNS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
_AT_REST: Mapping[str, Sequence[float]] = {"translation": (0, 0, 0), "rotation": (0, 0, 0, 1), "scale": (1, 1, 1)}

Curves = Mapping[tuple[int, str], Array]
"""The values (F, C) of animated properties, by node and path."""


def unpacked(glb: bytes) -> tuple[dict[str, Any], bytearray]:
    """Return the two parts of a .glb file: its JSON and its binary data."""
    (size,) = struct.unpack_from("<I", glb, 12)
    return json.loads(glb[20 : 20 + size]), bytearray(glb[28 + size :])


def packed(content: Mapping[str, Any], binary: bytes | bytearray) -> bytes:
    """Return a .glb file of its two parts."""
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    head = struct.pack("<III", _MAGIC, 2, 28 + len(text) + len(binary))
    return head + struct.pack("<II", len(text), _JSON) + text + struct.pack("<II", len(binary), _BINARY) + binary


def with_scaled_times(glb: bytes, factor: float) -> bytes:
    """Return the content of a .glb file with all times of its animations multiplied by a factor."""
    content, binary = unpacked(glb)
    for accessor in {sampler["input"] for each in content.get("animations", ()) for sampler in each["samplers"]}:
        one, times = content["accessors"][accessor], _values(content, binary, accessor)
        scaled, start = np.float32(factor * times), _start(content, one)
        binary[start : start + scaled.nbytes] = scaled.tobytes()
        one["min"], one["max"] = [float(scaled.min())], [float(scaled.max())]
    return packed(content, binary)


def add_turns_between(
    content: dict[str, Any], binary: bytearray, animation: dict[str, Any], kept: Collection[int], top: int
) -> None:
    """Add the movement of the nodes between each kept node and the next kept one above it to its own rotation, and to
    the position of the topmost, so that it moves as before although those nodes are not animated.

    Parameters
    ----------
    kept : collection of int
        Nodes.
    top : int
        The one of them that has no other above it.
    """
    above = {child: n for n, node in enumerate(content["nodes"]) for child in node.get("children", ())}
    channels = {(c["target"]["node"], c["target"]["path"]): c for c in animation["channels"] if "node" in c["target"]}
    samplers = animation["samplers"]
    curves = {key: _values(content, binary, samplers[c["sampler"]]["output"]) for key, c in channels.items()}
    for node in sorted(kept):
        between: list[int] = []
        other = above.get(node)
        while other is not None and other not in kept:
            between.insert(0, other)
            other = above.get(other)
        if not any((b, path) in curves for b in between for path in _AT_REST):
            continue
        length = max(len(curves[b, path]) for b in [*between, node] for path in _AT_REST if (b, path) in curves)
        local = _product([_matrices(content, curves, b, length) for b in between])
        rest = _product([_matrices(content, {}, b, 1) for b in between])
        moved = np.linalg.inv(rest) @ local @ _matrices(content, curves, node, length)
        turns = Rotation.from_matrix(rotations.orthonormal(moved[:, :3, :3])).as_quat()
        found = {"rotation": rotations.continuous_signs(turns)}
        if node == top:
            found["translation"] = moved[:, :3, 3]
        for path, values in found.items():
            if (channel := channels.get((node, path))) is not None:
                samplers.append({**samplers[channel["sampler"]], "output": _added(content, binary, values)})
                channel["sampler"] = len(samplers) - 1


def _product(matrices: Sequence[Array]) -> Array:
    found = np.eye(4)[None]
    for each in matrices:
        found = found @ each
    return found


def _matrices(content: Mapping[str, Any], curves: Curves, node: int, length: int) -> Array:
    """Return the local matrices (F, 4, 4) of a node."""
    values = {}
    for path, default in _AT_REST.items():
        curve = curves.get((node, path), np.array([content["nodes"][node].get(path, default)], float))
        values[path] = curve[np.minimum(np.arange(length), len(curve) - 1)]
    found = np.tile(np.eye(4), (length, 1, 1))
    found[:, :3, :3] = Rotation.from_quat(values["rotation"]).as_matrix() * values["scale"][:, None]
    found[:, :3, 3] = values["translation"]
    return found


def _values(content: Mapping[str, Any], binary: bytes | bytearray, accessor: int) -> Array:
    """Return the values (F, C) of an accessor of floating-point numbers."""
    one = content["accessors"][accessor]
    columns = _COLUMNS[one["type"]]
    values = np.frombuffer(binary, np.float32, one["count"] * columns, _start(content, one))
    return values.reshape(-1, columns).astype(float)


def _start(content: Mapping[str, Any], accessor: Mapping[str, Any]) -> int:
    """Return where the values of an accessor begin in the binary data, bytes."""
    view = content["bufferViews"][accessor["bufferView"]]
    return int(view.get("byteOffset", 0) + accessor.get("byteOffset", 0))


def _added(content: dict[str, Any], binary: bytearray, values: Array) -> int:
    """Add values (F, C) to the end of a file; returns their accessor."""
    binary.extend(bytes(-len(binary) % 4))
    data = values.astype(np.float32).tobytes()
    content["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
    binary.extend(data)
    content["buffers"][0]["byteLength"] = len(binary)
    kind = next(kind for kind, columns in _COLUMNS.items() if columns == values.shape[1])
    view = len(content["bufferViews"]) - 1
    content["accessors"].append({"bufferView": view, "componentType": _FLOAT, "count": len(values), "type": kind})
    return len(content["accessors"]) - 1
