"""`strandcast film`: a string tracked without an experiment, against films with a known string."""

import json
import re
from pathlib import Path

import av
import numpy as np
import pandas as pd
import pytest
from scipy.io import netcdf_file
from tests.film.swinging import HEIGHT, LENGTH_M, MARKER_PX, RATE_HZ, SCALE_M, WIDTH, cord, film, off_px
from tests.report.chromium import Browser
from tests.tracking.scene import write_video
from tests.video.test_native import photron
from typer.testing import CliRunner

import strandcast
from strandcast.cli.app import app
from strandcast.errors import StrandcastError
from strandcast.film.colour import film_of_colour
from strandcast.film.files import write_files
from strandcast.film.known import held_of, scale_of
from strandcast.film.result import FilmTrack
from strandcast.records.files import write_text
from strandcast.video.reader import open_video

FRAMES = 50


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """Return a film of a cord that swings from a point at rest, and its places."""
    path, cord_px = tmp_path_factory.mktemp("film") / "swing.mkv", cord(False, FRAMES)
    film(path, cord_px)
    return path, cord_px


@pytest.fixture(scope="module")
def tracked(still: tuple[Path, np.ndarray]) -> FilmTrack:
    """Return its track."""
    return strandcast.track_film(still[0], length_m=LENGTH_M)


