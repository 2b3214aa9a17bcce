"""Video to detections in pixels, and pictures: observations.parquet, track.json, strobe.webp, clip.json."""

from pathlib import Path

import cv2
import numpy as np

from strandcast.arm.load import PlanarArm, load_arm
from strandcast.camera.picture_file import write_picture
from strandcast.records.camera import Camera
from strandcast.records.clip import Clip
from strandcast.records.lineage import note_picture
from strandcast.records.manifest import Manifest
from strandcast.records.observations import MarkerShape, write_observations
from strandcast.records.track import TrackSummary
from strandcast.stages.context import Context, aimed_at, free_length_m
from strandcast.stages.job import Files, Job
from strandcast.stages.photos import given_background
from strandcast.tracking.clip import VideoFrames, make_clip
from strandcast.tracking.observe import observe
from strandcast.tracking.registry import track
from strandcast.tracking.result import Tracked
from strandcast.tracking.scene_checks import exposure_warnings
from strandcast.tracking.tracker import TrackerInput

WEBP_QUALITY = 82


def run(job: Job, files: Files) -> None:
    """Track the string of one trial."""
    context = job.context
    arm = load_arm(files.input("arm")).planar()
    manifest = Manifest.read(files.input("manifest"))
    camera = Camera.read(files.input("cameras"))
    video = job.folder.data / manifest.video.file
    tracked = track(_tracker_input(context, camera, arm, manifest, video), context.settings.track)
    shapes = {marker.id: MarkerShape(marker.size_m, marker.offset_m) for marker in arm.markers}
    observations = observe(tracked, camera, context.settings.camera_name, shapes)
    write_observations(files.output("observations"), observations)
    frames = tracked.small_frames or VideoFrames(video, manifest.video)
    clip = make_clip(frames, manifest.video, tracked.points_m, camera, aimed_at(context, manifest))
    Clip(experiment=context.name, trial=job.trial, **clip).write(files.output("clip"))
    write_picture(files.output("strobe"), cv2.cvtColor(tracked.strobe, cv2.COLOR_RGB2BGR), WEBP_QUALITY)
    note_picture(files.output("strobe"))
    summary = _summary(job, tracked, manifest, free_length_m(context, arm.clamp.clamped_length_m))
    summary.cameras = list(context.settings.cameras)
    summary.warnings += _assumed_exposure(job, tracked, camera)
    summary.write(files.output("summary"))


def _tracker_input(
    context: Context, camera: Camera, arm: PlanarArm, manifest: Manifest, video: Path
) -> TrackerInput:
    settings = context.settings
    return TrackerInput(
        video=video,
        facts=manifest.video,
        camera=camera,
        string=settings.string,
        free_length_m=free_length_m(context, arm.clamp.clamped_length_m),
        markers=arm.markers,
        marker_dictionary=arm.marker_dictionary,
        target_m=aimed_at(context, manifest),
        exposure_s=settings.camera.exposure_s,
        led=settings.align.led,
        background=given_background(context, manifest.video),
        settings_file=context.file,
    )


def _assumed_exposure(job: Job, tracked: Tracked, camera: Camera) -> list[str]:
    """Return a warning if the tracker assumed a camera's exposure; the lab's is in its own section."""
    exposure_s = tracked.choices.get("exposure_s")
    if job.is_lab or job.context.settings.camera.exposure_s is not None or not isinstance(exposure_s, float):
        return []
    return exposure_warnings(tracked.points_m, tracked.camera_time_s, exposure_s, camera.scale_m_per_px)


def _summary(job: Job, tracked: Tracked, manifest: Manifest, length_m: float) -> TrackSummary:
    detected = np.isfinite(tracked.points_m[:, 1:]).all(axis=2) & (tracked.flags[:, 1:] == 0)
    with_marker = len(np.unique(tracked.markers["frame"]))
    return TrackSummary(
        experiment=job.context.name,
        trial=job.trial,
        source="video",
        points=tracked.points_m.shape[1] - 1,
        length_m=length_m,
        decoded_frames=tracked.decoded_frames,
        expected_frames=manifest.video.packets,
        tracked_fraction=float(detected.mean()),
        tip_fraction=float(detected[:, -1].mean()),
        marker_fraction=with_marker / tracked.decoded_frames,
        median_sigma_m=float(np.nanmedian(tracked.sigma_m[:, 1:])),
        choices=tracked.choices,
        weights=list(tracked.attachments.weights),
        sections=list(tracked.attachments.sections),
        target=tracked.target,
        contact=tracked.contact,
        led=tracked.led,
        tip_sigma_m=tracked.tip_sigma_m,
        warnings=list(tracked.warnings),
        faults=list(tracked.faults),
    )
