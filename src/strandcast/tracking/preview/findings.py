"""The preview as text: findings with units, and problems with their fixes."""

import numpy as np

from strandcast.tracking.events.target import target_warnings
from strandcast.tracking.preview.preview import Preview, PreviewFrame, to_pixels

DARK_SHARE = 0.25  # of the whitest grey; a picture is dark if its brightest part is below
LEAST_CNR, GOOD_CNR = 5.0, 8.0
BURNT_SHARE = 0.98  # of the whitest grey, from which a level is burnt out
BLUR_PX = 4.0  # wider than in the sharpest frame
THIN_PX = 1.2
CLEAR = 0.25  # least quality of a visible node
MOST_HIDDEN = 0.35  # of the string


def findings(preview: Preview) -> list[str]:
    """Return the tracker's findings, one line each."""
    return [*_hand(preview), *_string(preview), *_target(preview)]


def problems(preview: Preview) -> list[str]:
    """Return the problems, the worst first, each with its fix."""
    if not any(frame.hand is not None for frame in preview.frames):
        return [*_exposure(preview), *_no_hand(preview)]
    lines = [*_exposure(preview), *_string_problems(preview), *_outside(preview)]
    if preview.hands_found < 0.8 * preview.sampled:
        lines.append(
            f"the hand's markers are read in {preview.hands_found} of {preview.sampled} frames only: "
            "light them, print them larger, or shorten the exposure"
        )
    if not preview.calibrated:
        lines.append(
            "there is no calibration: metres are estimated from the size of the hand's markers, the target "
            "cannot be placed; run `strandcast stage calibrate`"
        )
    return lines + target_warnings(preview.target)


def contrast_to_noise(preview: Preview) -> float:
    """Return the height of the string's profile over the noise; NaN if no string is found."""
    contrasts = [string.contrast for string in preview.strings]
    return float(np.median(contrasts)) / max(preview.noise, 1e-3) if contrasts else float("nan")


def _hand(preview: Preview) -> list[str]:
    frames = [frame for frame in preview.frames if frame.hand is not None]
    if not frames:
        return []
    ids = sorted({marker for frame in frames if frame.hand is not None for marker in frame.hand.corners_px})
    rms = np.median([frame.hand.rms_px for frame in frames if frame.hand is not None])
    return [
        f"hand: markers {', '.join(map(str, ids))} in {preview.hands_found} of {preview.sampled} frames; "
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
        f"string: in {len(strings)} of {len(preview.frames)} frames, {sense[polarity]} the background; "
        f"{width_px:.1f} px = {width_px * scale_mm:.1f} mm wide at half height, blur included",
        f"contrast {contrast:.0f} grey levels, noise {preview.noise:.1f}: "
        f"contrast-to-noise {contrast_to_noise(preview):.0f}",
    ]


def _target(preview: Preview) -> list[str]:
    if not preview.calibrated or preview.expected.target_m is None:
        return []
    if preview.target is None:
        return ["target: nothing distinct is detected at target_m, so the image is not used for it"]
    off_mm = 1e3 * np.hypot(preview.target.offset_m[0], preview.target.offset_m[1])
    kind = "marker" if preview.target.kind == "marker" else "round object"
    return [f"target: a {kind} of {2e3 * preview.target.radius_m:.0f} mm, {off_mm:.1f} mm from target_m"]


def _exposure(preview: Preview) -> list[str]:
    lines = []
    brightest = float(np.percentile(np.stack([frame.image[::4, ::4] for frame in preview.frames]), 99.5))
    if brightest < DARK_SHARE * preview.max_level:
        lines.append(
            f"too dark: the brightest half per cent reaches {brightest:.0f} of {preview.max_level}; "
            "add light, open the lens, or expose longer"
        )
    burnt = [s for s in preview.strings if max(s.level, s.behind) >= BURNT_SHARE * preview.max_level]
    if burnt:
        what = "string" if burnt[0].level > burnt[0].behind else "background behind the string"
        lines.append(f"burnt out: the {what} saturates the camera; use less light or exposure")
    return lines


