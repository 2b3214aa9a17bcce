from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest

from strandcast.arm.load import PlanarArm
from strandcast.camera.markers import detect_markers, marker_detector
from strandcast.lab.film import FilmSubject, film_frames, film_subject, interpolated
from strandcast.lab.scene import LabScene, make_scene, square_corners_m
from strandcast.lab.strings import PAPER_STRINGS
from strandcast.lab.swing import simulate_swing
from strandcast.lab.truth import LAB_TRUTH
from strandcast.records.joint_log import read_run
from strandcast.records.tables import read_facts, read_table
from strandcast.video.reader import open_video

from .conftest import Thrown, make_experiment, swing_command
from .test_swing import QUIET


def test_string_is_drawn_where_it_is(arm: PlanarArm, monkeypatch: pytest.MonkeyPatch) -> None:
    string = PAPER_STRINGS["paper-1"]
    scene = make_scene(make_experiment(), "lab-test", arm)
    plain = LabScene(scene.view, np.full_like(scene.still, 80.0), np.ones_like(scene.gain), arm, ())
    monkeypatch.setattr("strandcast.lab.film.paint_arm", lambda *_: None)
    monkeypatch.setattr("strandcast.lab.film.FLICKER_SHARE", 0.0)
    swing = simulate_swing(arm, "servoj", string, QUIET, swing_command())
    actors = replace(film_subject(swing, string), weights=())
    middles = np.linspace(0.0, 0.5, 12)
    offsets = []
    for middle, frame in zip(
        middles, film_frames(plain, actors, middles, 4e-4, 0.0, np.random.default_rng(0)), strict=True
    ):
        offsets += _offsets_px(
            frame.astype(np.float32) - 80.0, scene.view.pixels(interpolated(swing, middle)[1])
        )
    assert len(offsets) > 150
    assert np.abs(offsets).max() < 0.05


def _offsets_px(drawn: np.ndarray, line: np.ndarray) -> list[float]:
    """How far the drawn line's middle is from the true line, across it, at the middle of each link."""
    offsets = []
    inside = ((line > 8) & (line < np.array([792, 632]))).all(axis=1)
    for start, end in pairwise(line[2:-2][inside[2:-2]]):
        along = (end - start) / np.linalg.norm(end - start)
        across = np.arange(-5.0, 5.01, 0.1)
        places = (0.5 * (start + end) + across[:, None] * np.array([-along[1], along[0]])).astype(np.float32)
        seen = cv2.remap(drawn, places[None, :, 0], places[None, :, 1], cv2.INTER_LINEAR)[0]
        offsets.append(float((seen * across).sum() / seen.sum()))
    return offsets


def test_hand_markers_are_detected_where_they_are(thrown: Thrown) -> None:
    scene = make_scene(thrown.experiment, "lab-test", thrown.arm)
    truth = read_facts(thrown.truth, LAB_TRUTH)["hand_markers"]
    detector = marker_detector("DICT_4X4_50")
    seen, errors, count = 0, [], 0
    with open_video(thrown.trial / "video.mp4") as video:
        for index, _, grey in video:
            if index % 12:
                continue
            ids, corners = detect_markers(grey, detector)
            count += 1
            seen += bool({40, 41} & set(ids.tolist()))
            for marker, found in zip(ids.tolist(), corners, strict=True):
                if marker in (40, 41):
                    where = scene.view.pixels(np.array(truth[str(marker)][index]), 0.020)
                    errors.append(np.linalg.norm(found.mean(axis=0) - where))
    assert count > 15
    assert seen / count > 0.95
    assert np.median(errors) < 0.15


def test_sensor_noise_survives_the_encoder(thrown: Thrown) -> None:
    with open_video(thrown.trial / "video.mp4") as video:
        corner = np.array([grey[-40:, -40:].copy() for index, _, grey in video if index < 30], float)
    assert 1.5 < corner.std(axis=0).mean() < 3.5


def test_time_stamps_are_even_and_frames_are_those_of_the_truth(thrown: Thrown) -> None:
    with open_video(thrown.trial / "video.mp4") as video:
        times = np.array([time_s for _, time_s, _ in video])
    np.testing.assert_allclose(times, np.arange(len(times)) / 250.0, atol=1e-9)
    truth, facts = read_table(thrown.truth, LAB_TRUTH), read_facts(thrown.truth, LAB_TRUTH)
    first = np.unique(truth["frame"], return_index=True)[1]
    np.testing.assert_allclose(
        truth["robot_time_s"][first], times * (1 + facts["drift"]) + facts["offset_s"], atol=1e-9
    )
    run, _ = read_run(thrown.trial)
    assert run.motion_start_s == facts["motion_start_s"]
    lead = run.motion_start_s - truth["robot_time_s"][0]
    assert 0.15 < lead < 0.35
    assert truth["robot_time_s"][-1] - run.motion_end_s > 0.4


def test_board_photos_recover_the_lens(thrown: Thrown) -> None:
    shape = thrown.experiment.camera.board
    made = cv2.aruco.CharucoBoard(
        (shape.squares_x, shape.squares_y),
        shape.square_m,
        shape.marker_m,
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100),
    )
    detector = cv2.aruco.CharucoDetector(made)
    objects, images = [], []
    for photo in sorted((thrown.data / "calibration").glob("lens-*.png")):
        corners, ids, _, _ = detector.detectBoard(cv2.imread(str(photo), cv2.IMREAD_GRAYSCALE))
        points = made.matchImagePoints(np.asarray(corners).reshape(-1, 1, 2), np.asarray(ids).reshape(-1, 1))
        objects.append(points[0])
        images.append(points[1])
    rms, matrix, distortion, _, _ = cv2.calibrateCamera(objects, images, (800, 640), None, None)
    view = make_scene(thrown.experiment, "lab-test", thrown.arm).view
    assert len(images) == 12
    assert rms < 0.15
    assert matrix[0, 0] == pytest.approx(view.matrix[0, 0], rel=5e-3)
    assert matrix[:2, 2] == pytest.approx(view.matrix[:2, 2], abs=4.0)
    assert np.ravel(distortion)[0] == pytest.approx(view.distortion[0], abs=0.03)


def test_plane_photo_shows_every_marker_where_the_lens_puts_it(thrown: Thrown) -> None:
    photo = cv2.imread(str(thrown.data / "calibration" / "plane.png"), cv2.IMREAD_GRAYSCALE)
    ids, corners = detect_markers(photo, marker_detector("DICT_4X4_50"))
    view = make_scene(thrown.experiment, "lab-test", thrown.arm).view
    plane = thrown.experiment.camera.plane
    places = {
        m.id: square_corners_m(np.array([m.x_m, m.y_m]), m.angle_rad, plane.size_m) for m in plane.markers
    }
    seen = [
        (found - view.pixels(places[k]))
        for k, found in zip(ids.tolist(), corners, strict=True)
        if k in places
    ]
    errors = np.concatenate(seen)
    assert len(seen) == 6
    # OpenCV's corners scatter by 0.2 to 0.3 px on markers of this size; a misplaced one would shift them all.
    assert np.abs(errors.mean(axis=0)).max() < 0.15
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 0.5


def test_the_film_subject_has_the_weight_at_the_tip(arm: PlanarArm) -> None:
    swing = simulate_swing(arm, "stiff", PAPER_STRINGS["paper-1"], QUIET, swing_command())
    actors: FilmSubject = film_subject(swing, PAPER_STRINGS["paper-1"])
    assert actors.weights[0][0] == len(swing.places_m) - 1
    assert not actors.pipe.any()
