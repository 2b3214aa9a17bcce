"""The chain tracker: from one trial's video to the mass points of its string."""

import numpy as np

from strandcast.camera.tilt import check_plane_tilt
from strandcast.config.track import TrackSettings
from strandcast.errors import StrandcastError
from strandcast.tracking.attachments.declared_vs_detected import declaration_conflicts
from strandcast.tracking.chain.appearance import Appearance
from strandcast.tracking.chain.bridge import bridge_points
from strandcast.tracking.chain.frames import StringFrames
from strandcast.tracking.chain.point_uncertainty import gate_accelerations
from strandcast.tracking.chain.string_track import StringTrack, track_string
from strandcast.tracking.crops import Crops, SmallFrames
from strandcast.tracking.decoding import decode, scene_background
from strandcast.tracking.events.contact import TipPath, detect_contact
from strandcast.tracking.events.frame_rate import changing_rate_warnings
from strandcast.tracking.events.led import LedMonitor
from strandcast.tracking.events.target import locate_target, target_warnings
from strandcast.tracking.hand.finder import HandFinder
from strandcast.tracking.hand.path import TrackedHand, bridge_hand, marker_table
from strandcast.tracking.hand.rigid import box_around
from strandcast.tracking.pixel_map import tabulate
from strandcast.tracking.preconditions import check_size
from strandcast.tracking.result import Tracked
from strandcast.tracking.scene_checks import (
    confidence_warnings,
    end_sigma_m,
    left_plane,
    length_faults,
    length_warnings,
    movement_warnings,
    out_of_plane_warnings,
    plane_tilts,
    tip_sigma_m,
)
from strandcast.tracking.strobe import (
    choose_instants,
    closest_frame,
    frame_picture,
    strobe_picture,
    with_instant,
)
from strandcast.tracking.tracker import TrackerInput
from strandcast.video.ingest import camera_times

CROP_LENGTHS = 1.25  # chosen: half the side of a crop around the hand, in lengths of the string
EXPOSURE_SHARE = 0.2  # chosen: of the frame interval, if the exposure is not given


def track_video(given: TrackerInput, settings: TrackSettings) -> Tracked:
    """Track the hand and the string through a video.

    The string is tracked both ways from the frame that shows it best. A second fit of each frame uses the
    length, the clamp and the weights as all frames together show them.
    """
    check_size(given.facts, given.camera, given.video)
    camera, exposure_s = given.camera, given.exposure_s or EXPOSURE_SHARE / given.facts.frame_rate_hz
    time_s = camera_times(given.facts)
    finder = HandFinder(camera, given.markers, given.marker_dictionary, camera.string_offset_m)
    led_monitor = None if given.led is None else LedMonitor(given.led, camera)
    crops = Crops(tabulate(camera, camera.string_offset_m), CROP_LENGTHS * given.free_length_m)
    small = SmallFrames(given.facts.width_px, given.facts.height_px)
    also = [small.keep] if led_monitor is None else [small.keep, led_monitor.look]
    decoded = decode(given.video, given.facts, finder, crops, also)
    samples = decoded.samples
    background, source = scene_background(samples, given.background)
    if not any(decoded.hands):
        raise StrandcastError("SC-A004", finder.why_not(), file=given.video, field="markers")
    hand = bridge_hand(time_s, decoded.hands)
    extent = box_around(given.markers)
    frames = StringFrames(crops, np.ascontiguousarray(background), hand, time_s, extent)
    string = track_string(frames, given.hint, settings, exposure_s, given.video)
    points_m, sigma_m, flags = assemble_points(time_s, hand, string.points)
    sampled = np.asarray(samples.indices)
    instants = choose_instants(sampled, points_m)
    if given.target_m is not None:
        closest = closest_frame(time_s, points_m, flags[:, -1] == 0, given.target_m)
        instants = with_instant(instants, closest)
    thrown = [frame_picture(k, sampled, samples.pictures, crops, background) for k in instants.tolist()]
    out = left_plane(frames, string, camera)
    moved = movement_warnings(camera, samples, given.background, given.video)
    tilts = plane_tilts(camera, finder, decoded.hands)
    tilted = [(tilt.cost_m, found) for tilt in tilts if (found := check_plane_tilt(tilt, given.video))]
    target = None if given.target_m is None else locate_target(background, camera, given.target_m)
    appearance = string.first.appearance
    end_m = end_sigma_m(appearance, given.hint.beyond_m)
    tip = tip_path(time_s, points_m, flags, appearance)
    weights_m = [weight.place_m for weight in given.string.weights]
    clamp_fit = string.clamp_fit
    faults = length_faults(clamp_fit, given.free_length_m, given.string.length_m, end_m)
    led, led_warnings = (None, []) if led_monitor is None else led_monitor.found(time_s, given.exposure_s)
    return Tracked(
        camera_time_s=time_s,
        points_m=points_m,
        sigma_m=sigma_m,
        flags=flags,
        markers=marker_table(finder, decoded.hands, time_s),
        strobe=strobe_picture(background, thrown, points_m[instants], camera),
        choices=choices(
            string,
            source,
            exposure_s,
            None if given.target_m is None else target is not None,
            instants,
        ),
        warnings=(
            *target_warnings(target),
            *led_warnings,
            *changing_rate_warnings(time_s, points_m, sigma_m, flags),
            *moved,
            *(warning for _, warnings in tilted for warning in warnings),
            *finder.contradictions(),
            *confidence_warnings(points_m, flags),
            *length_warnings(clamp_fit, given.free_length_m),
            *(fault.words for fault in faults),
            *out_of_plane_warnings(out),
            *decoded.warnings,
            *declaration_conflicts(
                string.attachments,
                weights_m,
                [(section.from_m, section.to_m) for section in given.string.stiff_sections],
                given.free_length_m,
            ),
        ),
        faults=tuple(faults),
        tip_sigma_m=tip_sigma_m(end_m, [cost_m for cost_m, _ in tilted], out),
        attachments=string.attachments,
        target=target,
        contact=detect_contact(tip, target, camera, samples),
        led=led,
        small_frames=small,
    )


