"""`maritrack tune`: studies over grids of settings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from . import options as opt
from . import render, tunepage

HELP = """Which settings are best: grids over the clustering or over any keys of a preset.

Examples:

    maritrack tune clustering far.cat240 --truth far.truth.json -o study

    maritrack tune tracker far.cat240 --truth far.truth.json --grid model.p_detect=0.7,0.8,0.9
"""
CLUSTERING = """DBSCAN over a grid of eps and min_points, polar and Cartesian, against labelled points.

Each pair is judged by the adjusted Rand index and by the difference between the numbers of clusters and of objects,
means over scans. Labels are those of the simulator's cells (REC.labels.parquet, beside the recording or as --truth);
else points within the hulls of the true objects (AIS, GNSS) are theirs, and all others are unknown. Chosen is the pair
with the smallest count difference among those within 0.01 of the highest index. -o writes clustering.png and .csv.

Examples:

    maritrack tune clustering far.cat240 --truth far.truth.json -o study

    maritrack tune clustering near.cat240 far.cat240 --eps 20:95:5 --min-points 1:8 --workers 2

    maritrack tune clustering rec.cat240 --truth ais.csv --own-ship ais.csv --limit 60 --json
"""
TRACKER = """Trackers over a grid of settings, judged by the mean of a metric over all scans.

Several recordings weigh the same. A combination that fails is a row with its error. -o writes tracker.csv, and
tracker.png where the grid has one or two keys. The answer is the same for any number of workers.

Examples:

    maritrack tune tracker far.cat240 --grid model.p_detect=0.7,0.8,0.9 --grid tracker.delete_misses=4,6 -o study

    maritrack tune tracker a_detections.json b_detections.json --grid input.latency_s=0:2:0.25 --moving

    maritrack tune tracker harbour.cat240 --tracker jipda,ipda,sprt --by ospa --workers 2 -o study
