"""summary.json: metrics, counts, timings and outputs of a run, the same octets for the same numbers."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def summary_document(
    *,
    metrics: Mapping[str, Any],
    counts: Mapping[str, Any],
    timing: Mapping[str, float],
    outputs: Mapping[str, str],
) -> dict[str, Any]:
    """The summary of a run.

    `metrics` by name, nan where there is no truth; `counts` are scans, points, tracks, confirmed and
    "warnings" by code; `timing` is CPU time ("decode_ms_per_scan", "total_s"); `outputs` are paths.
    """
    return {"metrics": dict(metrics), "counts": dict(counts), "timing": dict(timing), "outputs": dict(outputs)}


def json_octets(document: Mapping[str, Any]) -> bytes:
    """The document as JSON with sorted keys and shortest exact floats; null where a number is not finite."""
    return (json.dumps(_plain(document), sort_keys=True, indent=2, allow_nan=False) + "\n").encode()


def write_summary(path: Path, summary: Mapping[str, Any]) -> None:
    """Write the document to PATH.partial and give it its name."""
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(json_octets(summary))
    os.replace(partial, path)


def _plain(value: Any) -> Any:
    """The value with plain Python numbers, which JSON knows."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(item) for item in value]
    number = value.item() if hasattr(value, "item") else value
    return None if isinstance(number, float) and not math.isfinite(number) else number