def tip_path(time_s: np.ndarray, points_m: np.ndarray, flags: np.ndarray, appearance: Appearance) -> TipPath:
    """Return the path of what meets a target: the string's end, or the middle of the bead that hides it."""
    end_m = points_m[:, -1]
    if not appearance.has_bead:
        return TipPath(time_s, end_m, flags[:, -1] == 0, appearance.half_m)
    along = end_m - points_m[:, -2]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    beyond_m = appearance.beyond_m * along if appearance.beyond_m else 0.0
    return TipPath(time_s, end_m - beyond_m, flags[:, -1] == 0, appearance.bead_m)


def assemble_points(
    time_s: np.ndarray, hand: TrackedHand, string: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places (F, n + 1, 2), sigma and flags (F, n + 1) of hand (0) and string, from the string's.

    Places with implausible acceleration are flagged, short gaps bridged.
    """
    of_hand = hand.pose.position_m, hand.sigma_m, hand.flags
    places, sigma, flags = (
        np.concatenate([first[:, None], rest], axis=1) for first, rest in zip(of_hand, string, strict=True)
    )
    sigma, flags = gate_accelerations(places, sigma, flags, float(np.median(np.diff(time_s))))
    bridged = bridge_points(time_s, places[:, 1:], sigma[:, 1:], flags[:, 1:])
    for every, changed in zip((places, sigma, flags), bridged, strict=True):
        every[:, 1:] = changed
    return places, sigma, flags


def choices(
    string: StringTrack,
    background: str,
    exposure_s: float,
    target_found: bool | None,
    instants: np.ndarray,
) -> dict[str, float | int | str | bool | None]:
    """Return the tracker's estimates and decisions by name; `target_found` is None without a target."""
    appearance, clamp_fit = string.first.appearance, string.clamp_fit
    return {
        "background": background,
        "exposure_s": exposure_s,
        "links": string.first.links,
        "thickness_m": 2 * appearance.half_m,
        "polarity": appearance.polarity,
        "contrast_grey": appearance.contrast,
        **({} if target_found is None else {"target_seen": target_found}),
        "noise_grey": appearance.noise,
        "tip_excess_m": appearance.tip_excess_m,
        "bead_at_tip": appearance.has_bead,
        "length_m": clamp_fit.length_m,
        "length_sigma_m": clamp_fit.length_sigma_m,
        "lateral_offset_m": clamp_fit.lateral_offset_m,
        "lateral_offset_sigma_m": clamp_fit.lateral_offset_sigma_m,
        "length_frames": clamp_fit.frames,
        "redetections": string.first.redetections,
        "strobe_frames": " ".join(map(str, instants)),
    }
