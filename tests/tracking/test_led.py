"""The LED in written videos: the times when it switches, and changes that are no switching."""

import cv2
import numpy as np
import pytest

from strandcast.config.align import LedSettings
from strandcast.errors import StrandcastError
from strandcast.tracking.events.led import LedMonitor
from strandcast.video.ingest import camera_times, inspect_video
from strandcast.video.reader import open_video

WIDTH, HEIGHT = 96, 64
BOX = (30, 20, 46, 36)
MIDDLE, RADIUS = (37.5, 27.5), 4.0
WALL, DARK, BRIGHT = 70.0, 40.0, 150.0


def share_lit(time_s, exposure_s, *lit_s):
    """Share of each exposure in which an LED is lit that is so between pairs of times."""
    share = np.zeros(len(time_s))
    for on_s, off_s in lit_s:
        first = np.maximum(time_s - exposure_s / 2, on_s)
        last = np.minimum(time_s + exposure_s / 2, off_s)
        share += np.clip(last - first, 0, None) / exposure_s
    return share


class Film:
    """A wall with an LED on it, filmed."""

    def __init__(self, scene, folder):
        self.scene, self.path, self.count = scene, folder, 0

    def __call__(
        self,
        *lit_s,
        rate_hz=200,
        exposure_s=1e-3,
        noise=1.5,
        gamma=1.0,
        bright=BRIGHT,
        change=None,
        scale=1,
        frames=70,
        **video,
    ):
        rng = np.random.default_rng([7, self.count])
        self.count += 1
        path = self.path / f"{self.count}.mkv"
        time_s = np.arange(frames) / rate_hz
        v, u = np.mgrid[:HEIGHT, :WIDTH]
        lamp = np.hypot(u - MIDDLE[0], v - MIDDLE[1]) < RADIUS
        pictures = []
        for at_s, share in zip(time_s, share_lit(time_s, exposure_s, *lit_s), strict=True):
            light = np.full((HEIGHT, WIDTH), WALL)
            light[lamp] = DARK + share * (bright - DARK)
            if change is not None:
                light = change(light, at_s)
            grey = 255 * (np.clip(light, 0, 255) / 255) ** (1 / gamma) + rng.normal(0, noise, light.shape)
            grey = np.clip(np.rint(grey * scale), 0, 255 * scale)
            pictures.append(grey.astype(np.uint8 if scale == 1 else np.uint16))
        self.scene.write_video(path, pictures, rate_hz, **video)
        return path


@pytest.fixture(scope="module")
def film(scene, tmp_path_factory):
    return Film(scene, tmp_path_factory.mktemp("led"))


@pytest.fixture(scope="module")
def look(scene):
    """Return a function that decodes a video and returns its LED and the warnings."""

    def run(path, exposure_s=1e-3, gamma=1.0, box_px=BOX):
        watch = LedMonitor(LedSettings(box_px=box_px, gamma=gamma), scene.flat_camera(WIDTH, HEIGHT))
        with open_video(path) as video:
            for _, _, image in video:
                watch.look(image)
        return watch.found(camera_times(inspect_video(path)), exposure_s)

    return run


def errors(led, *lit_s):
    """Errors and sigmas [s] of the switchings that there must be."""
    assert [event.kind for event in led.events] == ["led_on", "led_off"] * len(lit_s)
    off = np.array([event.camera_time_s for event in led.events]) - np.ravel(lit_s)
    return off, np.array([event.sigma_s for event in led.events])


@pytest.mark.parametrize(("rate_hz", "exposure_s"), [(200, 1e-3), (200, 4.5e-3), (500, 1.5e-3)])
def test_the_time_of_a_switching_is_within_its_uncertainty(film, look, rate_hz, exposure_s):
    # On and off at all phases of the frames.
    lit_s = [((10 + 24 * k + k / 12) / rate_hz, (22 + 24 * k + 7 * k / 12) / rate_hz) for k in range(12)]
    path = film(*lit_s, rate_hz=rate_hz, exposure_s=exposure_s, frames=310)
    led, warnings = look(path, exposure_s)
    assert warnings == []
    off, sigma = errors(led, *lit_s)
    assert (np.abs(off) < 1.001 * np.sqrt(3) * sigma).all()
    if exposure_s * rate_hz < 0.5:
        assert 0.6 < np.sqrt(((off / sigma) ** 2).mean()) < 1.2
    # Between two exposures it is anywhere; within one, its share of light tells.
    dark_s = 1 / rate_hz - exposure_s
    within = sigma < 0.1 * exposure_s
    assert within.mean() == pytest.approx(exposure_s * rate_hz, abs=0.2)
    unsure_s = np.sqrt(12) * sigma[~within]
    assert (unsure_s >= dark_s).all()
    assert (unsure_s < dark_s + 0.41 * exposure_s).all()


