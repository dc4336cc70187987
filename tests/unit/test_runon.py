"""Segments that are run on until the next tells the same: a joined run is that of one piece, ids included."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maritrack.chain import Chain, ChainState, build_chain, process
from maritrack.diff import diff
from maritrack.errors import InputError
from maritrack.io.archive import Stored, iter_messages, iter_results
from maritrack.job import Job, execute
from maritrack.recording import open_inputs, open_recording
from maritrack.settings import Config
from maritrack.sinks.mcap import encode_result
from maritrack.sweep.batch import Cut, batch
from maritrack.sweep.handover import read_state, state_octets
from maritrack.sweep.plan import Run, Settings, plan
from maritrack.sweep.runon import AGREED, NEAR_EXISTENCE, NEAR_M, Keeper, alike
from maritrack.sweep.seams import Piece, seams
from maritrack.sweep.sources import named, opened
from maritrack.trackers import TRACKERS
from maritrack.types import CONFIRMED, Frame, Result
from tests import runs

SCANS, TURN_S, SHIPS, LAND = 480, 2.5, 8, 10
CUT = Cut(segment_s=400.0, overlap_s=50.0)
SETS = ("subtract.method='abs'", "subtract.pixel_m=60.0", "subtract.half_life_scans=20.0", "subtract.threshold=0",
        "subtract.decision='tail'", "subtract.tail_probability=0.3", "subtract.start='empty'",
        "subtract.spare='moving'", "tracker.stationary_s=30.0", "clutter_map.method='cells'",
        "clutter_map.memory_s=30.0", "output.archive='hash'")  # fmt: skip
TOLERANCES = {"position_m": 0.01, "existence": 0.01}


def document(scans: int = SCANS) -> str:
    """Slow and quick ships that go to and fro, echoes of land that flicker, and clutter."""
    rng = np.random.default_rng(5)
    at, course, v = (
        rng.uniform(-2500.0, 2500.0, (SHIPS, 2)),
        rng.uniform(0.0, 6.28, SHIPS),
        rng.uniform(4.0, 9.0, SHIPS),
    )
    land, often = 60.0 * rng.integers(-50, 50, (LAND, 2)) + 30.0, rng.uniform(0.6, 1.0, LAND)
    rows = []
    for k in range(scans):
        way = at + (k * TURN_S * v)[:, None] * np.stack([np.sin(course), np.cos(course)], axis=1)
        ships = np.abs((way + 3000.0) % 12000.0 - 6000.0) - 3000.0
        seen = [ships[rng.random(SHIPS) < 0.9], land[rng.random(LAND) < often], rng.uniform(-3500.0, 3500.0, (2, 2))]
        points = np.concatenate(seen)
        points += rng.normal(0.0, 8.0, points.shape)
        rows.append({"time_s": 1e9 + k * TURN_S, "points": points.round(2).tolist()})
    head = {"format": "maritrack-points/1", "frame": "enu"}
    return json.dumps(head | {"sensors": {"a": {"east_m": 0, "north_m": 0, "sigma_m": 10.0}}, "scans": rows})


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rec") / "sea.json"
    path.write_text(document())
    return path


def planned(path: Path, tracker: str = "jipda") -> list[Run]:
    settings = Settings(sets=(*SETS, f"tracker_name='{tracker}'"), over={})
    return plan(named([str(path)]), axes={}, seeds=(), settings=settings)


def in_one_piece(path: Path, folder: Path, tracker: str = "jipda") -> Path:
    (run,) = planned(path, tracker)
    assert run.config is not None
    with opened(run.source, seed=0) as found:
        execute(Job(octets=[found.octets], kinds=[found.kind], input_sha256=[run.input_sha256], side=found.side,
                    config=run.config, name="sea", out=folder, rrd=False))  # fmt: skip
    return folder / "run.mcap"


def joined(path: Path, folder: Path, cut: Cut = CUT, *, tracker: str = "jipda", workers: int = 1) -> Path:
    outcome = batch(planned(path, tracker), folder, cut, sizes={str(path): 1 << 30}, workers=workers)
    assert not outcome.failed
    (found,) = folder.glob("runs/*/run.mcap")
    return found


def told(archive: Path) -> dict[str, object]:
    segments: dict[str, object] = json.loads((archive.parent / "summary.json").read_text())["segments"]
    return segments


@pytest.fixture(scope="module")
def whole(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return in_one_piece(recording, tmp_path_factory.mktemp("whole"))


@pytest.fixture(scope="module")
def mended(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return joined(recording, tmp_path_factory.mktemp("mended"))


def apart(a: Path, b: Path) -> list[int]:
    """Scans in which the tracks of two runs differ, ids included."""
    scans = []
    for one, other in zip(iter_results(a), iter_results(b), strict=True):
        x, y = one.tracks, other.tracks
        same = np.array_equal(x.id, y.id) and np.array_equal(x.status, y.status) and all(
            np.allclose(getattr(x, name), getattr(y, name), rtol=0.0, atol=near) for name, near in TOLERANCES.items()
        )  # fmt: skip
        scans += [] if same else [one.k]
    return scans


def test_a_joined_run_is_that_of_one_piece(whole: Path, mended: Path) -> None:
    seams = told(mended)["seams"]
    assert isinstance(seams, list) and len(seams) == 2 and all(s["agreed"] for s in seams)
    assert all(AGREED <= s["run_on"] < SCANS // 3 for s in seams) and told(mended)["run_again"] == 0
    assert len(apart(whole, mended)) <= SCANS // 200  # the backgrounds are still a little different
    assert sum(int((s.tracks.status >= CONFIRMED).sum()) for s in iter_results(whole)) > SHIPS * SCANS
    ours, theirs = (json.loads(path.with_name("summary.json").read_text()) for path in (mended, whole))
    for name in ("tracks", "confirmed", "moving", "track_ids_confirmed", "clusters"):
        assert ours["counts"][name] == pytest.approx(theirs["counts"][name], rel=1e-3)
    assert ours["counts"]["points"] == theirs["counts"]["points"]


def test_where_running_on_ends_too_early_it_is_not(recording: Path, whole: Path, tmp_path: Path) -> None:
    short = joined(recording, tmp_path / "short", replace(CUT, run_on_s=25.0))
    seams = told(short)["seams"]
    assert isinstance(seams, list) and [(s["run_on"], s["agreed"]) for s in seams] == [(10, False)] * 2
    differing = apart(whole, short)
    assert len(differing) > SCANS // 10 and min(differing) >= SCANS // 3 + 10


def test_up_to_the_seam_it_is_so_to_the_octet(whole: Path, mended: Path) -> None:
    seams = told(mended)["seams"]
    assert isinstance(seams, list)
    first = seams[0]["scan"]
    ours, theirs = ([m for m in iter_messages(path, {"/tracks", "/clusters", "/scores", "/log"}) if m.k < first]
                    for path in (mended, whole))  # fmt: skip
    assert first > SCANS // 3 and [(m.topic, m.k, m.data) for m in ours] == [(m.topic, m.k, m.data) for m in theirs]


def test_where_two_never_tell_the_same_all_is_run_again(tmp_path: Path) -> None:
    """Particles are drawn by the number of the scan in the run, so that those of a segment are others."""
    path = tmp_path / "sea.json"
    path.write_text(document(60))
    found = joined(path, tmp_path / "out", Cut(segment_s=50.0, overlap_s=12.5), tracker="smc-phd")
    assert told(found)["seams"] == [] and told(found)["run_again"] == 2
    assert diff(in_one_piece(path, tmp_path / "one", "smc-phd"), found, only="tracks").parts["tracks"].n == 0


def frames(path: Path, config: Config) -> Iterator[Frame]:
    (octets,) = open_inputs([path])
    return open_recording([octets], ["points"], {}, config).frames


def results(chain: Chain, state: ChainState, some: list[Frame]) -> tuple[ChainState, list[Result]]:
    found = []
    for frame in some:
        state, result = process(chain, state, frame)
        found.append(result)
    return state, found


@pytest.mark.parametrize("tracker", sorted(set(TRACKERS) - {"gp-pmbm"}))
def test_a_run_goes_on_from_its_memory_as_if_nothing_had_been(tracker: str, recording: Path) -> None:
    (run,) = planned(recording, tracker)
    assert run.config is not None
    some = list(frames(recording, replace(run.config, input=replace(run.config.input, limit=30))))
    chain = build_chain(run.config)
    state, _ = results(chain, chain.init(), some[:20])
    octets = state_octets(state)
    again = read_state(octets, chain, name="memory")
    assert state_octets(again) == octets
    for ours, theirs in zip(*(results(chain, s, some[20:])[1] for s in (again, state)), strict=True):
        assert encode_result(ours) == encode_result(theirs) and len(ours.tracks) > 5


def test_what_is_no_memory_of_this_tracker_is_refused(recording: Path) -> None:
    (jipda,), (engm,) = planned(recording), planned(recording, "engm-phd")
    assert jipda.config is not None and engm.config is not None
    chain, other = build_chain(jipda.config), build_chain(engm.config)
    octets = state_octets(chain.init())
    locked = bytearray(octets)  # the flags of its first file say that it is encrypted
    locked[6] |= 1
    locked[octets.index(b"PK\x01\x02") + 8] |= 1
    wrong = (octets[:-40], b"", bytes(locked))
    for data, reader in ((octets, other), (b"PK\x03\x04" + octets, other), *((data, chain) for data in wrong)):
        with pytest.raises(InputError, match="no memory of a run with this tracker"):
            read_state(data, reader, name="memory")


@pytest.mark.parametrize("tracker", ["jipda", "jpda"])
def test_what_does_not_count_is_not_scored_but_truth_that_a_tracker_starts_from_is_told(
    tracker: str, recording: Path
) -> None:
    (run,) = planned(recording, tracker)
    assert run.config is not None
    chain, keeper = build_chain(run.config), Keeper(begin=2)
    some = [replace(frame, truth=runs.truth(frame.t_ns, np.random.default_rng(0)))
            for frame, _ in zip(frames(recording, run.config), range(4), strict=False)]  # fmt: skip
    found = [keeper.step(chain, chain.init(), frame)[1].frame.truth is not None for frame in some]
    assert found == [tracker == "jpda"] * 2 + [True] * 2 and keeper.end == 4


def test_what_tells_the_same() -> None:
    a = runs.tracks(0, np.random.default_rng(1), 6)
    order = np.array([3, 1, 0, 5, 4, 2])
    other = {name: getattr(a, name)[order] for name in ("position_m", "status", "moving", "existence")}
    assert alike(a, replace(a, **other)) and alike(a, replace(a, id=a.id + 100))
    assert not alike(a, replace(a, position_m=a.position_m + 2.0 * NEAR_M))
    assert alike(a, replace(a, position_m=a.position_m + 0.5 * NEAR_M))
    assert not alike(a, replace(a, existence=a.existence + 2.0 * NEAR_EXISTENCE))
    assert not alike(a, replace(a, moving=~a.moving)) and not alike(a, replace(a, status=a.status + 1))
    assert not alike(a, runs.tracks(0, np.random.default_rng(1), 5))
    twins = replace(a, position_m=np.concatenate([a.position_m[:1], a.position_m[:5]]))
    assert not alike(twins, a)


def test_clusters_that_differ_are_not_the_same_though_the_tracks_are(recording: Path) -> None:
    (run,) = planned(recording)
    assert run.config is not None
    chain = build_chain(run.config)
    some = [frame for frame, _ in zip(frames(recording, run.config), range(5), strict=False)]
    stored = [[Stored(topic, r.frame.k, r.frame.t_ns, data, 0) for topic, data in encode_result(r)]
              for r in results(chain, chain.init(), some)[1]]  # fmt: skip
    for change, agreed in ((None, [1, 2, 3, 4, 5]), ("/clusters", [1, 2, 0, 1, 2]), ("/tracks", [1, 2, 0, 1, 2])):
        other = [list(parts) for parts in stored]
        other[2] = [one._replace(data=was.data) if one.topic == change else one
                    for one, was in zip(other[2], other[1], strict=False)]  # fmt: skip
        keeper = Keeper(other=iter(other))
        assert [(keeper.step(chain, chain.init(), frame), keeper.agreed)[1] for frame in some] == agreed


def test_ids_go_on_from_all_that_were_given(tmp_path: Path) -> None:
    """Also where those who had them ended before, in a piece that another one goes on from."""
    a, on, b = (tmp_path / name for name in ("a", "on", "b"))
    write(a, {0: [1, 2], 1: [1, 2, 9], 2: [1, 2]})
    write(on, {3: [1, 2], 4: [1, 2]})
    write(b, {2: [3, 4], 3: [3, 4], 4: [3, 4], 5: [3, 4], 6: [3, 4, 5]})
    found, names = seams([Piece(a, 0, 3, False), Piece(on, 3, 5, True), Piece(b, 5, 7, False)])
    assert [(s.scan, s.joined) for s in found] == [(5, 2)]
    assert [[own.of(i) for i in (1, 2)] for own in names[:2]] == [[1, 2]] * 2
    assert [names[2].of(i) for i in (3, 4, 5, 6)] == [1, 2, 10, 11]


def test_a_track_that_one_segment_alone_knew_keeps_its_number_over_the_next_seam(tmp_path: Path) -> None:
    a, b, c = (tmp_path / name for name in "abc")
    write(a, {0: [1, 2], 1: [1, 2]})
    write(b, {1: [3, 4, 5, 6], 2: [3, 4, 5, 6], 3: [3, 4, 5, 6]})  # 5 and 6 are not known before
    write(c, {3: [1, 2, 7, 8], 4: [1, 2, 7, 8], 5: [1, 2, 7, 8, 9]})
    _, names = seams([Piece(a, 0, 2, False), Piece(b, 2, 4, False), Piece(c, 4, 6, False)])
    assert [names[1].of(i) for i in (3, 4, 5, 6)] == [1, 2, 4, 5] and names[2].held >= {1, 2, 4, 5}
    assert [names[2].of(i) for i in (1, 2, 7, 8, 9)] == [1, 2, 4, 5, 3]


def write(path: Path, ids: dict[int, list[int]]) -> None:
    """An archive with these tracks, by scan; the lowest two are each at a place of its own."""
    results = []
    for k, some in ids.items():
        order = np.arange(len(some))
        place = np.stack([1000.0 * order, 0.0 * order], axis=1)
        own = replace(
            runs.tracks(k, np.random.default_rng(0), len(some)), id=np.array(some, np.int64), position_m=place,
            status=np.full(len(some), CONFIRMED),
        )  # fmt: skip
        results.append(replace(runs.result(k), tracks=own))
    runs.archive(path, results, full=False)
