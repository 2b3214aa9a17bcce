"""What a preview tells in words: what was found, with units, and what is wrong, with what to do about it."""

from __future__ import annotations

import numpy as np

from strandcast.tracking.preview import Look, Preview, to_pixels
from strandcast.tracking.target import target_warnings

DARK_SHARE = 0.25  # of the whitest grey, under which the brightest thing makes a dark picture
LEAST_CNR, GOOD_CNR = 5.0, 8.0
BURNT_SHARE = 0.98  # of the whitest grey, from which a level is burnt out
BLUR_PX = 4.0  # wider than in the sharpest frame
THIN_PX = 1.2
SEEN = 0.25  # quality of a node that is seen
MOST_UNSEEN = 0.35  # of the string


def findings(preview: Preview) -> list[str]:
    """Return what the tracker finds by itself, one line each."""
    return [*_hand(preview), *_string(preview), *_target(preview)]


def problems(preview: Preview) -> list[str]:
    """Return what is wrong, the worst first, each with what to do."""
    if not any(look.hand is not None for look in preview.looks):
        return [*_exposure(preview), *_no_hand(preview)]
    told = [*_exposure(preview), *_string_problems(preview), *_outside(preview)]
    if preview.hands_seen < 0.8 * preview.sampled:
        told.append(
            f"the hand's markers are read in {preview.hands_seen} of {preview.sampled} frames only: "
            "light them, print them larger, or shorten the exposure"
        )
    if not preview.calibrated:
        told.append(
            "there is no camera.json: metres are guessed from the size of the hand's markers, the target "
            "cannot be placed; run `strandcast calibrate`"
        )
    return told + target_warnings(preview.target)


def contrast_to_noise(preview: Preview) -> float:
    """Return the string's height in the profile across it over the noise; NaN where no string was found."""
    found = [string.contrast for string in preview.strings]
    return float(np.median(found)) / max(preview.noise, 1e-3) if found else float("nan")


def _hand(preview: Preview) -> list[str]:
    looks = [look for look in preview.looks if look.hand is not None]
    if not looks:
        return []
    ids = sorted({marker for look in looks if look.hand is not None for marker in look.hand.corners_px})
    rms = np.median([look.hand.rms_px for look in looks if look.hand is not None])
    return [
        f"hand: markers {', '.join(map(str, ids))} in {preview.hands_seen} of {preview.sampled} frames; "
        f"corners fit to {rms:.2f} px"
    ]


def _string(preview: Preview) -> list[str]:
    strings = preview.strings
    if not strings or preview.camera is None:
        return []
    width_px = float(np.median([string.width_px for string in strings]))
    scale_mm = 1e3 * preview.camera.scale_m_per_px
    contrast = float(np.median([string.contrast for string in strings]))
    sense = {1.0: "brighter than", -1.0: "darker than", 0.0: "now brighter, now darker than"}
    polarity = float(np.sign(sum(string.polarity for string in strings)))
    return [
        f"string: in {len(strings)} of {len(preview.looks)} frames, {sense[polarity]} the background; "
        f"{width_px:.1f} px = {width_px * scale_mm:.1f} mm wide at half height, blur included",
        f"contrast {contrast:.0f} grey levels, noise {preview.noise:.1f}: "
        f"contrast-to-noise {contrast_to_noise(preview):.0f}",
    ]


def _target(preview: Preview) -> list[str]:
    if not preview.calibrated:
        return []
    if preview.target is None:
        return ["target: nothing distinct is seen at target_m (nothing is taken from the picture then)"]
    off_mm = 1e3 * np.hypot(preview.target.offset_m[0], preview.target.offset_m[1])
    kind = "marker" if preview.target.kind == "marker" else "round thing"
    return [f"target: a {kind} of {2e3 * preview.target.radius_m:.0f} mm, {off_mm:.1f} mm from target_m"]


def _exposure(preview: Preview) -> list[str]:
    told = []
    brightest = float(np.percentile(np.stack([look.image[::4, ::4] for look in preview.looks]), 99.5))
    if brightest < DARK_SHARE * preview.max_level:
        told.append(
            f"too dark: the brightest half per cent reaches {brightest:.0f} of {preview.max_level}; "
            "add light, open the lens, or expose longer"
        )
    burnt = [s for s in preview.strings if max(s.level, s.behind) >= BURNT_SHARE * preview.max_level]
    if burnt:
        what = "string" if burnt[0].level > burnt[0].behind else "background behind the string"
        told.append(f"burnt out: the {what} is as bright as the camera can tell; less light or exposure")
    return told


