"""One trial's video to its track: the decoding pass, the hand, the string, and an honest account of both."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.camera.markers import eight_bit
from strandcast.camera.moved import Moved, check_moved, refuse_moved
from strandcast.camera.tilt import find_tilt, refuse_tilt
from strandcast.errors import StrandcastError
from strandcast.progress import Progress
from strandcast.records.camera import Camera
from strandcast.records.manifest import VideoFacts
from strandcast.tracking.attachments import Attachments, see_attachments
from strandcast.tracking.background import Samples, learn_background
from strandcast.tracking.contact import notice_contact
from strandcast.tracking.counts import check_count, check_size, open_ingested
from strandcast.tracking.crops import Crops
from strandcast.tracking.fit import Fit
from strandcast.tracking.follower import Follower, Sight
from strandcast.tracking.grasp import LEAST_FRAMES, Grasp, learn_grasp
from strandcast.tracking.hand import HandFinder, HandMarker, HandSighting, box_around, place
from strandcast.tracking.hand_path import HandPath, bridge_hand
from strandcast.tracking.judge import FrameResult, judge
from strandcast.tracking.jumps import doubt_jumps
from strandcast.tracking.led import LedPlace, LedWatch
from strandcast.tracking.looks import BALL_TIMES, learn_looks, level_at, seen_length
from strandcast.tracking.passes import Look, chain_of, follow, refine, survey, ways_of
from strandcast.tracking.picture import Looks, Picture
from strandcast.tracking.pixelmap import tabulate
from strandcast.tracking.result import StringHint, Tracked, as_columns
from strandcast.tracking.strobe import choose_instants, strobe_picture
from strandcast.tracking.target import locate_target, target_warnings
from strandcast.tracking.tip import place_on
from strandcast.video.ingest import camera_times

CROP_LENGTHS = 1.25  # around the hand, in lengths of the string
POLARITIES = {"bright": 1.0, "dark": -1.0, "auto": None}
EXPOSURE_SHARE = 0.2  # of the frame interval, where the exposure is not given
END_BALL_M = 0.01  # from the tip, within which a weight is the tip's own
LEVEL_FRAMES = 15
DECODER_THREADS = 2  # beside this process, which looks for the hand meanwhile
LEAST_SEEN = 0.3  # of the frames, under which it is warned
OTHER_LIGHT = 0.15  # by which a given picture of the scene may be brighter or darker than the video
MOVED_FRAMES = 4  # that are held against the photo of the plane
LARGEST_CORRECTION = 0.03  # of the length


@dataclass(frozen=True)
class Options:
    """What the tracker finds out by itself, unless it is told.

    Attributes
    ----------
    background
        A grey picture of the empty scene (H, W); by default a median over frames.
    background_frames
        Frames of which the background is the median.
    exposure_s
        The camera's exposure; by default a fifth of the frame interval.
    polarity
        Whether the string is "bright" or "dark" before the background, or "auto".
    contrast_grey
        By how many grey levels a clear piece of string differs from what is beside it.
    led
        Where an LED that the robot switches is looked for.
    """

    background: np.ndarray | None = None
    background_frames: int = 40
    exposure_s: float | None = None
    polarity: str = "auto"
    contrast_grey: float | None = None
    led: LedPlace | None = None


def track_video(
    path: str | Path,
    facts: VideoFacts,
    camera: Camera,
    string: StringHint,
    markers: list[HandMarker],
    dictionary: str = "DICT_4X4_50",
    options: Options = Options(),
    target_m: np.ndarray | None = None,
) -> Tracked:
    """Track the hand and the string through a video.

    The string is followed both ways from the frame that shows it best. What all frames then tell of its
    length, of how the clamp holds it and of what hangs on it goes into a second fit of each frame.

    Parameters
    ----------
    path
        The video.
    facts
        Its manifest entry: time stamps, and the count that the decoded frames are held against.
    camera
        Lens, pose and the string's plane.
    string
        What is known of the string.
    markers, dictionary
        The markers on the hand.
    options
        What is not to be found out.
    target_m
        The target, to be looked for in the picture (m), (2,).

    Raises
    ------
    StrandcastError
        SC-T001 the decoded count differs from the manifest's; SC-T002 the picture's size is not the
        calibration's; SC-T003 the hand's markers are never seen; SC-T004 no string leaves the hand; SC-T033
        the LED's window is not in the picture.
    """
    check_size(facts, camera, path)
    exposure_s = options.exposure_s or EXPOSURE_SHARE / facts.frame_rate_hz
    plane = tabulate(camera, camera.string_offset_m)
    finder = HandFinder(camera, markers, dictionary, camera.string_offset_m)
    watch = None if options.led is None else LedWatch(options.led, camera)
    time_s = camera_times(facts)
    with Crops(plane, CROP_LENGTHS * string.length_m) as crops:
        scene = decode(path, facts, finder, crops, options, watch)
        check_hand(scene.hands, finder, path)
        hand = bridge_hand(time_s, scene.hands)
        look = looker(crops, scene.background, hand, time_s, box_around(markers), 0.0)
        sightings = survey(look, np.flatnonzero(hand.flags == 0), string, POLARITIES[options.polarity])
        if not sightings:
            raise StrandcastError(
                "SC-T004", "no string is seen to leave the hand in any frame", file=path,
                fix="look at `strandcast preview`; check the clamp's place and angle in the arm's file, the "
                "light, and what is set of track.polarity, contrast_grey and background_picture")  # fmt: skip
        looks = learn_looks(sightings, plane.metre_per_pixel)
        if options.contrast_grey is not None:
            looks = looks._replace(contrast=options.contrast_grey)
        links, every = chain_of(string)
        length_m = seen_length(sightings, looks, string.length_m)
        ball = tip_ball(looks, length_m)
        follower = Follower(links, length_m / links, looks, ball, exposure_s)
        fits = follow(look, len(scene.hands), sightings, follower)
        grasp = learn_grasp(length_m, *ways_of(look, fits))
        seen = attachments_of(look, fits, links, looks)
        seen = seen.moved(grasp.length_m - length_m)
        balls = all_balls(look, fits, seen, looks, length_m, grasp)
        look = looker(crops, scene.background, hand, time_s, box_around(markers), grasp.aside_m)
        fits = refine(look, fits, grasp.length_m / links, looks, balls, exposure_s)
        results = [judge_frame(look(index), fit, every, grasp) for index, fit in enumerate(fits)]
    tracked = collect(time_s, hand, results, string.points)
    tracked.attachments = seen
    tracked.markers = marker_columns(finder, scene.hands, time_s)
    if target_m is not None:
        tracked.target = locate_target(scene.background, camera, target_m)
        tracked.warnings += target_warnings(tracked.target)
        tracked.contact = notice_contact(
            time_s, tracked.points_m[:, -1], tracked.flags[:, -1] == 0, looks.tip_excess_m, tracked.target,
            camera, scene.samples.pictures, np.asarray(scene.samples.indices),
        )  # fmt: skip
    instants = choose_instants(np.asarray(scene.samples.indices), tracked.points_m)
    pictures = [scene.samples.pictures[k] for k in np.searchsorted(scene.samples.indices, instants)]
    tracked.strobe = strobe_picture(scene.background, pictures, tracked.points_m[instants], camera)
    tracked.choices |= {
        "background": "given" if options.background is not None else f"median of {len(scene.chosen)} frames",
        "exposure_s": exposure_s,
        "links": links,
        "thickness_m": 2 * looks.half_m,
        "polarity": looks.polarity,
        "contrast_grey": looks.contrast,
        "target_seen": tracked.target is not None,
        "noise_grey": looks.noise,
        "tip_excess_m": looks.tip_excess_m,
        "ball_at_tip": looks.has_ball,
        "length_m": grasp.length_m,
        "length_sigma_m": grasp.length_sigma_m,
        "aside_m": grasp.aside_m,
        "aside_sigma_m": grasp.aside_sigma_m,
        "length_frames": grasp.frames,
        "found_anew": follower.found_anew,
        "strobe_frames": " ".join(map(str, instants)),
    }
    if watch is not None:
        tracked.led, unlit = watch.found(time_s, options.exposure_s)
        tracked.warnings += unlit
    tracked.warnings += scene_warnings(camera, finder, scene, path)
    tracked.warnings += finder.contradictions()
    tracked.warnings += doubts(tracked)
    tracked.warnings += grasp_warnings(grasp, string.length_m)
    tracked.warnings += scene.complaints
    return tracked


def looker(
    crops: Crops, background: np.ndarray, hand: HandPath, time_s: np.ndarray, box: np.ndarray, aside_m: float
) -> Look:
    """Return the function that gives each frame as the string is looked for, None where there is no hand."""
    background = np.ascontiguousarray(background)
    beside = np.array([[0.0, aside_m]])

    def look(index: int) -> Sight | None:
        crop, pose = crops.at(index), hand.pose[index]
        if crop is None or not np.isfinite(pose).all():
            return None
        picture = Picture(*crop, background, crops.plane, np.concatenate([pose, box]))
        return Sight(picture, float(time_s[index]), pose, place(pose, beside)[0])

    return look


def tip_ball(looks: Looks, length_m: float) -> np.ndarray:
    """Return the ball at the tip, (1, 3) as `fit_frame` takes it, or none, (0, 3)."""
    if not looks.has_ball:
        return np.zeros((0, 3))
    return np.array([[length_m, looks.tip_excess_m, looks.ball_level]])


def attachments_of(look: Look, fits: list[Fit | None], links: int, looks: Looks) -> Attachments:
    """Return what is seen on the string, its places along the chain as it was followed."""
    nodes = np.full((len(fits), links + 1, 2), np.nan)
    quality = np.zeros((len(fits), links + 1))
    for index, fit in enumerate(fits):
        if fit is not None:
            nodes[index], quality[index] = fit.nodes(), fit.reward

    def picture(index: int) -> Picture | None:
        at = look(index)
        return None if at is None else at.picture

    return see_attachments(picture, nodes, quality, looks.level, looks.contrast)


def all_balls(
    look: Look, fits: list[Fit | None], seen: Attachments, looks: Looks, length_m: float, grasp: Grasp
) -> np.ndarray:
    """Return the balls on the string (B, 3), as `fit_frame` takes them: the weights seen, the tip's last."""
    at_tip = tip_ball(looks, grasp.length_m)
    wide_m = BALL_TIMES * looks.half_m  # a smaller weight is no ball that can be followed
    places = [w for w in seen.weights if w.half_width_m > wide_m and w.place_m < grasp.length_m - END_BALL_M]
    inner = [
        (w.place_m, w.half_width_m, ball_level(look, fits, w.place_m - (grasp.length_m - length_m)))
        for w in places
    ]
    known = [ball for ball in inner if np.isfinite(ball[2])]
    return np.concatenate([np.array(known).reshape(-1, 3), at_tip])