def test_without_an_exposure_a_switching_is_anywhere_between_two_frames(film, look):
    on_s, off_s = 0.1022, 0.2013
    off, sigma = errors(look(film((on_s, off_s)), exposure_s=None)[0], (on_s, off_s))
    assert sigma == pytest.approx([0.005 / np.sqrt(12)] * 2, rel=0.05)
    assert (np.abs(off) < np.sqrt(3) * sigma).all()


def test_a_partly_lit_frame_without_an_exposure_still_bounds_the_time(film, look):
    on_s, off_s = 0.1008, 0.2511  # a fifth of the exposures that begin at 0.098 and 0.248 s is left, or gone
    off, sigma = errors(look(film((on_s, off_s), exposure_s=4e-3), exposure_s=None)[0], (on_s, off_s))
    assert (np.abs(off) < np.sqrt(3) * sigma).all()
    assert (sigma < 0.8 * 0.005 / np.sqrt(12)).all()


def test_a_camera_of_unknown_gamma_is_allowed_for(film, look):
    on_s, off_s = 0.1004, 0.2006
    path = film((on_s, off_s), exposure_s=4e-3, gamma=2.2, noise=0.5)
    off, sigma = errors(look(path, 4e-3, gamma=None)[0], (on_s, off_s))
    assert (np.abs(off) < np.sqrt(3) * sigma).all()
    assert (sigma < 0.13 * 4e-3).all()
    off, sigma = errors(look(path, 4e-3, gamma=1.0)[0], (on_s, off_s))
    assert (np.abs(off) > np.sqrt(3) * sigma).all()


def test_a_saturated_led_shows_that_it_is_lit_not_for_how_long(film, look):
    lit_s = [(0.0992 + 0.1007 * k, 0.1503 + 0.1007 * k) for k in range(6)]
    led, _ = look(film(*lit_s, exposure_s=4e-3, bright=900.0, frames=150), 4e-3)
    assert led.burnt
    off, sigma = errors(led, *lit_s)
    assert (np.abs(off) < np.sqrt(3) * sigma).all()
    assert (np.abs(off) > 3 * 0.05 * 4e-3).any()  # what trusting the share would have made of it


def test_deep_and_lossy_videos_are_read_alike(film, look):
    on_s, off_s = 0.1004, 0.2006
    deep = film((on_s, off_s), exposure_s=4e-3, scale=257, pixel_format="gray16le")
    lossy = film((on_s, off_s), exposure_s=4e-3, codec="libx264", pixel_format="yuv420p")
    for path in (deep, lossy):
        off, sigma = errors(look(path, 4e-3)[0], (on_s, off_s))
        assert (np.abs(off) < 0.1 * 4e-3).all()
        assert (sigma < 0.05 * 4e-3).all()


def test_flashes_are_no_switchings(film, look):
    def flash(light, at_s):
        light = light.copy()
        light[20:36, 30:46] += 60 if 0.05 <= at_s < 0.06 or 0.25 <= at_s < 0.265 else 0
        return light

    on_s, off_s = 0.1004, 0.2006
    led, warnings = look(film((on_s, off_s), change=flash))
    errors(led, (on_s, off_s))
    assert any("flashes" in why for why in led.rejected)
    assert "flashes" in warnings[0]


def test_a_string_that_passes_is_no_switching(film, look):
    def string(light, at_s):
        image = light.astype(np.float32)
        u = 20 + 36 * (at_s - 0.13) / 0.06  # through the window in 30 ms, over a lit LED
        cv2.line(image, (round(u * 16), 0), (round(u * 16), HEIGHT * 16), 110.0, 3, cv2.LINE_AA, 4)
        return image.astype(float)

    on_s, off_s = 0.1004, 0.2506
    led, _ = look(film((on_s, off_s), change=string))
    errors(led, (on_s, off_s))


