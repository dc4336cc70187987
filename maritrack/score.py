"""Metrics of an archived run once more: against other truth, or with other settings of the metrics."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from maritrack.chain import Chain, build_chain, reported
from maritrack.errors import UsageError
from maritrack.io.archive import Archive, ArchivedScan, iter_results, read_archive
from maritrack.io.documents import read_document
from maritrack.io.reference import Reference, only
from maritrack.io.truth import read_reference
from maritrack.metrics.background import background_scores
from maritrack.metrics.scores import ScoreSums, add, hold, means, score_frame, summary_objects
from maritrack.recording import open_recording
from maritrack.replay import archived_config, archived_job
from maritrack.run import with_truth
from maritrack.settings import Config, ScoreConfig, parse_ids
from maritrack.types import Damage, Frame, Truth

TRUTH_SETTINGS = (
    "max_gap_moving_s",
    "max_gap_rest_s",
    "truth_max_m",
    "truth_lag_s",
    "truth_match",
)  # they change the truth itself


@dataclass(frozen=True, slots=True)
class Limit:
    """A metric that must not be greater than a limit."""

    metric: str
    limit: float
    value: float

    @property
    def exceeded(self) -> bool:
        return self.value > self.limit


def score(
    path: Path, *, truth: Path | None = None, sets: Sequence[str] = (), moving: bool = False, lags: Sequence[str] = ()
) -> tuple[dict[str, Any], tuple[Damage, ...]]:
    """`metrics` and `objects` as in summary.json, `score` (the settings), `scans`; and damage of the archive.

    The archived tracks against the archived truth, or against the document `truth`. `sets` are of score.*,
    `lags` are "ID=SECONDS".
    """
    archive = read_archive(path)
    config = _config(archive, sets, moving=moving, lags=lags)
    reference = _reference(archive, truth, config)
    carries = reference is None and archived_config(archive).score.box_margin_m == config.score.box_margin_m
    damage: list[Damage] = []
    sums, n_scans = ScoreSums(), 0
    for scan in iter_results(path, on_damage=damage.append):
        unexplained = "gospa_unexplained" in scan.scores if reference is None else not reference.complete
        chain = build_chain(config, unexplained=unexplained)
        sums = _add(sums, scan, _truth(scan, reference, chain), chain, carries=carries)
        n_scans += 1
    document = {
        "metrics": means(sums), "objects": summary_objects(sums), "score": asdict(config.score), "scans": n_scans,
    }  # fmt: skip
    return document, tuple(damage)


def parse_limits(texts: Sequence[str]) -> dict[str, float]:
    """`gospa.mean=5` or `gospa=5` as {"gospa": 5.0}."""
    limits = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            limits[name.strip().removesuffix(".mean")] = float(value)
        except ValueError:
            raise UsageError(f"--fail-over {text}: write METRIC=NUMBER, as in gospa=5") from None
    return limits


def check(metrics: Mapping[str, float], limits: Mapping[str, float]) -> list[Limit]:
    """The metrics beside their limits. UsageError where there is no such metric, or no truth to tell it."""
    rows = []
    for name, limit in limits.items():
        if name not in metrics:
            raise UsageError(f"no metric '{name}'", hint="metrics: " + ", ".join(sorted(metrics)))
        if math.isnan(metrics[name]):
            raise UsageError(f"no {name}: the run has no truth", hint="pass it with --truth")
        rows.append(Limit(name, limit, metrics[name]))
    return rows


def _config(archive: Archive, sets: Sequence[str], *, moving: bool, lags: Sequence[str]) -> Config:
    """The archived configuration with other settings of the metrics."""
    for assignment in sets:
        if not assignment.strip().startswith("score."):
            raise UsageError(f"--set {assignment}: only score.* can change without running again", hint="use replay")
    config = archived_config(archive, sets=sets)
    told = [lag for lag in (config.score.truth_lag_s, *lags) if lag]
    changed = replace(
        config.score, moving_only=moving or config.score.moving_only, truth_lag_s=",".join(told)
    )  # fmt: skip
    return replace(config, score=changed)


def _reference(archive: Archive, truth: Path | None, config: Config) -> Reference | None:
    """Reports to take truth from; None = the archived truth of each scan is what is asked for."""
    told: Any = {"origin": archive.manifest.origin, "date": config.input.date, "rwmr": config.rwmr}
    chosen = parse_ids(config.score.truth_match)
    if truth is not None:
        return only(read_reference(read_document(truth), name=str(truth), **told), chosen)
    if _same_truth(archived_config(archive).score, config.score):
        return None
    if "truth" in archive.side:
        return only(read_reference(archive.side["truth"], name="truth", **told), chosen)
    job = archived_job(archive).job  # the recording itself may tell the truth
    reference = open_recording(job.octets, job.kinds, job.side, config).reference
    if reference is None:
        raise UsageError(f"{archive.path}: the run has no truth", hint="pass it with --truth")
    return reference


def _same_truth(a: ScoreConfig, b: ScoreConfig) -> bool:
    return all(getattr(a, name) == getattr(b, name) for name in TRUTH_SETTINGS)


def _truth(scan: ArchivedScan, reference: Reference | None, chain: Chain) -> Truth | None:
    if reference is None:
        return scan.truth
    return next(with_truth([Frame(scan.k, scan.scan)], reference, chain)).truth


def _add(sums: ScoreSums, scan: ArchivedScan, truth: Truth | None, chain: Chain, *, carries: bool) -> ScoreSums:
    """Sums with one more scan, as the run itself makes them.

    Where its points are not archived, what they scored is as archived, if the truth and its boxes are (`carries`).
    """
    settings, tracks = chain.config.score, scan.tracks
    which = reported(tracks, chain.config)
    scores = score_frame(
        truth, tracks, c_m=settings.c_m, p=settings.p, which=which, unexplained=chain.unexplained,
        velocity=settings.velocity, bow_share=settings.bow_share,
    )  # fmt: skip
    if scan.points is not None and scan.keep is not None and chain.config.subtract.method != "none":
        scores |= background_scores(scan.points, scan.keep, truth, margin_m=settings.box_margin_m)
    elif carries:
        scores |= {name: scan.scores[name] for name in ("fpr", "npv") if name in scan.scores}
    return hold(add(sums, scores), truth, tracks, which=which, hold_m=settings.hold_m)
