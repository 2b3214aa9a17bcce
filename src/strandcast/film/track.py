"""Track a string in a film without a robot."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from strandcast.camera.flat import flat_camera
from strandcast.camera.mapping import metre_to_pixel
from strandcast.config.track import TrackSettings
from strandcast.errors import StrandcastError
from strandcast.film.colour import film_of_colour
from strandcast.film.held_end import SIGMA_PX, BothEnds, FilmScene, held_ends, not_held
from strandcast.film.known import FilmKnown, Scale, corrections_of, held_of, in_mm, scale_of
from strandcast.film.result import FilmTrack
from strandcast.film.seen import (
    SeenString,
    eight_bit_of,
    seen_string,
    without_markers,
    without_resting_string,
)
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts
from strandcast.records.track import SUPPLIED
from strandcast.tracking.background import Samples, learn_background
from strandcast.tracking.chain.frames import GivenPlaces, StringFrames
from strandcast.tracking.chain.string_track import POLARITIES, track_string
from strandcast.tracking.crops import Crops
from strandcast.tracking.decoding import HeldEndFinder, decode, scene_background
from strandcast.tracking.events.frame_rate import changing_rate_warnings
from strandcast.tracking.hand.finder import HandFinder
from strandcast.tracking.hand.path import bridge_hand
from strandcast.tracking.hand.rigid import box_around
from strandcast.tracking.pixel_map import tabulate
from strandcast.tracking.preconditions import check_size, open_ingested
from strandcast.tracking.scene_checks import movement_warnings
from strandcast.tracking.track_video import CROP_LENGTHS, EXPOSURE_SHARE, assemble_points
from strandcast.tracking.tracker import StringHint
from strandcast.video.checks import file_warnings
from strandcast.video.ingest import camera_times, inspect_video

# The tracker's lengths were chosen for strings of about half a metre. A film is tracked in units in which its
# string has this length, be it a hair or a rope, in metres or in pixels.
NOMINAL_M = 0.5
PICTURES = 20  # chosen: frames in which the string is searched before it is known where it is held
LEAST_SHOWN = 5  # chosen: of them must show it
OTHER_LENGTH = 0.05  # chosen: relative difference from which a length contradicts the film


def track_film(video: str | Path, **what: Any) -> FilmTrack:
    """Track a string in a film; what is known of it are the fields of `FilmKnown`.

    Raises
    ------
    StrandcastError
        SC-T004 no thin thing moves in the film, or no place where it is held is found or given; those of
        `scale_of`, `held_of`, `corrections_of`, `inspect_video` and `open_video`.
    """
    video, known = Path(video), FilmKnown(**what)
    held = [held_of(text) for text in ([known.held] if isinstance(known.held, str) else known.held)]
    by_marker = any(one.marker is not None for one in held) or str(known.scale).startswith("marker=")
    if known.colour is not None and by_marker:
        fix = "give another --scale, and pixels as --held"
        raise StrandcastError("SC-W021", "a film by colour shows no markers", field="colour", fix=fix)
    own = _inspected(video, known)
    with film_of_colour(video, known.colour) as file:
        facts = own if file == video else _inspected(file, known)
        still = [one.place_px for one in held if not one.moves]
        pictures, seen = _look(video, file, facts, known, still[0] if still else None)
        ids = [one.marker for one in held if one.marker is not None]
        scale = scale_of(known.scale, pictures, known.dictionary, ids)
        if scale.camera is not None:
            check_size(facts, scale.camera, video)
        camera = _nominal_camera(facts, known.length_m, scale, seen)
        scene = FilmScene(video, file, facts, pictures, seen, camera)
        ends, words = held_ends(scene, held, known.dictionary)
        track = _tracked(scene, ends, known, scale, {"held": words, "scale": scale.words})
    return replace(track, facts=own, warnings=(*file_warnings(own), *track.warnings))


def _inspected(file: Path, known: FilmKnown) -> VideoFacts:
    """Return the facts of a film (SC-V017 if it has no frame rate, or several)."""
    try:
        return inspect_video(file, known.frame_rate_hz)
    except StrandcastError as problem:
        if problem.code != "SC-V017":
            raise
        what = problem.what.replace("camera.frame_rate_hz", "--frame-rate")
        fix = "give the camera's --frame-rate"
        if known.frame_rate_hz is not None:
            fix = "leave --frame-rate out: this film needs none"
        raise StrandcastError("SC-V017", what, file=file, field="frame_rate_hz", fix=fix) from None


def _look(
    video: Path, file: Path, facts: VideoFacts, known: FilmKnown, near_px: tuple[float, float] | None
) -> tuple[list[np.ndarray], SeenString]:
    """Return pictures spread over the film, and the string that they show (SC-T004 if there is none)."""
    with open_ingested(file, facts) as opened:
        samples = Samples(facts.packets, opened.info.frame_bytes)
        for index, _, image in opened:
            samples.offer(index, image)
    sampled = eight_bit_of(samples.pictures)
    background, _ = learn_background(sampled)
    some = np.unique(np.linspace(0, len(sampled) - 1, PICTURES).astype(int))
    pictures = [sampled[k] for k in some]
    bare = [without_markers(one, background, known.dictionary) for one in pictures]
    seen = seen_string(bare, background, POLARITIES[known.polarity], near_px)
    if seen is None or len(seen.shown) < LEAST_SHOWN:
        raise StrandcastError(
            "SC-T004",
            "nothing long and thin moves in this film",
            file=video,
            fix="film, with a camera that stands still, a string at least two pixels wide that differs from "
            "what is behind it; --colour finds one by its colour",
        )
    return pictures, seen


def _other_length(found: float, known: FilmKnown) -> list[str]:
    """Return the warning of a length that the film contradicts."""
    if known.length_m is None or known.scale is None or abs(found / known.length_m - 1.0) < OTHER_LENGTH:
        return []
    return [
        f"the length is given as {known.length_m:.4g} m, but by the scale it is {found:.4g} m: one is wrong"
    ]


def _nominal_camera(facts: VideoFacts, length_m: float | None, scale: Scale, seen: SeenString) -> Camera:
    """Return the camera in nominal metres: the string is `NOMINAL_M` long."""
    if scale.camera is not None:
        per_m = NOMINAL_M / (length_m or seen.length_px * scale.camera.scale_m_per_px)
        larger = {
            "translation_m": (per_m * np.array(scale.camera.translation_m)).tolist(),
            "string_offset_m": per_m * scale.camera.string_offset_m,
            "scale_m_per_px": per_m * scale.camera.scale_m_per_px,
            "plane_markers": [],
        }
        return scale.camera.model_copy(update=larger)
    length_px = seen.length_px
    if length_m is not None and scale.m_per_px is not None:
        length_px = length_m / scale.m_per_px
    return flat_camera(facts.width_px, facts.height_px, NOMINAL_M / length_px, (0.0, 0.0))


def _given_places(
    scene: FilmScene, far_m: list[np.ndarray], rows: np.ndarray, points: int
) -> GivenPlaces | None:
    """Return the far end and the corrections (K, 4) as places along the string; None if there are none."""
    which = np.unique(rows[:, 1]).astype(int)
    place_m = np.full((scene.facts.packets, len(which), 2), np.nan)
    place_m[rows[:, 0].astype(int), np.searchsorted(which, rows[:, 1])] = scene.metres(rows[:, 2:])
    share = which / points
    if far_m:
        far = np.array(far_m)[:, None]
        if points in which:  # a correction of the held end
            far = np.where(np.isfinite(place_m[:, -1:]), place_m[:, -1:], far)
        place_m = np.concatenate([place_m[:, share < 1.0], far], axis=1)
        share = np.append(share[share < 1.0], 1.0)
    corrected = tuple(np.unique(rows[:, 0]).astype(int).tolist())
    return GivenPlaces(share, place_m, corrected) if len(share) else None


def _tracked(
    scene: FilmScene, ends: list[HeldEndFinder], known: FilmKnown, scale: Scale, assumed: dict[str, str]
) -> FilmTrack:
    """Track the string through the film."""
    camera, facts, time_s = scene.camera, scene.facts, camera_times(scene.facts)
    rows = np.zeros((0, 4))
    if known.corrections is not None:
        rows = corrections_of(known.corrections, facts, known.points)
    settings, finder = TrackSettings(polarity=known.polarity), BothEnds(ends)
    extent = box_around(list(ends[0].markers.values())) if isinstance(ends[0], HandFinder) else np.zeros(4)
    exposure_s = known.exposure_s or EXPOSURE_SHARE / facts.frame_rate_hz
    crops = Crops(tabulate(camera, camera.string_offset_m), CROP_LENGTHS * NOMINAL_M)
    decoded = decode(scene.file, facts, finder, crops)
    if not any(decoded.hands):
        raise not_held(scene, "what holds it is found in no frame")
    background = without_resting_string(scene_background(decoded.samples, None)[0], scene.seen)
    hand = bridge_hand(time_s, decoded.hands)
    given = _given_places(scene, finder.far_m, rows, known.points)
    frames = StringFrames(crops, np.ascontiguousarray(background), hand, time_s, extent, given=given)
    try:
        string = track_string(frames, StringHint(NOMINAL_M, known.points), settings, exposure_s, scene.video)
    except StrandcastError as problem:
        raise not_held(scene, problem.what) from None
    points, sigma, flags = assemble_points(time_s, hand, string.points)
    if finder.far_m:
        points[:, -1], flags[:, -1] = finder.far_m, hand.flags
        sigma[:, -1] = SIGMA_PX * camera.scale_m_per_px
    by_hand = rows[:, 0].astype(int), rows[:, 1].astype(int)
    points_px = metre_to_pixel(camera, points, camera.string_offset_m)
    points_px[by_hand], points[by_hand], flags[by_hand] = rows[:, 2:], scene.metres(rows[:, 2:]), SUPPLIED
    length = string.clamp_fit.length_m
    m_per_px = scale.m_per_px if scale.camera is None else scale.camera.scale_m_per_px
    if m_per_px is None and known.length_m is not None:
        m_per_px = known.length_m / length * camera.scale_m_per_px
        assumed = assumed | {"scale": f"{in_mm(m_per_px)}: the string has its length"}
    if len(rows):
        assumed = assumed | {"corrections": f"{len(rows)} places of {known.corrections}"}
    per_unit = camera.scale_m_per_px / (m_per_px or 1.0)  # nominal metres in a metre, or in a pixel
    first = points[np.isfinite(points[:, 0]).all(axis=1), 0][0]
    reach = np.array([np.nan if fit is None else fit.tip_slide_m for fit in string.first.fits])
    reach = reach + string.first.length_m if len(ends) == 1 else np.full(len(reach), length)
    return FilmTrack(
        video=scene.video,
        facts=facts,
        time_s=time_s,
        points_px=points_px,
        points_m=None if m_per_px is None else (points - (scale.camera is None) * first) / per_unit,
        sigma_px=sigma / camera.scale_m_per_px,
        flags=flags,
        length=reach / per_unit,
        m_per_px=m_per_px,
        assumed=assumed | {"length": f"{length / per_unit:.4g} {'px' if m_per_px is None else 'm'}"},
        warnings=(
            *_other_length(length / per_unit, known),
            *changing_rate_warnings(time_s, points, sigma, flags),
            *movement_warnings(
                camera.model_copy(update={"scale_m_per_px": m_per_px or 0.0}),
                decoded.samples,
                None,
                scene.video,
            ),
            *decoded.warnings,
        ),
    )
