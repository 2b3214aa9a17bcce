"""A preview shows hand, string and problems, from a few frames and without a calibration."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from strandcast.core.hand_marker import HandMarker
from strandcast.stages.preview import run
from strandcast.tracking.preview.findings import contrast_to_noise, findings, problems
from strandcast.tracking.preview.picture import preview_picture, shown_size, shown_window, spots_px
from strandcast.tracking.preview.preview import Expected, preview, sample_video
from strandcast.tracking.tracker import StringHint
from strandcast.video.ingest import camera_times, inspect_video

LENGTH_M, NOISE = 0.3, 2.5


def expected(scene, marker=7, dictionary="DICT_4X4_50"):
    hand = [HandMarker(marker, scene.MARKER_M, scene.MARKER_PLACE_M)]
    return Expected(StringHint(LENGTH_M, 10), hand, dictionary, np.array([0.2, -0.2]), (0.1,))


@pytest.fixture(scope="module")
def sampled(filmed):
    facts = inspect_video(filmed[0])
    return sample_video(filmed[0], facts, 24)


@pytest.fixture(scope="module")
def seen(scene, sampled):
    return preview(sampled, scene.flat_camera(), expected(scene))


def changed(sampled, change):
    """The same frames with each picture changed."""
    return replace(sampled, pictures=[change(picture) for picture in sampled.pictures])


@pytest.mark.thorough
def test_samples_are_spread_over_the_video(filmed, sampled):
    facts = inspect_video(filmed[0])
    assert (sampled.indices[0], sampled.indices[-1], sampled.decoded) == (0, 109, 110)
    assert len(sampled.pictures) == 24
    assert np.allclose(sampled.time_s, camera_times(facts)[sampled.indices])


def test_hand_and_string_are_found_at_their_places(scene, filmed, seen):
    _, hands, curves = filmed
    assert seen.hands_found == seen.sampled == 24
    assert len(seen.frames) == 6
    assert len(seen.strings) >= 5
    for frame in seen.frames:
        assert np.hypot(*(frame.hand.pose.position_m - hands[frame.index][:2])) < 0.001
    near = []
    for frame in seen.frames:
        if frame.string is not None:
            course = curves[frame.index]
            apart = np.linalg.norm(frame.string.nodes_m[:, None] - course[None], axis=2).min(axis=1)
            near.append(np.median(apart) / scene.SCALE_M)
    assert np.median(near) < 0.7


def test_the_string_is_measured_in_each_frame(seen):
    string = seen.strings[0]
    assert (string.polarity, string.profile[len(string.profile) // 2] < -60) == (-1.0, True)
    assert string.width_px == pytest.approx(2.6, abs=0.5)  # 2 px thick, and the blur
    assert string.contrast == pytest.approx(string.behind - string.level, rel=0.15)
    assert seen.noise == pytest.approx(NOISE, rel=0.12)
    assert contrast_to_noise(seen) == pytest.approx(string.contrast / NOISE, rel=0.25)


def test_the_findings_are_listed(seen):
    lines = "\n".join(findings(seen))
    assert "hand: markers 7 in 24 of 24 frames" in lines
    assert "darker than the background" in lines
    assert "target: nothing distinct" in lines


def test_without_calibration_metres_are_estimated(scene, sampled):
    rough = preview(sampled, None, expected(scene))
    assert not rough.calibrated
    assert rough.camera.scale_m_per_px == pytest.approx(scene.SCALE_M, rel=0.03)
    assert len(rough.strings) >= 4
    assert any("no calibration" in text for text in problems(rough))
    assert preview_picture(rough, "x").ndim == 3


@pytest.mark.parametrize(
    ("marker", "dictionary", "mirror", "words"),
    [
        (3, "DICT_4X4_50", False, "markers 7 of DICT_4X4_50 are found"),
        (7, "DICT_5X5_50", False, "markers 7 of DICT_4X4_1000 are found"),
        (7, "DICT_4X4_50", True, "the picture is flipped"),
    ],
)
def test_other_markers_are_named(scene, sampled, marker, dictionary, mirror, words):
    frames = changed(sampled, lambda picture: np.ascontiguousarray(picture[:, ::-1])) if mirror else sampled
    none = preview(frames, scene.flat_camera(), expected(scene, marker, dictionary))
    lines = problems(none)
    assert f"none of the hand's markers {marker} of {dictionary}" in lines[0]
    assert words in "\n".join(lines)
    assert preview_picture(none, "x").ndim == 3


def test_a_hand_outside_the_picture_is_reported(scene, sampled):
    none = preview(changed(sampled, lambda picture: np.full_like(picture, 120)), None, expected(scene))
    assert "no other marker is found either" in "\n".join(problems(none))


def test_dark_burnt_and_faint_pictures_are_reported(scene, sampled):
    camera, want = scene.flat_camera(), expected(scene)
    dark = preview(changed(sampled, lambda picture: (picture * 0.2).astype(np.uint8)), camera, want)
    assert problems(dark)[0].startswith("too dark")
    bright = changed(sampled, lambda picture: np.minimum(picture.astype(int) + 95, 255).astype(np.uint8))
    assert "burnt out: the background" in "\n".join(problems(preview(bright, camera, want)))
    rng = np.random.default_rng(0)

    def noisy(picture):
        return np.clip(picture + rng.normal(0, 18, picture.shape), 0, 255).astype(np.uint8)

    lines = "\n".join(problems(preview(changed(sampled, noisy), camera, want)))
    assert "contrast:" in lines or "no string is found" in lines


def test_a_string_that_leaves_the_picture_is_reported(scene, sampled):
    def cropped(picture):
        return np.ascontiguousarray(picture[:330])

    camera = scene.flat_camera()
    lens = camera.lens.model_copy(update={"height_px": 330})
    lines = problems(
        preview(changed(sampled, cropped), camera.model_copy(update={"lens": lens}), expected(scene))
    )
    assert any(
        "leaves the picture at the bottom" in text or "nearer to the picture's edge" in text for text in lines
    )


def test_each_panel_shows_hand_and_string_at_one_scale(scene, seen):
    size = shown_size(seen)
    for frame in seen.frames:
        left, right, top, bottom = shown_window(seen, frame, size)
        assert (right - left, bottom - top) == pytest.approx(size)
        points = scene.to_pixels(frame.string.points_m) if frame.string is not None else np.zeros((0, 2))
        spots = np.concatenate([points, frame.hand.corners_px[7]])
        assert np.allclose(
            np.sort(spots, axis=0)[[0, -1]], np.sort(spots_px(seen, frame), axis=0)[[0, -1]], atol=0.1
        )
        assert left <= spots[:, 0].min()
        assert spots[:, 0].max() <= right
        assert top <= spots[:, 1].min()
        assert spots[:, 1].max() <= bottom


def test_detections_are_drawn_in_colour(seen):
    plain = preview_picture(
        replace(seen, frames=[replace(frame, hand=None, string=None) for frame in seen.frames]), "x"
    )
    marked = preview_picture(seen, "x")
    assert marked.shape == plain.shape
    coloured = (np.ptp(marked.astype(int), axis=2) > 60).sum()
    assert coloured > 2000
    assert (np.ptp(plain.astype(int), axis=2) > 60).sum() < 0.6 * coloured


EXPERIMENT = """
string: {length_m: 0.3}
arm: one-marker
target_m: [0.2, -0.2]
track: {background_picture: empty.png}
"""


@pytest.fixture
def root(scene, filmed, seen, project_root, tmp_path):
    """A project with one trial: the small world's video, and an arm that carries its marker."""
    arms = tmp_path / "config" / "arms"
    arms.mkdir(parents=True)
    text = (project_root / "config" / "arms" / "planar3.toml").read_text()
    head, _, rest = text.partition("[[markers.hand]]")
    tail = rest[rest.index("[limits]") :]
    marker = (
        "[[markers.hand]]\nid = 7\nsize_m = 0.05\nplace_m = [-0.06, 0.0]\nangle_rad = 0.0\noffset_m = 0.0\n"
    )
    (arms / "one-marker.toml").write_text(head.replace('"planar3"', '"one-marker"') + marker + tail)
    (arms / "planar3.urdf").write_bytes((project_root / "config" / "arms" / "planar3.urdf").read_bytes())
    data = tmp_path / "data" / "small"
    (data / "trial-01").mkdir(parents=True)
    (data / "experiment.yaml").write_text(EXPERIMENT)
    (data / "trial-01" / "video.mkv").write_bytes(filmed[0].read_bytes())
    cv2.imwrite(str(data / "empty.png"), seen.background)
    return tmp_path


@pytest.mark.thorough
def test_the_command_writes_a_picture_and_prints_its_findings(scene, root):
    lines = run(root, "small", 1)
    assert any("no calibration" in line for line in lines)
    scene.flat_camera().write(root / "results" / "small" / "cameras" / "main.json")
    lines = run(root, "small", 1)
    assert "110 frames at 500/s" in lines[0]
    assert any(line.startswith("string: in ") for line in lines)
    assert not any("no calibration" in line for line in lines)
    picture = cv2.imread(str(root / "results" / "small" / "trial-01" / "preview.webp"))
    assert picture.shape == (980, 1500, 3)


def test_a_given_background_must_fit(root):
    empty = root / "data" / "small" / "empty.png"
    cv2.imwrite(str(empty), np.zeros((10, 12), np.uint8))
    with pytest.raises(Exception, match="12 x 10 px") as problem:
        run(root, "small", 1)
    assert problem.value.code == "SC-T030"
    empty.unlink()
    with pytest.raises(Exception, match="no picture of the empty scene") as problem:
        run(root, "small", 1)
    assert problem.value.code == "SC-T030"
