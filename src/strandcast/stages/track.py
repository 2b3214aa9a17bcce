"""Video to mass points: track.parquet, markers.parquet, track.json, strobe.webp."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from strandcast.arm.load import Arm, load_arm
from strandcast.records.camera import Camera
from strandcast.records.files import atomic_write
from strandcast.records.manifest import Manifest
from strandcast.records.tables import write_table
from strandcast.records.track import MARKERS, TRACK, Track, TrackSummary
from strandcast.stages.context import context_of
from strandcast.tracking.hand import HandMarker
from strandcast.tracking.track import StringHint, Tracked, track_video

WEBP_QUALITY = 82


def run(root: Path, name: str, trial: int) -> None:
    """Track the string of one trial."""
    context = context_of(root, name)
    settings, folder = context.settings, context.folder.trial(trial)
    arm = load_arm(context.arm_file)
    manifest = Manifest.read(folder.results / "manifest.json")
    tracked = track_video(
        folder.data / manifest.video.file,
        manifest.video,
        Camera.read(context.folder.results / "camera.json"),
        StringHint(
            settings.string.length_m - arm.clamp.swallowed_m, settings.string.n, settings.string.thickness_m
        ),
        _hand_markers(arm),
        arm.marker_dictionary,
        settings.track.background_frames,
    )
    frames = np.arange(len(tracked.camera_time_s))
    track = Track(frames, tracked.camera_time_s, tracked.points_m, tracked.sigma_m, tracked.flags)
    write_table(folder.results / "track.parquet", TRACK, track.columns())
    write_table(folder.results / "markers.parquet", MARKERS, tracked.markers)
    with atomic_write(folder.results / "strobe.webp") as temporary:
        cv2.imwrite(str(temporary), tracked.strobe, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])
    _summary(name, trial, tracked, manifest, settings.string.length_m).write(folder.results / "track.json")


def _hand_markers(arm: Arm) -> list[HandMarker]:
    return [HandMarker(m.id, m.size_m, m.place_m, m.angle_rad, m.offset_m) for m in arm.markers]


def _summary(name: str, trial: int, tracked: Tracked, manifest: Manifest, length_m: float) -> TrackSummary:
    seen = np.isfinite(tracked.points_m[:, 1:]).all(axis=2) & (tracked.flags[:, 1:] == 0)
    with_marker = len(np.unique(tracked.markers["frame"]))
    return TrackSummary(
        experiment=name,
        trial=trial,
        source="video",
        points=tracked.points_m.shape[1] - 1,
        length_m=length_m,
        decoded_frames=tracked.decoded_frames,
        expected_frames=manifest.video.packets,
        tracked_fraction=float(seen.mean()),
        tip_fraction=float(seen[:, -1].mean()),
        marker_fraction=with_marker / tracked.decoded_frames,
        median_sigma_m=float(np.nanmedian(tracked.sigma_m[:, 1:])),
        choices=tracked.choices,
        warnings=tracked.warnings,
    )
