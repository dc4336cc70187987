"""OSPA, GOSPA and T-GOSPA of independent implementations."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.testing import assert_allclose

from maritrack.metrics import gospa, ospa, t_gospa
from maritrack.types import FloatArray
from tests.shared import shared

GOLDEN = 1e-9


def cases(metric: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(shared("vectors/metric_golden.json").read_text())[metric]
    return found


def trajectories(rows: list[list[list[float] | None]], n_times: int) -> FloatArray:
    gone = [np.nan, np.nan]
    return np.array([[state or gone for state in row] for row in rows]).reshape(len(rows), n_times, 2)


def test_ospa_equals_the_goldens() -> None:
    for case in cases("ospa"):
        ours = ospa(case["X"], case["Y"], c=case["c"], p=case["p"])
        expected = (case["value"], case["localisation"], case["cardinality"])
        assert_allclose((ours.total, ours.localisation, ours.cardinality), expected, atol=GOLDEN)


def test_gospa_equals_the_goldens() -> None:
    for case in cases("gospa"):
        ours = gospa(case["X"], case["Y"], c=case["c"], p=case["p"], alpha=case["alpha"])
        assert_allclose(ours.total, case["distance"], atol=GOLDEN)
        for part in ("localisation_p", "n_missed", "n_false", "missed_p", "false_p"):
            assert_allclose(getattr(ours, part), case[part], atol=GOLDEN, err_msg=part)


def test_t_gospa_equals_the_goldens() -> None:
    for case in cases("tgospa"):
        X, Y = (trajectories(case[name], case["T"]) for name in "XY")
        ours = t_gospa(X, Y, c=case["c"], p=case["p"], gamma=case["gamma"], rho=case["rho"])
        assert_allclose(ours.total, case["value"], atol=GOLDEN, err_msg=case["name"])
        for part in ("localisation_p", "missed_p", "false_p", "switch_p"):
            if case["decomposition_unique"]:
                assert_allclose(getattr(ours, part), case[part], atol=GOLDEN, err_msg=f"{case['name']}: {part}")
