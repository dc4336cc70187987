"""The experiments of the papers, run again: tables beside theirs, figures, and which of their statements hold."""

from __future__ import annotations

from collections.abc import Callable

from maritrack.errors import InputError, UsageError
from maritrack.fanout import Tick
from maritrack.reproduce.claims import Plan, Report

Experiment = Callable[[Plan, Tick | None], Report]


def _polar(plan: Plan, tick: Tick | None) -> Report:
    from maritrack.reproduce.polar import reproduce

    return reproduce(plan, tick)


def _abs(plan: Plan, tick: Tick | None) -> Report:
    from maritrack.reproduce.abs import reproduce

    return reproduce(plan, tick)


def _engm(plan: Plan, tick: Tick | None) -> Report:
    from maritrack.reproduce.engm import reproduce

    return reproduce(plan, tick)


def _extended(plan: Plan, tick: Tick | None) -> Report:
    from maritrack.reproduce.extended import reproduce

    return reproduce(plan, tick)


def _dataset(plan: Plan, tick: Tick | None) -> Report:
    from maritrack.reproduce.dataset import reproduce

    return reproduce(plan, tick)


REPRODUCTIONS: dict[str, Experiment] = {  # by key of the paper; each imports what it needs when it is called
    "polar": _polar,
    "abs": _abs,
    "engm": _engm,
    "extended": _extended,
    "dataset": _dataset,
}


def reproduce(paper: str, plan: Plan, *, tick: Tick | None = None) -> Report:
    """Run the experiment of a paper once more. Figures are drawn only where the plan has a folder for them."""
    if paper not in REPRODUCTIONS:
        raise UsageError(f"no experiment of a paper '{paper}'", hint="papers: " + ", ".join(REPRODUCTIONS))
    if plan.out is not None:
        try:
            plan.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{plan.out}: {error.strerror or error}") from None
    return REPRODUCTIONS[paper](plan, tick)