@pytest.fixture(scope="module")
def folder(tracked: FilmTrack, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of its files."""
    folder = tmp_path_factory.mktemp("files")
    write_files(tracked, folder)
    return folder


def pictures_of(still: tuple[Path, np.ndarray]) -> list[np.ndarray]:
    """Return its grey pictures."""
    with av.open(still[0]) as opened:
        return [frame.to_ndarray(format="gray") for frame in opened.decode(video=0)]


def test_what_is_not_given_is_found(tracked, still):
    cord_px = still[1]
    sure = tracked.confidence() == 1.0
    assert sure[:, 1:].mean() > 0.9
    assert np.median(off_px(tracked.points_px, cord_px)[sure]) < 0.8
    assert np.linalg.norm(tracked.points_px[0, 0] - cord_px[0, 0]) < 2.0
    assert tracked.m_per_px == pytest.approx(SCALE_M, rel=0.015)
    assert "found where the frames agree" in tracked.assumed["held"]
    assert np.nanmedian(tracked.length) == pytest.approx(LENGTH_M, rel=0.01)


def test_metres_are_counted_from_the_held_end_upwards(tracked, still):
    cord_px = still[1]
    assert tracked.points_m[0, 0] == pytest.approx([0.0, 0.0])
    right_up = (cord_px[:, -1] - cord_px[:, 0]) * (SCALE_M, -SCALE_M)
    assert np.median(np.linalg.norm(tracked.points_m[:, -1] - right_up, axis=1)) < 0.005


def test_speed_and_curvature_are_those_of_the_cord(tracked, still):
    end_m = still[1][:, -1] * SCALE_M
    speed = np.linalg.norm(np.gradient(end_m, 1.0 / RATE_HZ, axis=0), axis=1)
    assert np.median(np.abs(tracked.end_speed() / speed - 1.0)) < 0.05
    angle = np.linspace(0.0, 1.0, 11)
    ring = np.stack([0.2 * np.cos(angle), 0.2 * np.sin(angle)], axis=-1)[None]
    bent = FilmTrack(*[None] * 3, ring / SCALE_M, ring, *np.zeros((2, 1, 11)), None, SCALE_M)
    assert bent.curvature()[0, 1:-1] == pytest.approx(5.0, rel=1e-3)  # to the left, as seen along the string


def test_confidence_ranks_the_flags():
    flags = np.array([[0, 0, 1, 2, 4, 8, 0]])
    places = np.where(np.arange(7)[:, None] == 6, np.nan, 1.0)[None].repeat(2, axis=2)
    track = FilmTrack(*[None] * 3, places, None, np.ones((1, 7)), flags, np.ones(1), None)
    assert track.confidence().tolist() == [[1.0, 1.0, 0.5, 0.2, 0.2, 1.0, 0.0]]
    assert track.doubtful().tolist() == [True]


def test_both_ends_may_move(tmp_path):
    cord_px = cord(True, FRAMES, far=True)
    film(tmp_path / "v.mkv", cord_px, blobs=True)
    held = [f"moving:{u:.0f},{v:.0f}" for u, v in cord_px[0, [0, -1]]]
    tracked = strandcast.track_film(tmp_path / "v.mkv", held=held)
    assert np.median(off_px(tracked.points_px, cord_px)) < 2.0
    assert np.median(np.linalg.norm(tracked.points_px[:, -1] - cord_px[:, -1], axis=1)) < 3.0
    assert tracked.points_m is None
    assert np.nanmedian(tracked.length) == pytest.approx(LENGTH_M / SCALE_M, rel=0.02)


def test_a_marker_carries_the_held_end_and_the_scale(tmp_path):
    cord_px = cord(True, FRAMES)
    film(tmp_path / "v.mkv", cord_px, marker=7)
    side = MARKER_PX * SCALE_M
    tracked = strandcast.track_film(tmp_path / "v.mkv", held=["marker:7"], scale=f"marker={side:.4f}")
    assert np.nanmedian(off_px(tracked.points_px, cord_px)[:, 1:]) < 3.0
    assert tracked.m_per_px == pytest.approx(SCALE_M, rel=0.01)
    assert np.nanmedian(tracked.length) == pytest.approx(LENGTH_M, rel=0.03)


def test_a_string_is_found_by_its_colour(still, tmp_path):
    red, other = np.array([190.0, 60.0, 50.0]), np.array([50.0, 80.0, 190.0])
    with av.open(still[0]) as grey, av.open(tmp_path / "v.mp4", "w") as made:
        stream = made.add_stream("libx264rgb", rate=RATE_HZ, options={"qp": "0"})
        stream.height, stream.width, stream.pix_fmt = HEIGHT, WIDTH, "rgb24"
        for frame in grey.decode(video=0):
            level = frame.to_ndarray(format="gray")[:, :, None]
            cover = np.clip((165.0 - level) / 125.0, 0.0, 1.0)
            picture = (1 - cover) * level + cover * red
            mirrored = cover[:, ::-1]  # a second string, of another colour
            picture = (1 - mirrored) * picture + mirrored * other
            made.mux(stream.encode(av.VideoFrame.from_ndarray(picture.astype(np.uint8), format="rgb24")))
        made.mux(stream.encode(None))
    tracked = strandcast.track_film(tmp_path / "v.mp4", colour="#be3c32")
    assert np.nanmedian(off_px(tracked.points_px, still[1])) < 2.0
    write_files(tracked, tmp_path / "files")
    assert (tmp_path / "files" / "film.html").is_file()


def test_the_bits_that_a_film_does_not_use_do_not_count(still, tmp_path):
    write_video(
        tmp_path / "v.mkv",
        [4 * one.astype(np.uint16) for one in pictures_of(still)],
        RATE_HZ,
        pixel_format="gray16le",
    )
    tracked = strandcast.track_film(tmp_path / "v.mkv")
    assert np.nanmedian(off_px(tracked.points_px, still[1])) < 0.8


def test_a_moved_camera_is_reported_in_the_films_own_scale(still, tmp_path):
    moved = [np.roll(one, 2 * (k >= FRAMES // 2), axis=1) for k, one in enumerate(pictures_of(still))]
    write_video(tmp_path / "v.mkv", moved, RATE_HZ)
    for scale, words in ((0.01, ["18"]), (None, [])):
        [warning] = strandcast.track_film(tmp_path / "v.mkv", scale=scale).warnings
        assert re.findall(r"(\d+)[.]\d mm at the string", warning) == words


def test_levels_by_colour_are_not_clipped(tmp_path):
    ramp = np.tile(np.arange(256, dtype=np.uint8), (64, 1))
    write_video(tmp_path / "v.mkv", [ramp] * 2, RATE_HZ)
    with film_of_colour(tmp_path / "v.mkv", "#000000") as made, open_video(made) as opened:
        levels = next(iter(opened))[2].astype(float)
    assert levels == pytest.approx(np.maximum(255.0 - np.sqrt(3.0) * ramp, 0.0), abs=1.0)


@pytest.mark.parametrize(("frames", "code"), [(1, "SC-V012"), (20, "SC-V005")])
def test_a_film_by_colour_is_refused_by_its_own_name(tmp_path, frames, code):
    path = tmp_path / "v.mp4"
    write_video(path, [np.full((64, 64), 200, np.uint8)] * frames, RATE_HZ, "libx264", "yuv420p")
    with av.open(path) as opened:
        packets = [packet.pos for packet in opened.demux(video=0) if packet.size]
    with path.open("r+b") as damaged:
        if frames > 1:
            damaged.seek(packets[5])
            damaged.write(b"\xff" * 8)
    with pytest.raises(StrandcastError) as refused:
        strandcast.track_film(path, colour="#c03020")
    assert (refused.value.code, refused.value.file) == (code, str(path))


@pytest.mark.parametrize("known", [{"scale": "marker=0.04"}, {"held": "marker:7"}])
def test_a_film_by_colour_has_no_markers(still, known):
    with pytest.raises(StrandcastError, match="a film by colour shows no markers"):
        strandcast.track_film(still[0], colour="#c03020", **known)


def test_corrections_are_taken_as_given_and_change_only_what_is_near(tracked, still, tmp_path):
    place = tracked.points_px[30, 12] + (3.0, 2.0)
    write_text(tmp_path / "c.csv", f"frame,point,u_px,v_px\n30,12,{place[0]:.3f},{place[1]:.3f}\n")
    again = strandcast.track_film(still[0], length_m=LENGTH_M, corrections=tmp_path / "c.csv")
    assert again.points_px[30, 12] == pytest.approx(place, abs=1e-3)
    assert again.flags[30, 12] == 8
    beside = np.linalg.norm(again.points_px[30] - tracked.points_px[30], axis=1)
    assert beside[11] > 0.5  # the string is fitted through it
    assert beside[0] < 0.5
    far = np.abs(np.arange(FRAMES) - 30) > 5
    np.testing.assert_array_equal(again.points_px[far], tracked.points_px[far])


def test_the_tables_hold_the_track(tracked, folder):
    points, frames = pd.read_parquet(folder / "points.parquet"), pd.read_csv(folder / "frames.csv")
    assert len(points) == FRAMES * 21
    one = points[(points.frame == 7) & (points.point == 20)].iloc[0]
    assert (one.u_px, one.v_px) == pytest.approx(tracked.points_px[7, 20])
    assert (one.x_m, one.y_m) == pytest.approx(tracked.points_m[7, 20])
    assert one.time_s == pytest.approx(7 / RATE_HZ)
    assert frames.doubtful.sum() == tracked.doubtful().sum()
    assert frames.end_speed_m_s.to_numpy() == pytest.approx(tracked.end_speed(), rel=1e-4)
    pd.testing.assert_frame_equal(pd.read_csv(folder / "points.csv"), points, rtol=1e-4, check_dtype=False)


def test_the_netcdf_file_has_the_layout_of_movement(tracked, folder):
    with netcdf_file(folder / "points.nc", mmap=False) as file:
        assert file.ds_type == b"poses"
        assert file.fps == pytest.approx(RATE_HZ)
        position = file.variables["position"]
        assert position.dimensions == ("time", "space", "keypoints", "individuals")
        assert position[7, :, 20, 0] == pytest.approx(tracked.points_px[7, 20])
        assert file.variables["confidence"].dimensions == ("time", "keypoints", "individuals")
        assert b"".join(file.variables["keypoints"][20]) == b"point-020"


def test_the_overlay_shows_the_string_where_it_is(tracked, folder):
    with av.open(folder / "overlay.mp4") as container:
        pictures = [frame.to_ndarray(format="rgb24").astype(int) for frame in container.decode(video=0)]
    assert len(pictures) == FRAMES
    u, v = np.rint(tracked.points_px[20, 10]).astype(int)
    red, _, blue = pictures[20][v, u]
    assert blue > red + 60


def test_the_page_plays_the_film(folder, browser: Browser):
    with browser.page() as page:
        page.open(folder / "film.html")
        page.wait("document.querySelector('.viewer').dataset.shown")
        text = page.value("document.querySelector('[data-part=time]').textContent")
        assert text == "0.0 ms from the first frame"
        assert (
            page.value("document.querySelectorAll('.over [data-part=measured]')[0].getAttribute('d').length")
            > 100
        )
        assert (
            page.value("document.querySelector('[data-do=worst]').offsetParent") is None
        )  # nothing was fitted


def test_the_command_says_what_it_assumed(still, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["film", str(still[0]), "--points", "5", "--json"])
    content = json.loads(result.stdout)
    assert (content["frames"], content["m_per_px"]) == (FRAMES, None)
    assert content["assumed"]["scale"] == "none: pixels"
    assert Path(content["files"][0]) == Path("swing-track/film.html")
    assert (tmp_path / "swing-track" / "film.html").is_file()
    write_text(tmp_path / "swing-track" / "corrections.csv", "frame,point,u_px,v_px\n99,1,5,5\n")
    refused = CliRunner().invoke(app, ["film", str(still[0]), "--points", "5"])
    assert "line 2 has frame 99, the film has 0 to 49" in str(refused.exception)
    write_text(tmp_path / "swing-track" / "corrections.csv", "frame,point,u_px,v_px\n9,0,5,5\n")
    refused = CliRunner().invoke(app, ["film", str(still[0]), "--points", "5"])
    assert "line 2 has point 0, the film has 1 to 5" in str(refused.exception)


def test_a_film_without_a_string_is_refused(still, tmp_path):
    with pytest.raises(StrandcastError, match="nothing long and thin moves"):
        film(tmp_path / "v.mkv", np.repeat(still[1][:1], FRAMES, axis=0))
        strandcast.track_film(tmp_path / "v.mkv")


def test_a_held_end_that_moves_is_asked_for(tmp_path):
    film(tmp_path / "v.mkv", cord(True, FRAMES))
    with pytest.raises(StrandcastError, match="where is the string held"):
        strandcast.track_film(tmp_path / "v.mkv")


@pytest.mark.parametrize(
    "known", [{"length_m": -1.0}, {"points": 0}, {"polarity": "red"}, {"frame_rate_hz": 0.0}]
)
def test_what_nothing_can_have_is_refused(still, known):
    with pytest.raises(StrandcastError, match="SC-W021"):
        strandcast.track_film(still[0], **known)


def test_a_rate_that_the_cameras_own_clock_contradicts_is_to_be_left_out(tmp_path):
    film = photron(tmp_path, np.zeros((3, 24, 32), np.uint16), 16)
    with pytest.raises(StrandcastError, match="leave --frame-rate out"):
        strandcast.track_film(film, frame_rate_hz=100.0)


@pytest.mark.parametrize("text", ["mm", "0", "-1", "inf", "1,2:1,2=0.3", "marker=x", "marker=0", "marker=-1"])
def test_a_scale_of_another_form_is_refused(text):
    with pytest.raises(StrandcastError, match="metres per pixel"):
        scale_of(text, [], "DICT_4X4_50")


@pytest.mark.parametrize("text", ["640", "640;120", "marker", "moves:1,2"])
def test_a_held_end_of_another_form_is_refused(text):
    with pytest.raises(StrandcastError, match="moving:640,120"):
        held_of(text)


def test_two_pixels_give_the_scale():
    assert scale_of("100,200:400,600=.25", [], "DICT_4X4_50").m_per_px == pytest.approx(0.0005)
