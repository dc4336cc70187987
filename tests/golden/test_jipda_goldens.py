"""Association probabilities of independent implementations (brute force, EHM2)."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from maritrack.associate import joint_marginals
from maritrack.types import FloatArray
from tests.shared import shared

GOLDEN = 1e-9


def cases() -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(shared("vectors/jipda_golden.json").read_text())["cases"]
    return found


def arguments(case: dict[str, Any], existence: FloatArray) -> dict[str, Any]:
    shape = case["n_tracks"], case["n_meas"]
    return {
        "likelihood": np.array(case["N"], dtype=float).reshape(shape),
        "valid": np.array(case["validation"]).reshape(shape),
        "p_detect": case["P_D"],
        "p_gate": case["P_G"],
        "clutter_density": case["lambda"],
        "existence": existence,
    }


def test_jpda_equals_the_goldens() -> None:
    for case in cases():
        ours = joint_marginals(**arguments(case, np.ones(case["n_tracks"])))
        assert_allclose(ours.beta, case["jpda"]["beta"], atol=GOLDEN, err_msg=case["name"])
        assert ours.exact


@pytest.mark.parametrize(
    ("field", "key"),
    [("beta", "beta"), ("existence", "r_post"), ("beta_given_existence", "beta_given_existence")],
)
def test_jipda_equals_the_goldens(field: str, key: str) -> None:
    for case in cases():
        ours = joint_marginals(**arguments(case, np.array(case["r_pred"])))
        assert_allclose(getattr(ours, field), case["jipda"][key], atol=GOLDEN, err_msg=case["name"])


def test_belief_propagation_stays_near_the_goldens() -> None:
    for case in cases():
        ours = joint_marginals(**arguments(case, np.array(case["r_pred"])), exact_limit=0)
        assert_allclose(ours.existence, case["jipda"]["r_post"], atol=0.05, err_msg=case["name"])
