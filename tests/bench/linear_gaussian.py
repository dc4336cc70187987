"""Linear-Gaussian scenes: point objects that come and go in a box, clutter, missed detections.

The same statistics for every seed: half of the objects from the start, the others within the first fifth;
a constant-velocity walk; position measurements; uniform clutter.
"""

from __future__ import annotations

from typing import Any

import numpy as np

DT_S, N_SCANS, Q, SIGMA_M, P_D, P_S, HALF_M = 1.0, 100, 0.05, 10.0, 0.9, 0.99, 1000.0


def scene(*, n_targets: int, clutter_per_scan: int, seed: int) -> dict[str, Any]:
    """A scene as a document: meta, truth (states [x, vx, y, vy] from scan k0 on), scans with detections."""
    rng = np.random.default_rng(seed)
    F = np.kron(np.eye(2), [[1, DT_S], [0, 1]])
    L = np.linalg.cholesky(Q * np.array([[DT_S**3 / 3, DT_S**2 / 2], [DT_S**2 / 2, DT_S]]))
    truth = []
    for i in range(n_targets):
        k0 = 0 if rng.uniform() < 0.5 else int(rng.integers(0, N_SCANS // 5))
        speed, course = rng.uniform(2, 8), rng.uniform(0, 2 * np.pi)
        at = rng.uniform(-HALF_M, HALF_M, 2)
        x = np.array([at[0], speed * np.cos(course), at[1], speed * np.sin(course)])
        states = [x]
        while len(states) < N_SCANS - k0:
            x = F @ x + np.concatenate([L @ rng.normal(size=2), L @ rng.normal(size=2)])
            if np.abs(x[[0, 2]]).max() > HALF_M or (len(states) > 0.75 * N_SCANS and rng.uniform() > P_S):
                break
            states.append(x)
        truth.append({"id": i, "k0": k0, "states": [s.tolist() for s in states]})
    scans = []
    for k in range(N_SCANS):
        z = [
            np.array(t["states"][k - t["k0"]])[[0, 2]] + rng.normal(0, SIGMA_M, 2)
            for t in truth
            if 0 <= k - t["k0"] < len(t["states"]) and rng.uniform() < P_D
        ]
        clutter = rng.uniform(-HALF_M, HALF_M, (rng.poisson(clutter_per_scan), 2))
        both = np.concatenate([np.reshape(z, (-1, 2)), clutter])
        scans.append({"k": k, "t": k * DT_S, "detections": rng.permutation(both).tolist()})
    density = clutter_per_scan / (2 * HALF_M) ** 2
    meta = {"n_targets": n_targets, "clutter_per_scan": clutter_per_scan, "seed": seed, "q": Q, "sigma_z": SIGMA_M,
            "p_d": P_D, "p_s": P_S, "clutter_density": density, "dt": DT_S, "n_scans": N_SCANS,
            "region": [[-HALF_M, HALF_M], [-HALF_M, HALF_M]]}  # fmt: skip
    return {"meta": meta, "truth": truth, "scans": scans}