def _no_hand(preview: Preview) -> list[str]:
    wanted = ", ".join(str(marker.marker) for marker in preview.wanted.markers)
    told = [
        f"none of the hand's markers {wanted} of {preview.wanted.dictionary} is seen "
        f"in {preview.sampled} frames"
    ]
    for other in preview.others:
        ids = ", ".join(map(str, other.ids))
        if other.how == "mirrored":
            told.append(
                f"in a mirror, markers {ids} are seen: the picture is flipped; turn that off in the camera"
            )
        else:
            told.append(f"instead, markers {ids} {other.how} are seen: compare them with the arm's file")
    if not preview.others:
        told.append(
            "no other marker is seen either: is the hand in the picture and sharp, and the white rim around "
            "its markers whole?"
        )
    return told


def _string_problems(preview: Preview) -> list[str]:
    told = _missed(preview)
    if not preview.strings:
        return told
    ratio = contrast_to_noise(preview)
    if ratio < GOOD_CNR:
        bad = "too little" if ratio < LEAST_CNR else "little"
        told.insert(
            0,
            f"{bad} contrast: {ratio:.1f} times the noise, {GOOD_CNR:.0f} is wanted; a thicker or other "
            "coloured string, another background, or more light",
        )
    sharpest = min(string.width_px for string in preview.strings)
    told += [
        f"frame {look.index}: the string is smeared over {look.string.width_px:.1f} px, {sharpest:.1f} px "
        "where it is slow; shorten the exposure"
        for look in preview.looks
        if look.string is not None and look.string.width_px > sharpest + BLUR_PX
    ]
    if sharpest < THIN_PX:
        told.append(f"the string is {sharpest:.1f} px thin: go nearer, or use a longer lens")
    return told + [text for look in preview.looks for text in _unseen(look)]


def _missed(preview: Preview) -> list[str]:
    """Tell of frames with a hand but without a string."""
    missed = [look for look in preview.looks if look.hand is not None and look.string is None]
    near, far = (
        [look for look in missed if (_edge_px(preview, look) < _length_px(preview)) is close]
        for close in (True, False)
    )
    told = []
    if near:
        told.append(
            f"no string is found in frame {_numbers(near)}, where the clamp is nearer to the picture's edge "
            "than the string is long: show more of the scene, if it leaves the picture there"
        )
    if far:
        told.append(
            f"no string is found in frame {_numbers(far)}: it is hidden or folded there, too faint, or the "
            "clamp is not where the arm's file says"
        )
    return told


def _numbers(looks: list[Look]) -> str:
    return ", ".join(str(look.index) for look in looks)


def _edge_px(preview: Preview, look: Look) -> float:
    """Return how far the clamp is from the picture's nearest edge [px]."""
    assert look.hand is not None
    u, v = to_pixels(preview, look.hand.pose[None, :2])[0]
    height, width = preview.background.shape
    return float(min(u, v, width - 1 - u, height - 1 - v))


def _length_px(preview: Preview) -> float:
    assert preview.camera is not None
    return preview.wanted.string.length_m / preview.camera.scale_m_per_px


def _unseen(look: Look) -> list[str]:
    if look.string is None:
        return []
    unseen = float((look.string.quality[1:] < SEEN).mean())
    if unseen < MOST_UNSEEN:
        return []
    return [
        f"frame {look.index}: {100 * unseen:.0f} % of the string is not seen clearly (hidden, or a wrong way)"
    ]


def _outside(preview: Preview) -> list[str]:
    told = []
    height, width = preview.background.shape
    for look in preview.looks:
        if look.string is None:
            continue
        u, v = to_pixels(preview, look.string.points_m).T
        sides = {"left": u < 0, "right": u > width - 1, "top": v < 0, "bottom": v > height - 1}
        left_at = [side for side, over in sides.items() if over.any()]
        if left_at:
            told.append(f"frame {look.index}: the string leaves the picture at the {' and '.join(left_at)}")
    return told