"""

app = typer.Typer(help=HELP, no_args_is_help=True)

Recordings = Annotated[list[Path], typer.Argument(help="Recordings.", show_default=False)]
Truths = Annotated[
    list[Path] | None, opt.given("--truth", "Truth, one for each recording; by default what lies beside it.")
]
OwnShips = Annotated[
    list[Path] | None, opt.given("--own-ship", "AIS (CSV) of the ship that carries the radar, one for each recording.")
]
Workers = Annotated[int, opt.given("--workers", "Processes.")]
Folder = Annotated[Path | None, opt.output("--out", "-o", "Folder for the picture and the table.")]


@app.command(help=CLUSTERING)
def clustering(
    recordings: Recordings,
    truth: Truths = None,
    truth_match: opt.TruthMatch = "",
    own_ship: OwnShips = None,
    eps: Annotated[str, opt.method("--eps", "Metres: FROM:TO:STEP or A,B,C.")] = "20:95:5",
    min_points: Annotated[str, opt.method("--min-points", "FROM:TO or A,B,C.")] = "1:8",
    noise: Annotated[
        str, opt.method("--noise", "Points of noise are each for themselves (single), or one more cluster (class).")
    ] = "single",
    positions: Annotated[bool, opt.given("--positions", "Labels by positions even so.")] = False,
    margin: Annotated[float, opt.given("--margin", "Metres by which hulls are grown.")] = 20.0,
    radius: Annotated[float, opt.given("--radius", "Metres about an object of unknown size.")] = 50.0,
    moving: Annotated[bool, opt.given("--moving", "By positions: only objects under way.")] = False,
    preset: opt.Preset = "",
    config: opt.ConfigFile = None,
    sets: opt.Sets = None,
    limit: opt.Limit = None,
    workers: Workers = 1,
    out: Folder = None,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:  # fmt: skip
    """Parse, study, render."""
    from maritrack.errors import UsageError
    from maritrack.tune import clustering as study
    from maritrack.tune.grids import parse_counts, parse_numbers
    from maritrack.tune.subjects import subjects as all_subjects

    opt.check_workers(workers)
    if margin < 0 or radius <= 0:
        raise UsageError("--margin starts at 0, --radius above 0")
    eps_m, least = parse_numbers(eps, name="--eps"), parse_counts(min_points, name="--min-points")
    if eps_m[0] <= 0:
        raise UsageError(f"--eps {eps}: greater than 0")
    if noise not in study.NOISES:
        raise UsageError(f"--noise {noise}: one of {', '.join(study.NOISES)}")
    subjects = all_subjects(recordings, truth=truth or (), own_ship=own_ship or (), positions=positions)
    settings = _config(recordings[0], preset, config, sets, limit, truth_match)
    found = []
    for subject in subjects:
        with render.steps(f"{subject.path.name}: scan", quiet=quiet) as tick:
            found.append(
                study.study(
                    subject, settings, eps_m=eps_m, min_points=least, noise=noise, margin_m=margin, radius_m=radius,
                    moving_only=moving, workers=workers, tick=tick,
                )
            )  # fmt: skip
    document = study.document(study.mean(found), recordings=[str(path) for path in recordings], noise=noise)
    for domain in study.at_edge(document):
        render.note(
            f"note: {domain}: the chosen pair is at the edge of the grid, a better one may lie beyond", quiet=quiet
        )
    if out is not None:
        from maritrack.tune.pictures import draw_clustering, write_csv

        draw_clustering(out / "clustering.png", study.mean(found), title=", ".join(p.name for p in recordings))
        write_csv(out / "clustering.csv", document["grid"])
        document["outputs"] = {"png": str(out / "clustering.png"), "csv": str(out / "clustering.csv")}
    render.emit_json(document) if json_ else tunepage.clustering(document)


@app.command(help=TRACKER)
def tracker(
    recordings: Recordings,
    truth: Truths = None,
    truth_match: opt.TruthMatch = "",
    own_ship: OwnShips = None,
    grid: Annotated[list[str] | None, opt.method("--grid", "KEY=V1,V2,... or KEY=FROM:TO:STEP.")] = None,
    trackers: Annotated[str, opt.method("--tracker", "-t", "Trackers, with commas; by default the preset's.")] = "",
    by: Annotated[str, opt.method("--by", "Metric: gospa, ospa, gospa_false, switches, ...")] = "gospa",
    moving: Annotated[bool, opt.method("--moving", "Score moving tracks only.")] = False,
    preset: opt.Preset = "",
    config: opt.ConfigFile = None,
    sets: opt.Sets = None,
    seed: opt.Seed = None,
    limit: opt.Limit = None,
    workers: Workers = 1,
    out: Folder = None,
    json_: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Parse, study, render."""
    from maritrack.errors import UsageError
    from maritrack.recording import default_preset
    from maritrack.tune import tracking as study
    from maritrack.tune.grids import parse_axis

    names = tuple(name.strip() for name in trackers.split(",") if name.strip())
    parsed = [*([(study.TRACKER, names)] if names else []), *map(parse_axis, grid or ())]
    axes = dict(parsed)
    opt.check_workers(workers)
    if not axes or len(axes) < len(parsed) or len(set(names)) < len(names):
        raise UsageError("--grid or --tracker says what to try, each key and tracker once")
    subjects = study.subjects(recordings, truth=truth or (), own_ship=own_ship or ())
    given: dict[str, Any] = {"input": {"limit": limit}} if limit is not None else {}
    given |= opt.scored(moving, truth_match) | ({"seed": seed} if seed is not None else {})
    chosen = preset or default_preset([subject.kind for subject in subjects])
    combinations = study.configurations(axes, preset=chosen, file=config, sets=sets or (), over=given)
    with render.steps("runs", quiet=quiet) as tick:
        rows = study.study(subjects, combinations, by=by, workers=workers, tick=tick)
    document = study.document(rows, axes, by=by, recordings=[str(path) for path in recordings], preset=chosen)
    if out is not None:
        from maritrack.tune.pictures import draw_tracking, write_csv

        write_csv(out / "tracker.csv", study.table(rows))
        document["outputs"] = {"csv": str(out / "tracker.csv")}
        title = f"mean {by}: {', '.join(path.name for path in recordings)}"
        if draw_tracking(out / "tracker.png", rows, axes, by=by, title=title):
            document["outputs"]["png"] = str(out / "tracker.png")
        else:
            render.note("note: a picture is drawn of one or two keys", quiet=quiet)
    render.emit_json(document) if json_ else tunepage.tracking(document)


def _config(
    first: Path, preset: str, config: Path | None, sets: list[str] | None, limit: int | None, match: str
) -> Any:
    """The configuration that says where points are detected."""
    from maritrack.config import load_config
    from maritrack.recording import default_preset, kinds_of, open_inputs

    over = ({"input": {"limit": limit}} if limit is not None else {}) | opt.scored(False, match)
    chosen = preset or default_preset(kinds_of(open_inputs([first])))
    return load_config(preset=chosen, file=config, sets=sets or (), over=over)
