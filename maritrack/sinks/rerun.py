"""A run as a Rerun recording: what people look at. The record is the MCAP archive.

Written as `PATH.partial`, sent in batches of scans counted, not timed, so that equal runs have equal
contents; renamed when the run has ended. A killed run leaves a readable .partial that lacks at most
the last batch. Timelines: `scan` (number of the frame) and `time` (of the data; no clock is read).
"""

from __future__ import annotations

import contextlib
import datetime
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from rerun.chunk import RrdReader

from maritrack.errors import UsageError
from maritrack.sinks import captions, drawing, raster, shapes, view
from maritrack.sinks.batch import ARCHETYPES, Batch
from maritrack.sinks.blueprint import Layout, blueprint
from maritrack.sinks.drawing import Row
from maritrack.sinks.view import Box, Pending
from maritrack.types import Result, RunManifest, Scan

APPLICATION = "maritrack"
MOST_LOOKUPS = 4  # of 8 MB each
MOST_PICTURE_PX = 20_000  # of a screenshot from its centre
FEW_POINTS = 300  # in a scan: drawn larger
LEADER_SHARE = 0.075  # of the range: from an object of the truth to its name
VIDEO_PALETTE = raster.palette(captions.VIDEO_STOPS)


class RerunSink:
    """Writes results to an .rrd. `open`, then `write` for every frame, then `close` or `abort`."""

    def __init__(
        self, path: Path, *, flush_scans: int = 20, raster_px: int = 1024, video_every: int = 1, trail_scans: int = 60
    ) -> None:
        self._path = path
        self._partial = path.with_name(path.name + ".partial")
        self._flush_scans = flush_scans
        self._raster_px = raster_px
        self._video_every = max(video_every, 1)
        self._pending: list[Pending] = []
        self._lookups: dict[tuple[float, float, int, int, int], raster.Lookup] = {}
        self._peak: dict[str, float] = {}  # strongest cell so far, by sensor
        self._n_scans: dict[str, int] = {}  # by sensor, in order of appearance
        self._trails = shapes.no_trails(max(trail_scans, 1))
        self._drawn: dict[str, tuple[float, ...]] = {}  # what was last drawn of things that seldom change
        self._styled: dict[str, None] = {}  # entities whose static part is out
        self._scores: list[str] = []  # names, in order of appearance
        self._truth_seen = self._few_points = False
        self._range_m = view.DEFAULT_BOX.size_m / 2
        self._box: Box | None = None
        self._layout: Layout | None = None
        self._rec: rr.RecordingStream | None = None
        self._manifest: RunManifest | None = None

    def open(self, manifest: RunManifest) -> None:
        """Begin the file. Errors: UsageError where its folder doesn't exist."""
        if not self._path.parent.is_dir():
            raise UsageError(f"{self._path}: there is no folder {self._path.parent}")
        self._manifest = manifest
        never = rr.ChunkBatcherConfig(
            flush_tick=datetime.timedelta(days=365), flush_num_bytes=1 << 50, flush_num_rows=10**12,
            chunk_max_rows_if_unsorted=10**9,
        )  # fmt: skip
        rec = rr.RecordingStream(APPLICATION, recording_id=manifest.run_id, send_properties=False, batcher_config=never)
        rec.set_log_time_enabled(False)
        with self._writing():
            rec.save(self._partial)
        rec.send_recording_name(f"{manifest.recording or manifest.run_id} / {manifest.tracker}")
        rec.send_property("run", rr.AnyValues(**_properties(manifest)))
        context = rr.AnnotationContext([(i, name, colour) for i, name, colour in captions.CLASSES])
        for root in ("ppi", "geo"):
            rec.log(root, context, static=True)
        self._rec = rec

    def write(self, result: Result) -> None:
        """Take a frame. Every `flush_scans` frames are written out together."""
        frame, scan = result.frame, result.frame.scan
        jpeg, half_m = self._video(scan)
        light = replace(frame, scan=replace(scan, video=None, picture=None), inputs=())
        self._pending.append(Pending(replace(result, frame=light, background=None), jpeg, half_m))
        if len(self._pending) >= self._flush_scans:
            self._flush()

    def close(self, summary: Mapping[str, Any]) -> None:
        """End the file and give it its name. Errors: OSError where it can't be written, as in `write`."""
        rec = self._recording()
        self._flush()
        self._send_layout()
        self._send_document(summary)
        self._end(rec)
        with self._writing():
            RrdReader(str(self._partial)).store()  # its table of contents: there only if all was written
        self._partial.replace(self._path)

    def abort(self) -> None:
        """Leave what there is as a readable .partial. Never raises for a full disk."""
        if self._rec is not None:
            with contextlib.suppress(OSError):
                self._flush()
            with contextlib.suppress(OSError):
                self._end(self._rec)

    def _end(self, rec: rr.RecordingStream) -> None:
        self._rec = None
        with self._writing():
            rec.flush()
            rec.disconnect()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Turns what the SDK raises when it can't write into an OSError with the path."""
        try:
            yield
        except RuntimeError as error:
            raise OSError(f"{self._partial}: the recording can't be written: {error}") from error

    def _recording(self) -> rr.RecordingStream:
        if self._rec is None:
            raise UsageError(f"{self._path}: the sink is not open")
        return self._rec

    def _video(self, scan: Scan) -> tuple[bytes | None, float]:
        sensor = scan.sensor.id
        turn = self._n_scans[sensor] = self._n_scans.get(sensor, -1) + 1
        video = scan.video
        if scan.picture is not None:
            half_m = min(scan.sensor.max_range_m, MOST_PICTURE_PX * scan.picture.pixel_m)
            grey = raster.turned(scan.picture, half_m, pixels=self._raster_px)
            return raster.to_jpeg(grey, colours=VIDEO_PALETTE), half_m
        if video is None or video.intensity.size == 0:
            return None, 0.0
        key = raster.geometry_of(video, pixels=self._raster_px)
        lookup = self._lookups.pop(key, None) or raster.make_lookup(key)
        self._lookups[key] = lookup  # the latest last
        if len(self._lookups) > MOST_LOOKUPS:
            del self._lookups[next(iter(self._lookups))]
        peak = self._peak[sensor] = max(self._peak.get(sensor, 0.0), float(video.intensity.max()))
        if turn % self._video_every:
            return None, lookup.half_m
        grey = raster.to_raster(video, lookup, full_scale=raster.full_scale(scan.sensor.bits, peak))
        return raster.to_jpeg(grey, colours=VIDEO_PALETTE), lookup.half_m

    def _flush(self) -> None:
        rec = self._recording()
        pending, self._pending = self._pending, []
        self._box = view.bounds_of(pending, self._box)
        self._scores = list(dict.fromkeys([*self._scores, *view.score_names(pending)]))
        if self._layout is None and pending:
            self._range_m = view.range_of(pending, self._box)
            self._few_points = max(len(p.result.points) for p in pending) <= FEW_POINTS
            self._send_layout()
            self._send_document(None)
            rec.send_recording_start_time_nanos(pending[0].result.frame.t_ns)
        batch = Batch()
        for p in pending:
            for row in self._rows(p):
                batch.add(row, p.result.frame.k, p.result.frame.t_ns)
        for entity in batch.entities():
            if entity not in self._styled:
                for kind, fields in drawing.style_of(entity, few_points=self._few_points, over=self._over(entity)):
                    rec.log(entity, ARCHETYPES[kind].from_fields(**fields), static=True)
                self._styled[entity] = None
        batch.send(rec)
        with self._writing():
            rec.flush()

    def _over(self, entity: str) -> bool:
        """Whether this is video that lies over that of another sensor."""
        return any(e.startswith("ppi/video/") for e in self._styled) and entity.startswith("ppi/video/")

    def _rows(self, pending: Pending) -> Iterator[Row]:
        """All that is drawn of a frame, in a fixed order."""
        result, tracks, scan = pending.result, pending.result.tracks, pending.result.frame.scan
        part = rr.escape_entity_path_part(scan.sensor.id)
        self._trails = shapes.extend_trails(self._trails, tracks)
        yield from self._placed(pending, part)
        if pending.jpeg is not None:
            yield Row(f"ppi/video/{part}", "EncodedImage", {"blob": [pending.jpeg], "media_type": ["image/jpeg"]})
        if result.mask is not None:
            yield from drawing.draw_mask(result.mask, part)
        yield from drawing.draw_points(result, part)
        yield from drawing.draw_clusters(result, part)
        yield from drawing.draw_tracks(tracks, self._trails, vector_s=60 * captions.vector_minutes(self._range_m))
        truth = result.frame.truth
        self._truth_seen |= truth is not None
        if self._truth_seen:
            yield from drawing.draw_truth(truth or drawing.NO_TRUTH, leader_m=LEADER_SHARE * self._range_m)
        yield from drawing.draw_numbers(result)
        yield from drawing.draw_log(result)
        table = captions.track_table(tracks, scan.position_m, scan=result.frame.k, view_m=self._range_m)
        yield Row("tables/tracks", "TextDocument", {"text": [table], "media_type": ["text/markdown"]})
        if self._manifest is not None and self._manifest.origin is not None:
            yield from drawing.draw_geo(result, self._trails, self._manifest.origin, with_truth=self._truth_seen)

    def _placed(self, pending: Pending, part: str) -> Iterator[Row]:
        """What stands still as long as the sensor does: drawn again only when it has moved."""
        scan, origin = pending.result.frame.scan, self._manifest.origin if self._manifest else None
        east, north = scan.position_m.tolist()
        range_m = pending.half_m or self._range_m
        coarse = 0.002 * range_m
        first = scan.sensor.id == next(iter(self._n_scans))
        leader_m = self._name_leader(part, north)
        if self._moved(f"sensor {part}", (east, north, range_m, leader_m), coarse):
            if first or not self._crowded(scan):
                yield from drawing.draw_sensor(scan.position_m, f"sensor {scan.sensor.id}", part, leader_m=leader_m)
            if origin is not None:
                yield from drawing.draw_geo_sensor(scan.position_m, range_m, part, origin)
            if first:
                yield from drawing.draw_grid(scan.position_m, range_m)
        if pending.jpeg is not None and self._moved(f"video {part}", (east, north, pending.half_m), 0.0):
            pixel_m = 2 * pending.half_m / self._raster_px
            corner = np.array([[east - pending.half_m, -north - pending.half_m, 0.0]])
            yield Row(f"ppi/video/{part}", "Transform3D", {"translation": corner,
                      "scale": np.array([[pixel_m, pixel_m, 1.0]])})  # fmt: skip

    def _moved(self, what: str, now: tuple[float, ...], tolerance: float) -> bool:
        before = self._drawn.get(what)
        if before is not None and max(abs(a - b) for a, b in zip(before, now, strict=True)) <= tolerance:
            return False
        self._drawn[what] = now
        return True

    def _name_leader(self, part: str, north_m: float) -> float:
        """How far north of it the name of one of several sensors stands, negative to the south: away from the others,
        beyond the names of ships between them, and no two in one line. At the sensor where there is no other yet.
        """
        places = {name: place[1] for name, place in self._drawn.items() if name.startswith("sensor ")}
        places[f"sensor {part}"] = north_m
        if len(places) < 2:
            return 0.0
        side = north_m - float(np.mean(list(places.values())))
        row = LEADER_SHARE * self._range_m
        away = max((2 + list(places).index(f"sensor {part}")) * row, abs(side) + 2 * row)
        return float(np.copysign(away, side)) - side

    def _crowded(self, scan: Scan) -> bool:
        """Whether the first sensor stands (nearly) where this one does, so that their names would overlap."""
        first = rr.escape_entity_path_part(next(iter(self._n_scans)))
        east, north = self._drawn.get(f"sensor {first}", (np.inf, np.inf))[:2]
        return bool(np.hypot(*(scan.position_m - (east, north))) < 0.03 * self._range_m)

    def _send_layout(self) -> None:
        """The blueprint, if what there is to show has changed."""
        old, box = self._layout, self._box or view.DEFAULT_BOX
        box = old.bounds if old is not None and old.bounds.holds(box) else box.padded(0.06)
        origin = self._manifest.origin if self._manifest else None
        layout = Layout(
            box,
            max(box.size_m, 2.1 * self._range_m),
            None if origin is None else origin.lat_deg,
            *(
                tuple(drawing.score_entity(n) for n in self._scores if captions.score_unit(n) in units)
                for units in (("m",), ("objects", "tracks"), ("m^p", ""))
            ),
        )
        if layout != old:
            self._layout = layout
            vector = captions.duration(captions.vector_minutes(self._range_m))
            at, labels, colours = drawing.legend(box, vector, with_video=bool(self._peak))
            rec = self._recording()
            rec.log("ppi/legend", rr.Points2D(at, labels=labels, colors=colours, radii=[-0.01], show_labels=True),
                    static=True)  # fmt: skip
            rec.send_blueprint(blueprint(layout))

    def _send_document(self, summary: Mapping[str, Any] | None) -> None:
        assert self._manifest is not None
        vector = captions.duration(captions.vector_minutes(self._range_m))
        text = captions.run_document(self._manifest, vector=vector, summary=summary)
        self._recording().log("run", rr.TextDocument(text, media_type="text/markdown"), static=True)


def _properties(manifest: RunManifest) -> dict[str, Any]:
    return {
        "run_id": manifest.run_id, "tracker": manifest.tracker, "preset": manifest.preset, "seed": manifest.seed,
        "code_sha256": manifest.code_sha256, "config_toml": manifest.config_toml,
        "input_sha256": ",".join(manifest.input_sha256), "input_kind": ",".join(manifest.input_kind),
        "versions": " ".join(f"{k}={v}" for k, v in sorted(manifest.versions.items())),
    }  # fmt: skip
