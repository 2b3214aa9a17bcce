"""Detection in real video files that the camera was bumped after the photo of the plane."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from strandcast.camera.movement import CameraMovement, check_movement, find_movement
from strandcast.camera.plane import plane_from_markers
from strandcast.camera.pose import PlacedMarker
from strandcast.errors import StrandcastError

DICTIONARY = "DICT_4X4_50"
MARKERS = [
    PlacedMarker(0, -0.6, 0.35, 0.08),
    PlacedMarker(1, 0.6, 0.35, 0.08),
    PlacedMarker(2, 0.6, -0.3, 0.08, -1.0),
    PlacedMarker(3, -0.6, -0.3, 0.08),
    PlacedMarker(4, 0.05, 0.3, 0.08, 3.0),
]
POSE = (0.06, -0.1, 0.03, (0.0, 0.02), 1.9)


@pytest.fixture(scope="module")
def take(photograph, paint_markers, looking, lens):
    """Return a function: (image shift in pixels, rotation, seed) -> a dim frame with noise."""
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


@pytest.mark.thorough
def test_a_still_camera_gives_no_warning(camera, take):
    seen = [find_movement(camera, take(seed=seed)) for seed in range(3)]
    assert max(moved.displacement_px for moved in seen) < 0.06
    assert max(moved.significance for moved in seen) < 2.5
    assert check_movement(list(enumerate(seen))) == []


@pytest.mark.parametrize("gaze_px", [(0.3, 0.0), (0.5, -0.6), (0.0, 2.5), (9.0, -4.0), (60.0, 20.0)])
def test_the_displacement_is_measured(camera, take, gaze_px):
    moved = find_movement(camera, take(gaze_px))
    assert moved.displacement_px == pytest.approx(np.hypot(*gaze_px), rel=0.06, abs=0.05)
    assert moved.displacement_m == pytest.approx(moved.displacement_px * camera.scale_m_per_px)
    assert moved.significance > 4
    assert np.allclose(moved.shift_px, gaze_px, rtol=0.06, atol=0.1)


def test_rotation_about_the_optical_axis_is_measured(camera, take):
    moved = find_movement(camera, take(turn_rad=0.004))
    assert moved.rotation_rad == pytest.approx(0.004, abs=2e-4)
    assert moved.displacement_px > 1.0


def test_a_camera_that_moved_closer_is_detected(camera, take):
    moved = find_movement(camera, take(nearer_m=0.01))
    assert moved.zoom == pytest.approx(1.9 / 1.89, abs=5e-4)
    assert moved.displacement_px > 1.5
    assert not moved.own_movement_px


def test_a_shift_in_late_frames_is_refused(camera, take, tmp_path):
    frames = [take(seed=k) for k in range(4)] + [take((1.6, 0.9), seed=10 + k) for k in range(4)]
    seen = [(k, find_movement(camera, grey)) for k, grey in enumerate(film(tmp_path / "video.mp4", frames))]
    assert check_movement(seen[:4]) == []
    with pytest.raises(StrandcastError, match=r"moved since the photo of the plane: 1\.[789]\d ± ") as caught:
        check_movement(seen, "video.mp4")
    assert caught.value.code == "SC-C040"
    assert caught.value.line >= 4
    assert float(caught.value.cost.split()[0]) == pytest.approx(1.84 * 1.73, rel=0.08)


def test_less_than_a_pixel_is_a_warning(camera, take, tmp_path):
    seen = [
        (k, find_movement(camera, g)) for k, g in enumerate(film(tmp_path / "v.mp4", [take((0.5, 0.0))] * 2))
    ]
    [warning] = check_movement(seen)
    assert "the camera has moved" in warning
    assert "mm at the string" in warning


def test_a_displaced_marker_is_named_and_not_taken_for_camera_movement(camera, take, paint_markers):
    aside = [*MARKERS[:2], PlacedMarker(2, 0.606, -0.3, 0.08, -1.0), *MARKERS[3:]]
    texture, _ = paint_markers(aside, DICTIONARY)
    moved = find_movement(camera, take(texture=texture))
    assert list(moved.own_movement_px) == [2]
    assert moved.own_movement_px[2] == pytest.approx(6e-3 / camera.scale_m_per_px, rel=0.1)
    assert moved.displacement_px < 0.1
    [warning] = check_movement([(0, moved)])
    assert "marker 2 has moved" in warning


@pytest.mark.parametrize("own", [(0, 1), (1, 2), (2, 4), (0, 3)])
def test_two_displaced_markers_of_five_are_named(camera, take, paint_markers, own):
    steps_m = dict(zip(own, [(6e-3, -3e-3), (2e-3, 5e-3)], strict=True))
    shifted = [
        replace(m, x_m=m.x_m + dx, y_m=m.y_m + dy)
        for m in MARKERS
        for dx, dy in [steps_m.get(m.marker, (0.0, 0.0))]
    ]
    moved = find_movement(camera, take(texture=paint_markers(shifted, DICTIONARY)[0]))
    assert tuple(moved.own_movement_px) == own
    assert moved.displacement_px < 0.15


def test_an_occluded_marker_does_not_affect_the_others(camera, take):
    frame = take()
    u, v = np.array(camera.plane_markers[1].residuals_px)[:, :2].mean(axis=0)
    cv2.line(frame, (int(u) - 30, int(v) - 60), (int(u) + 10, int(v) + 60), 60, 25)
    moved = find_movement(camera, frame)
    assert 1 not in moved.markers
    assert moved.displacement_px < 0.08
    assert check_movement([(0, moved)]) == []


def test_without_markers_there_is_no_result(camera, take):
    assert find_movement(camera, np.full_like(take(), 90)) is None
    bare = camera.model_copy(update={"plane_markers": []})
    assert find_movement(bare, take()) is None


def test_an_insignificant_displacement_is_no_error():
    unsure = CameraMovement(3.0, 5e-3, 1.0, (3.0, 0.0), 0.0, 1.0, [0, 1])
    assert check_movement([(0, unsure)]) == []
