"""A preview of tracking in a few frames: preview.webp, and the findings and problems as text."""

from pathlib import Path

import cv2
import numpy as np

from strandcast.arm.load import load_arm
from strandcast.camera.markers import same_family
from strandcast.camera.picture_file import write_picture
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera
from strandcast.stages.context import Context, context_of_camera, free_length_m
from strandcast.stages.photos import given_background
from strandcast.tracking.chain.string_track import POLARITIES
from strandcast.tracking.preview.findings import findings, problems
from strandcast.tracking.preview.picture import preview_picture
from strandcast.tracking.preview.preview import Expected, preview, sample_video
from strandcast.tracking.tracker import StringHint
from strandcast.video.checks import slow_rate_warning
from strandcast.video.ingest import inspect_video

WEBP_QUALITY = 85


def run(root: Path, name: str, trial: int) -> list[str]:
    """Write the preview's picture; return the findings, one line each."""
    context = context_of_camera(root, name)
    settings = context.settings.camera
    if context.settings.track.tracker != "chain":
        what, fix = "only the tracker chain has a preview", "run `strandcast track`: see strobe.webp"
        raise StrandcastError("SC-E008", what, field="track.tracker", fix=fix)
    folder = context.folder.trial(trial)
    # A video that was cut can be previewed too; problems of the file are listed with the others.
    facts = inspect_video(folder.video(), settings.frame_rate_hz, "use_prefix")
    sampled = sample_video(folder.video(), facts)
    expected = _expected(context)
    background = given_background(context, facts)
    record = context.folder.camera(context.settings.camera_name)
    camera = Camera.read(record) if record.is_file() else None
    found = preview(sampled, camera, expected, background)
    title = f"{name} trial {trial}: {facts.file}, {facts.packets} frames at {facts.frame_rate_hz:g}/s"
    out = folder.results / "preview.webp"
    write_picture(out, cv2.cvtColor(preview_picture(found, title), cv2.COLOR_RGB2BGR), WEBP_QUALITY)
    wrong = [f"wrong: {text}" for text in problems(found)] or ["nothing is wrong in these frames"]
    notes = [f"file: {text}" for text in facts.notes + sampled.warnings + slow_rate_warning(facts)]
    if sampled.decoded < facts.packets:
        notes.append(f"only the first {sampled.decoded} of {facts.packets} frames were sampled")
    return [title, *wrong, *findings(found), *notes, str(out)]


def _expected(context: Context) -> Expected:
    settings, arm = context.settings, load_arm(context.arm_file).planar()
    string, plane = settings.string, settings.camera.plane
    alike = same_family(plane.dictionary, arm.marker_dictionary)
    return Expected(
        StringHint(free_length_m(context, arm.clamp.clamped_length_m), string.n, string.thickness_m),
        arm.markers,
        arm.marker_dictionary,
        None if settings.target_m is None else np.asarray(settings.target_m, float),
        tuple(weight.place_m for weight in string.weights),
        POLARITIES[settings.track.polarity],
        tuple(marker.id for marker in plane.markers) if alike else (),
    )
