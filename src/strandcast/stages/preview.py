"""A quick look at a trial's video: preview.webp, and in words what is found and what is wrong."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from strandcast.arm.load import Arm, load_arm
from strandcast.camera.markers import same_family
from strandcast.errors import StrandcastError
from strandcast.records.camera import Camera
from strandcast.records.files import atomic_write
from strandcast.stages.background import given_background
from strandcast.stages.context import Context, context_of, free_length_m
from strandcast.tracking.hand import HandMarker
from strandcast.tracking.preview import Wanted, preview
from strandcast.tracking.preview_picture import preview_picture
from strandcast.tracking.preview_words import findings, problems
from strandcast.tracking.result import StringHint
from strandcast.tracking.sampled import sample_video
from strandcast.tracking.track import POLARITIES
from strandcast.video.ingest import inspect_video

WEBP_QUALITY = 85


def run(root: Path, name: str, trial: int) -> list[str]:
    """Write results/<experiment>/trial-NN/preview.webp; return what there is to say, one line each."""
    context = context_of(root, name)
    if context.settings.track.hand == "pivot":
        raise StrandcastError(
            "SC-T010", "a pendulum has no hand to look for", field="track.hand",
            fix="run `strandcast track`: strobe.webp shows the swing")  # fmt: skip
    folder = context.folder.trial(trial)
    # A video that was cut can be looked at too; what is wrong with the file is told with the rest.
    facts = inspect_video(folder.video(), context.settings.camera.frame_rate_hz, "use_prefix")
    sampled = sample_video(folder.video(), facts)
    wanted = _wanted(context)
    background = given_background(context, facts)
    seen = preview(sampled, _camera(context), wanted, context.settings.track.background_frames, background)
    title = f"{name} trial {trial}: {facts.file}, {facts.packets} frames at {facts.frame_rate_hz:g}/s"
    out = folder.results / "preview.webp"
    with atomic_write(out) as temporary:
        bgr = cv2.cvtColor(preview_picture(seen, title), cv2.COLOR_RGB2BGR)
        cv2.imwrite(str(temporary), bgr, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])
    wrong = [f"wrong: {text}" for text in problems(seen)] or ["nothing is wrong in these frames"]
    told = [f"file: {text}" for text in facts.notes + sampled.warnings]
    if sampled.decoded < facts.packets:
        told.append(f"only the first {sampled.decoded} of {facts.packets} frames were looked at")
    return [title, *wrong, *findings(seen), *told, str(out)]


def _camera(context: Context) -> Camera | None:
    path = context.folder.results / "camera.json"
    return Camera.read(path) if path.is_file() else None


def _wanted(context: Context) -> Wanted:
    settings, arm = context.settings, load_arm(context.arm_file)
    string = settings.string
    return Wanted(
        StringHint(free_length_m(context, arm.clamp.swallowed_m), string.n, string.thickness_m),
        [HandMarker(m.id, m.size_m, m.place_m, m.angle_rad, m.offset_m) for m in arm.markers],
        arm.marker_dictionary,
        np.asarray(settings.target_m, float),
        tuple(weight.place_m for weight in string.weights),
        POLARITIES[settings.track.polarity],
        _plane_ids(context, arm),
    )


def _plane_ids(context: Context, arm: Arm) -> tuple[int, ...]:
    plane = context.settings.camera.plane
    alike = same_family(plane.dictionary, arm.marker_dictionary)
    return tuple(marker.id for marker in plane.markers) if alike else ()