def _no_hand(preview: Preview) -> list[str]:
    expected = ", ".join(str(marker.id) for marker in preview.expected.markers)
    lines = [
        f"none of the hand's markers {expected} of {preview.expected.dictionary} is found "
        f"in {preview.sampled} frames"
    ]
    for how, found in preview.others.items():
        ids = ", ".join(map(str, found))
        if how == "mirrored":
            lines.append(
                f"markers {ids} are found mirrored: the picture is flipped; turn that off in the camera"
            )
        else:
            lines.append(f"instead, markers {ids} {how} are found: compare them with the arm's file")
    if not preview.others:
        lines.append(
            "no other marker is found either: is the hand in the picture and sharp, and the white rim around "
            "its markers whole?"
        )
    return lines


def _string_problems(preview: Preview) -> list[str]:
    lines = _missed(preview)
    if not preview.strings:
        return lines
    ratio = contrast_to_noise(preview)
    if ratio < GOOD_CNR:
        bad = "too little" if ratio < LEAST_CNR else "little"
        lines.insert(
            0,
            f"{bad} contrast: {ratio:.1f} times the noise, {GOOD_CNR:.0f} is expected; a thicker or other "
            "colour, another background, or more light",
        )
    sharpest = min(string.width_px for string in preview.strings)
    lines += [
        f"frame {frame.index}: the string is blurred over {frame.string.width_px:.1f} px, {sharpest:.1f} px "
        "where it is slow; shorten the exposure"
        for frame in preview.frames
        if frame.string is not None and frame.string.width_px > sharpest + BLUR_PX
    ]
    if sharpest < THIN_PX:
        lines.append(f"the string is {sharpest:.1f} px thin: move the camera closer, or use a longer lens")
    return lines + [text for frame in preview.frames for text in _hidden(frame)]


def _missed(preview: Preview) -> list[str]:
    """Return the problems of frames with a hand but without a string."""
    missed = [frame for frame in preview.frames if frame.hand is not None and frame.string is None]
    near, far = (
        [frame for frame in missed if (_edge_px(preview, frame) < _length_px(preview)) is close]
        for close in (True, False)
    )
    lines = []
    if near:
        lines.append(
            f"no string is found in frame {_numbers(near)}, where the clamp is nearer to the picture's edge "
            "than the string is long: show more of the scene, if it leaves the picture there"
        )
    if far:
        lines.append(
            f"no string is found in frame {_numbers(far)}: it is hidden or folded there, too faint, or the "
            "clamp is not where the arm's file says"
        )
    return lines


def _numbers(frames: list[PreviewFrame]) -> str:
    return ", ".join(str(frame.index) for frame in frames)


def _edge_px(preview: Preview, frame: PreviewFrame) -> float:
    """Return the distance from the clamp to the picture's nearest edge [px]."""
    assert frame.hand is not None
    u, v = to_pixels(preview, frame.hand.pose.position_m[None])[0]
    height, width = preview.background.shape
    return float(min(u, v, width - 1 - u, height - 1 - v))


def _length_px(preview: Preview) -> float:
    assert preview.camera is not None
    return preview.expected.string.length_m / preview.camera.scale_m_per_px


def _hidden(frame: PreviewFrame) -> list[str]:
    if frame.string is None:
        return []
    hidden = float((frame.string.quality[1:] < CLEAR).mean())
    if hidden < MOST_HIDDEN:
        return []
    return [f"frame {frame.index}: {100 * hidden:.0f} % of the string is not clear (hidden, or a wrong path)"]


def _outside(preview: Preview) -> list[str]:
    lines = []
    height, width = preview.background.shape
    for frame in preview.frames:
        if frame.string is None:
            continue
        u, v = to_pixels(preview, frame.string.points_m).T
        sides = {"left": u < 0, "right": u > width - 1, "top": v < 0, "bottom": v > height - 1}
        left_at = [side for side, over in sides.items() if over.any()]
        if left_at:
            lines.append(f"frame {frame.index}: the string leaves the picture at the {' and '.join(left_at)}")
    return lines
