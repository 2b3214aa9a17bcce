"""Video to mass points: track.parquet, markers.parquet, track.json, strobe.webp."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from strandcast.arm.load import Arm, load_arm
from strandcast.experiment import Led
from strandcast.records.camera import Camera
from strandcast.records.files import atomic_write
from strandcast.records.manifest import Manifest
from strandcast.records.tables import write_table
from strandcast.records.track import MARKERS, TRACK, Track, TrackSummary
from strandcast.stages.background import given_background
from strandcast.stages.context import Context, context_of, free_length_m
from strandcast.tracking.hand import HandMarker
from strandcast.tracking.led import LedPlace
from strandcast.tracking.pivot import track_pivot
from strandcast.tracking.track import Options, StringHint, Tracked, track_video
from strandcast.tracking.typed import against_typed

WEBP_QUALITY = 82


def run(root: Path, name: str, trial: int) -> None:
    """Track the string of one trial."""
    context = context_of(root, name)
    folder = context.folder.trial(trial)
    arm = load_arm(context.arm_file)
    manifest = Manifest.read(folder.results / "manifest.json")
    tracked = _track(context, arm, manifest, folder.data / manifest.video.file)
    frames = np.arange(len(tracked.camera_time_s))
    track = Track(frames, tracked.camera_time_s, tracked.points_m, tracked.sigma_m, tracked.flags)
    write_table(folder.results / "track.parquet", TRACK, track.columns())
    write_table(folder.results / "markers.parquet", MARKERS, tracked.markers)
    with atomic_write(folder.results / "strobe.webp") as temporary:
        cv2.imwrite(
            str(temporary),
            cv2.cvtColor(tracked.strobe, cv2.COLOR_RGB2BGR),
            [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY],
        )
    _summary(name, trial, tracked, manifest, free_length_m(context, arm.clamp.swallowed_m)).write(
        folder.results / "track.json"
    )


def _track(context: Context, arm: Arm, manifest: Manifest, video: Path) -> Tracked:
    settings = context.settings
    string, track = settings.string, settings.track
    camera = Camera.read(context.folder.results / "camera.json")
    hint = StringHint(free_length_m(context, arm.clamp.swallowed_m), string.n, string.thickness_m)
    if track.hand == "pivot":
        return track_pivot(video, manifest.video, camera, hint, track.background_frames)
    options = Options(
        background=given_background(context, manifest.video),
        background_frames=track.background_frames,
        exposure_s=settings.camera.exposure_s,
        polarity=track.polarity,
        contrast_grey=track.contrast_grey,
        led=_led_place(settings.align.led),
    )
    tracked = track_video(
        video, manifest.video, camera, hint, _hand_markers(arm), arm.marker_dictionary, options,
        np.array(settings.target_m),
    )  # fmt: skip
    tracked.warnings += against_typed(
        tracked.attachments,
        [weight.place_m for weight in string.weights],
        [(section.from_m, section.to_m) for section in string.stiff_sections],
        hint.length_m,
    )
    return tracked


def _led_place(led: Led | None) -> LedPlace | None:
    if led is None:
        return None
    place_m = None if led.x_m is None or led.y_m is None else (led.x_m, led.y_m)
    return LedPlace(place_m, led.radius_m, led.box_px, led.gamma)


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
        weights=list(tracked.attachments.weights),
        sections=list(tracked.attachments.sections),
        target=tracked.target,
        contact=tracked.contact,
        led=tracked.led,
        warnings=tracked.warnings,
    )