def ball_level(look: Look, fits: list[Fit | None], place_m: float) -> float:
    """Return the grey level at a place along the chain: the median over frames spread over the video."""
    levels = []
    for index in np.linspace(0, len(fits) - 1, LEVEL_FRAMES).astype(int).tolist():
        fit, at = fits[index], look(index)
        if fit is not None and at is not None:
            levels.append(level_at(at.picture, place_on(fit.nodes(), fit.heading, place_m)))
    return float(np.median(levels)) if levels else float("nan")


def grasp_warnings(grasp: Grasp, given_m: float) -> list[str]:
    """Warn of a string that is seen to be of another length than it was given."""
    off_m = grasp.length_m - given_m
    if grasp.frames < LEAST_FRAMES:
        return [
            f"the string is seen to end in {grasp.frames} frames only: its length is as given, "
            f"{1e3 * given_m:.0f} mm; if that is wrong, so are all places along it"
        ]
    if abs(off_m) < LARGEST_CORRECTION * given_m:
        return []
    return [
        f"string.length_m: given {1e3 * given_m:.0f} mm, seen {1e3 * grasp.length_m:.0f} mm; "
        "measure it from the clamp to the tip"
    ]


def judge_frame(sight: Sight | None, fit: Fit | None, every: int, grasp: Grasp) -> FrameResult | None:
    """Return the mass points of a frame, None where the string was not found."""
    if sight is None or fit is None:
        return None
    return judge(fit, every, sight.picture, sight.clamp_m, grasp.length_sigma_m)


