"""What a run has to say of itself at its end: what was set or given, and came to nothing."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from maritrack.chain import Chain, ChainState
from maritrack.detect.background import Background
from maritrack.types import BoolArray, Damage


def remarks(
    chain: Chain, state: ChainState, *, sensors: Collection[str], calibrated: Sequence[str]
) -> tuple[Damage, ...]:
    """All of them. `sensors` are those of the run, `calibrated` those that a calibration names."""
    return (
        *untracked(chain, state),
        *unused_background(chain, state),
        *unused_calibration([name for name in calibrated if name not in sensors], sensors),
    )


def untracked(chain: Chain, state: ChainState) -> tuple[Damage, ...]:
    """Each sensor whose scans never went to the tracker, as its background did not converge."""
    rules = chain.config.subtract
    if rules.method == "none" or rules.track_from != "converged":
        return ()
    knob = next((name for name in ("half_life_s", "half_life_scans") if getattr(rules, name)), "learning_rate")
    return tuple(
        Damage(
            "tracking-not-started", -1,
            f"tracking never started{f' for {name!r}' if name else ''}: its background did not converge within "
            f'{model.scans} scans; subtract.track_from = "start" does not wait, a smaller subtract.{knob} waits less',
            name,
        )
        for name, model in sorted(state.background.items())
        if not model.converged and model is not chain.background.get(name)
    )  # fmt: skip


def unused_background(chain: Chain, state: ChainState) -> tuple[Damage, ...]:
    """Each background known before the run that served no scan, or in whose pixels no scan has looked."""
    own = ", ".join(repr(name) for name, m in sorted(state.background.items()) if m is not chain.background.get(name))
    found = []
    for name, known in sorted(chain.background.items()):
        model = state.background.get(name, known)
        if model is known:
            text = f"the background of {name!r} was of no use: those of this run are of {own or 'no sensor'}"
            found.append(Damage("background-unused", -1, text, name))
        elif model.now > known.now and not looked_at(known, model).any():
            text = f"the background of {name!r} was of no use: no scan looked at one of its {len(known)} pixels"
            found.append(Damage("background-elsewhere", -1, text, name))
    return tuple(found)


def looked_at(before: Background, after: Background) -> BoolArray:
    """Which pixels of a model have been looked at since: their own time went on."""
    _, old, new = np.intersect1d(before.key, after.key, assume_unique=True, return_indices=True)
    passed = after.now - before.now
    looked = np.zeros(len(before), bool)
    looked[old] = after.late[new] - before.late[old] < passed * (1.0 - 1e-6)
    return looked


def unused_calibration(names: Sequence[str], sensors: Collection[str]) -> tuple[Damage, ...]:
    """Each sensor that a calibration names and the run has not."""
    own = ", ".join(map(repr, sorted(sensors)))
    return tuple(
        Damage("calibration-unused", -1, f"the calibration of {name!r} was of no use: this run is of {own}", name)
        for name in names
    )
