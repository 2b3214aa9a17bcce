"""A camera that was bumped after the photo of the plane: found in frames of real video files."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from strandcast.camera.moved import Moved, check_moved, refuse_moved
from strandcast.camera.plane import PlaneMarker, plane_from_markers
from strandcast.errors import StrandcastError

DICTIONARY = "DICT_4X4_50"
MARKERS = [
    PlaneMarker(0, -0.6, 0.35, 0.08),
    PlaneMarker(1, 0.6, 0.35, 0.08),
    PlaneMarker(2, 0.6, -0.3, 0.08, -1.0),
    PlaneMarker(3, -0.6, -0.3, 0.08),
    PlaneMarker(4, 0.05, 0.3, 0.08, 3.0),
]
POSE = (0.06, -0.1, 0.03, (0.0, 0.02), 1.9)


@pytest.fixture(scope="module")
def take(photograph, paint_markers, looking, lens):
    """Return a function: (shift of the gaze in pixels, turn, seed) -> a frame with lower light and noise."""
    texture, to_texture = paint_markers(MARKERS, DICTIONARY)

    def frame(
        gaze_px=(0.0, 0.0), turn_rad=0.0, nearer_m=0.0, seed=0, noise=4.0, texture=texture
    ) -> np.ndarray:
        rotation, shift = looking(*POSE)
        gaze = np.array([-gaze_px[1] / 1090, gaze_px[0] / 1100, turn_rad])
        bump, _ = cv2.Rodrigues(gaze)
        picture = photograph(
            texture, to_texture, lens, bump @ rotation, bump @ shift - (0, 0, nearer_m), noise, seed
        )
        return (0.9 * picture).astype(np.uint8)

    return frame


@pytest.fixture(scope="module")
def camera(take, lens):
    return plane_from_markers(take(seed=99, noise=2.0), lens, MARKERS, DICTIONARY)


def film(path: Path, frames: list[np.ndarray]) -> list[np.ndarray]:
    """Write frames as H.264 at qp 18 and read them back."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=500, options={"qp": "18"})
        stream.width, stream.height, stream.pix_fmt = frames[0].shape[1], frames[0].shape[0], "yuv420p"
        stream.time_base = Fraction(1, 500)
        for index, grey in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(grey, format="gray").reformat(format="yuv420p")
            frame.pts = index
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="gray") for frame in container.decode(video=0)]


def test_a_camera_that_stood_still_is_not_accused(camera, take):
    seen = [check_moved(camera, take(seed=seed)) for seed in range(6)]
    assert max(moved.displacement_px for moved in seen) < 0.06
    assert max(moved.significance for moved in seen) < 2.5
    assert refuse_moved(list(enumerate(seen))) == []


@pytest.mark.parametrize("gaze_px", [(0.3, 0.0), (0.5, -0.6), (0.0, 2.5), (9.0, -4.0), (60.0, 20.0)])
def test_the_displacement_is_measured(camera, take, gaze_px):
    moved = check_moved(camera, take(gaze_px))
    assert moved.displacement_px == pytest.approx(np.hypot(*gaze_px), rel=0.06, abs=0.05)
    assert moved.displacement_m == pytest.approx(moved.displacement_px * camera.scale_m_per_px)
    assert moved.significance > 4
    assert np.allclose(moved.shift_px, gaze_px, rtol=0.06, atol=0.1)


def test_a_turn_about_the_line_of_sight_is_measured(camera, take):
    moved = check_moved(camera, take(turn_rad=0.004))
    assert moved.turn_rad == pytest.approx(0.004, abs=2e-4)
    assert moved.displacement_px > 1.0


def test_a_camera_that_came_nearer_is_found(camera, take):
    moved = check_moved(camera, take(nearer_m=0.01))
    assert moved.zoom == pytest.approx(1.9 / 1.89, abs=5e-4)
    assert moved.displacement_px > 1.5
    assert not moved.apart_px


def test_late_frames_that_are_shifted_are_refused_with_the_cost(camera, take, tmp_path):
    frames = [take(seed=k) for k in range(4)] + [take((1.6, 0.9), seed=10 + k) for k in range(4)]
    seen = [(k, check_moved(camera, grey)) for k, grey in enumerate(film(tmp_path / "video.mp4", frames))]
    assert refuse_moved(seen[:4]) == []
    with pytest.raises(StrandcastError, match=r"moved since the photo of the plane: 1\.[789]\d ± ") as caught:
        refuse_moved(seen, "video.mp4")
    assert caught.value.code == "SC-C040"
    assert caught.value.line >= 4
    assert float(caught.value.cost.split()[0]) == pytest.approx(1.84 * 1.73, rel=0.08)


def test_less_than_a_pixel_is_a_warning(camera, take, tmp_path):
    seen = [
        (k, check_moved(camera, g)) for k, g in enumerate(film(tmp_path / "v.mp4", [take((0.5, 0.0))] * 2))
    ]
    [warning] = refuse_moved(seen)
    assert "the camera has moved" in warning
    assert "mm at the string" in warning


def test_a_marker_that_was_moved_by_itself_is_told_and_does_not_accuse_the_camera(
    camera, take, paint_markers
):
    aside = [*MARKERS[:2], PlaneMarker(2, 0.606, -0.3, 0.08, -1.0), *MARKERS[3:]]
    texture, _ = paint_markers(aside, DICTIONARY)
    moved = check_moved(camera, take(texture=texture))
    assert list(moved.apart_px) == [2]
    assert moved.apart_px[2] == pytest.approx(6e-3 / camera.scale_m_per_px, rel=0.1)
    assert moved.displacement_px < 0.1
    [warning] = refuse_moved([(0, moved)])
    assert "marker 2 was moved" in warning


def test_an_arm_before_a_marker_takes_nothing_from_the_others(camera, take):
    frame = take()
    u, v = np.array(camera.plane_markers[1].residuals_px)[:, :2].mean(axis=0)
    cv2.line(frame, (int(u) - 30, int(v) - 60), (int(u) + 10, int(v) + 60), 60, 25)
    moved = check_moved(camera, frame)
    assert 1 not in moved.markers
    assert moved.displacement_px < 0.08
    assert refuse_moved([(0, moved)]) == []


def test_without_markers_nothing_is_said(camera, take):
    assert check_moved(camera, np.full_like(take(), 90)) is None
    bare = camera.model_copy(update={"plane_markers": []})
    assert check_moved(bare, take()) is None


def test_a_displacement_that_is_not_sure_is_not_an_error():
    unsure = Moved(3.0, 5e-3, 1.0, (3.0, 0.0), 0.0, 1.0, [0, 1])
    assert refuse_moved([(0, unsure)]) == []