@dataclass(frozen=True)
class Scene:
    """What the decoding pass found.

    Attributes
    ----------
    hands
        The hand per frame.
    complaints
        What is to be warned of in the video itself.
    background, chosen
        The scene without arm and string, and the frames that it was learned from.
    samples
        Whole frames that were kept.
    """

    hands: list[HandSighting | None]
    complaints: list[str]
    background: np.ndarray
    chosen: np.ndarray
    samples: Samples


def decode(
    path: str | Path,
    facts: VideoFacts,
    finder: HandFinder,
    crops: Crops,
    options: Options,
    watch: LedWatch | None = None,
) -> Scene:
    """Make the one decoding pass: find hand and LED, keep a crop around the hand, learn the background."""
    hands: list[HandSighting | None] = []
    tell = Progress("track: frames", total=facts.packets)
    with open_ingested(path, facts, threads=DECODER_THREADS) as video:
        depth = 1 if video.info.max_level < 256 else 2
        samples = Samples(
            facts.packets, options.background_frames, depth * video.info.width * video.info.height
        )
        for index, _, image in video:
            samples.offer(index, image)
            hands.append(finder.find(image))
            crops.keep(image, None if hands[-1] is None else hands[-1].pose)
            if watch is not None:
                watch.look(image)
            tell(index + 1)
    check_count(len(hands), facts, path)
    background, chosen = learn_background(samples.pictures, options.background_frames)
    if options.background is not None:
        background = given_background(options.background, background)
    return Scene(hands, video.warnings(), background, np.asarray(samples.indices)[chosen], samples)