def test_a_string_over_the_switching_hides_it_rather_than_shift_it(film, look):
    def string(light, at_s):
        image = light.copy()
        if abs(at_s - 0.25) < 0.02:
            image[:, 32:40] = 75.0
        return image

    led, warnings = look(film((0.1004, 0.2506), change=string))
    on = [event for event in led.events if event.kind == "led_on"]
    assert abs(on[0].camera_time_s - 0.1004) < np.sqrt(3) * on[0].sigma_s
    assert len(led.events) == 1
    assert "led_off" in warnings[0]


def test_the_rooms_light_is_no_led(film, look):
    def room(light, at_s):
        return light * (1.6 if at_s > 0.15 else 1.0)

    led, warnings = look(film((9.0, 9.1), change=room))
    assert led.events == []
    assert "no LED switches" in warnings[0]


def test_an_led_that_never_switches_gives_one_warning(film, look):
    for on_s, off_s in ((9.0, 9.1), (-1.0, 9.0)):
        led, warnings = look(film((on_s, off_s)))
        assert (led.events, led.rejected) == ([], [])
        assert len(warnings) == 1
        assert "by the hand's motion alone" in warnings[0]


def test_a_contradiction_between_frames_is_no_switching(film, look):
    path = film((0.1004, 0.2006), exposure_s=4.8e-3)
    led, _ = look(path, exposure_s=4.8e-3)
    assert len(led.events) == 2
    slow = film((0.1004, 0.2006), rate_hz=500, exposure_s=9e-3)  # an afterglow over several frames
    led, _ = look(slow, exposure_s=1e-3)
    assert led.events == []
    assert all("frames" in why for why in led.rejected)


def test_the_window_is_around_the_place_and_must_be_in_the_picture(scene):
    camera = scene.flat_camera(WIDTH, HEIGHT)
    left, top, right, bottom = LedMonitor(LedSettings(place_m=(0.015, 0.0), radius_m=0.006), camera).window
    assert ((left + right - 1) / 2, (top + bottom - 1) / 2) == pytest.approx((57.5, 31.5), abs=0.6)
    assert 9 <= right - left <= 11
    with pytest.raises(StrandcastError, match="SC-T033"):
        LedMonitor(LedSettings(place_m=(0.5, 0.0)), camera)
    with pytest.raises(StrandcastError, match="SC-T033"):
        LedMonitor(LedSettings(box_px=(90, 10, 97, 20)), camera)


def test_the_led_is_detected_in_the_pass_that_tracks_the_string(scene, filmed, tmp_path):
    place_m, (on_s, off_s) = (0.45, 0.35), (0.0604, 0.1609)
    u, v = scene.to_pixels(np.array(place_m))
    time_s = np.arange(len(filmed[1])) / scene.RATE_HZ
    pictures = []
    with open_video(filmed[0]) as video:
        for (_, _, image), share in zip(
            video, share_lit(time_s, scene.EXPOSURE_S, (on_s, off_s)), strict=True
        ):
            picture = image.astype(np.float32)
            cv2.circle(picture, (round(u), round(v)), 4, 90 + 150 * float(share), -1, cv2.LINE_AA)
            pictures.append(np.clip(np.rint(picture), 0, 255).astype(np.uint8))
    path = tmp_path / "led.mkv"
    scene.write_video(path, pictures, scene.RATE_HZ)
    led = LedSettings(place_m=(place_m[0], place_m[1]))
    tracked = scene.track(path, exposure_s=scene.EXPOSURE_S, led=led)
    off, sigma = errors(tracked.led, (on_s, off_s))
    assert (np.abs(off) < np.sqrt(3) * sigma).all()
    assert len(tracked.led.brightness_grey) == len(pictures)
    assert tracked.warnings == ()
    truth = filmed[2][:, np.linspace(0, filmed[2].shape[1] - 1, 11).astype(int)]
    assert np.sqrt((np.linalg.norm(tracked.points_m - truth, axis=2)[:, 1:] ** 2).mean()) < 1e-3
