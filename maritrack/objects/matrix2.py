"""Stacks of symmetric 2 x 2 matrices in closed form: what every filter here spends its time on."""

from __future__ import annotations

import numpy as np

from maritrack.types import FloatArray


def det(m: FloatArray) -> FloatArray:
    """Determinants (n,) of (n, 2, 2)."""
    return np.asarray(m[:, 0, 0] * m[:, 1, 1] - m[:, 0, 1] * m[:, 1, 0])


def inverse(m: FloatArray) -> FloatArray:
    """Inverses (n, 2, 2) of regular (n, 2, 2)."""
    out = np.empty_like(m)
    out[:, 0, 0], out[:, 1, 1] = m[:, 1, 1], m[:, 0, 0]
    out[:, 0, 1], out[:, 1, 0] = -m[:, 0, 1], -m[:, 1, 0]
    return np.asarray(out / det(m)[:, None, None])


def root(m: FloatArray) -> FloatArray:
    """Symmetric square roots (n, 2, 2) of positive definite (n, 2, 2): (M + sqrt(det) I) / sqrt(tr + 2 sqrt(det))."""
    s = np.sqrt(np.maximum(det(m), 0.0))
    t = np.sqrt(m[:, 0, 0] + m[:, 1, 1] + 2.0 * s)
    out = m.copy()
    out[:, 0, 0] += s
    out[:, 1, 1] += s
    return np.asarray(out / t[:, None, None])


def form(inv: FloatArray, v: FloatArray) -> FloatArray:
    """Quadratic forms v' inv v (n,)."""
    return np.asarray(
        inv[:, 0, 0] * v[:, 0] ** 2 + (inv[:, 0, 1] + inv[:, 1, 0]) * v[:, 0] * v[:, 1] + inv[:, 1, 1] * v[:, 1] ** 2
    )


def trace_product(a: FloatArray, b: FloatArray) -> FloatArray:
    """tr(A B) (n,)."""
    return np.asarray(
        a[:, 0, 0] * b[:, 0, 0] + a[:, 0, 1] * b[:, 1, 0] + a[:, 1, 0] * b[:, 0, 1] + a[:, 1, 1] * b[:, 1, 1]
    )


def eigen(m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (n, 2), the larger first, and its unit vectors (n, 2) of symmetric (n, 2, 2)."""
    mean, half = (m[:, 0, 0] + m[:, 1, 1]) / 2, (m[:, 0, 0] - m[:, 1, 1]) / 2
    spread = np.hypot(half, m[:, 0, 1])
    angle = 0.5 * np.arctan2(m[:, 0, 1], half)
    return np.stack([mean + spread, mean - spread], 1), np.stack([np.cos(angle), np.sin(angle)], 1)


def clip_eigenvalues(m: FloatArray, least: float, most: float) -> FloatArray:
    """The same axes (n, 2, 2) with eigenvalues held within [least, most]."""
    values, major = eigen(m)
    values = np.clip(values, least, most)
    outer = major[:, :, None] * major[:, None, :]
    return np.asarray(values[:, 1, None, None] * np.eye(2) + (values[:, 0] - values[:, 1])[:, None, None] * outer)