def given_background(given: np.ndarray, learned: np.ndarray) -> np.ndarray:
    """Return the given picture of the empty scene, as deep as the video; refuse one of another light."""
    if given.dtype != learned.dtype:
        given = eight_bit(given) if learned.dtype == np.uint8 else given.astype(learned.dtype)
    light, usual = float(np.median(given)), float(np.median(learned))
    if abs(light - usual) > OTHER_LIGHT * max(usual, 1.0):
        raise StrandcastError(
            "SC-T032", f"the picture of the empty scene has a median grey level of {light:.0f}, the video of "
            f"{usual:.0f}", field="track.background_picture",
            fix="take it with the video's exposure and light, or leave the setting out")  # fmt: skip
    return given


def check_hand(hands: list[HandSighting | None], finder: HandFinder, path: str | Path) -> None:
    """Refuse a video in which the hand is never seen."""
    if not any(hands):
        raise StrandcastError(
            "SC-T003", finder.why_not(), file=path, field="markers",
            fix="check ids, dictionary, sizes and places in the arm's file, and that the picture is neither "
            "mirrored nor inverted; `strandcast preview` shows what is seen")  # fmt: skip


def scene_warnings(camera: Camera, finder: HandFinder, scene: Scene, path: str | Path) -> list[str]:
    """Hold the throw's frames against the calibration; refuse a moved camera, a hand in another plane."""
    warnings = refuse_moved(moves(camera, scene.samples), path)
    for marker, shape in finder.markers.items():
        seen = [hand.corners_px[marker] for hand in scene.hands if hand and marker in hand.corners_px]
        if seen:
            offset_m = finder.string_offset_m + shape.offset_m
            tilt = find_tilt(camera, np.stack(seen), shape.size_m, offset_m)
            warnings += refuse_tilt(tilt, path) if tilt is not None else []
    return warnings


def moves(camera: Camera, samples: Samples) -> list[tuple[int, Moved]]:
    """Return the plane's markers in a few frames against their photo, those left out that show too few."""
    chosen = np.unique(np.linspace(0, len(samples.pictures) - 1, MOVED_FRAMES).astype(int)).tolist()
    seen = [(samples.indices[k], check_moved(camera, eight_bit(samples.pictures[k]))) for k in chosen]
    return [(index, moved) for index, moved in seen if moved is not None]


def doubts(tracked: Tracked) -> list[str]:
    """Warn of a string, or a tip, that is hardly ever seen without doubt."""
    seen = np.isfinite(tracked.points_m).all(axis=2) & (tracked.flags == 0)
    told = []
    for what, share in (("the points", float(seen[:, 1:].mean())), ("the tip", float(seen[:, -1].mean()))):
        if share < LEAST_SEEN:
            told.append(
                f"{what}: seen without doubt in {100 * share:.0f} % of the frames; `strandcast preview` "
                "shows what the tracker sees"
            )
    return told


def collect(time_s: np.ndarray, hand: HandPath, results: list[FrameResult | None], points: int) -> Tracked:
    """Put the frames' results into arrays."""
    count = len(results)
    places = np.full((count, points + 1, 2), np.nan)
    sigma = np.full((count, points + 1), np.nan)
    flags = np.zeros((count, points + 1), dtype=np.int32)
    places[:, 0], sigma[:, 0], flags[:, 0] = hand.pose[:, :2], hand.sigma_m, hand.flags
    for index, result in enumerate(results):
        if result is not None:
            places[index, 1:], sigma[index, 1:], flags[index, 1:] = (
                result.points_m,
                result.sigma_m,
                result.flags,
            )
    doubt_jumps(places, sigma, flags, float(np.median(np.diff(time_s))))
    return Tracked(time_s, places, sigma, flags, {}, np.zeros((1, 1, 3), np.uint8), count, {})


def marker_columns(
    finder: HandFinder, hands: list[HandSighting | None], time_s: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the columns of markers.parquet: each marker seen on the hand, by frame."""
    parts = []
    for marker in finder.markers:
        frames = [index for index, hand in enumerate(hands) if hand is not None and marker in hand.corners_px]
        if frames:
            seen = [
                hand.corners_px[marker] for hand in hands if hand is not None and marker in hand.corners_px
            ]
            pose, sigma_m = finder.marker_poses(marker, np.stack(seen))
            pose[:, 2] = np.unwrap(pose[:, 2])
            parts.append(
                np.column_stack([frames, time_s[frames], np.full(len(frames), marker), pose, sigma_m])
            )
    table = np.concatenate(parts) if parts else np.zeros((0, 7))
    table = table[np.lexsort((table[:, 2], table[:, 0]))]
    return as_columns(table)
