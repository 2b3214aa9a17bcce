"""The film of a throw on its page, in a real browser: every frame has its number burned in."""

import io
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from strandcast.records.clip import Clip
from strandcast.records.files import write_text
from strandcast.records.tables import write_table
from strandcast.records.track import TRACK, read_track
from strandcast.records.verdict import Verdict
from strandcast.report.panels.viewer import clip_px, film_of
from strandcast.report.results import read_results
from strandcast.report.trial_page import trial_page

from .chromium import Browser, Page
from .conftest import CLIP_PX, NUMBER_BITS, NUMBER_PX, N

LAST = 499
FLAGGED = [(40, 42), (120, 127), (300, 300)]  # the first and the last are set here
DATA = "document.querySelector('.viewer').dataset"


@pytest.fixture(scope="module")
def folder(results: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the results of a trial with three flagged runs."""
    made = Path(shutil.copytree(results, tmp_path_factory.mktemp("film") / "swing")) / "trial-03"
    track = read_track(made / "track.parquet", N)
    for first, last in (FLAGGED[0], FLAGGED[2]):
        track.flags[first : last + 1, 4] = 1
    write_table(made / "track.parquet", TRACK, track.columns())
    write_text(made / "report.html", trial_page(made, trial=3, experiment="swing"))
    return made


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    with browser.page() as opened:
        yield opened


@pytest.fixture
def film(page: Page, folder: Path) -> Page:
    """Return the page with its film ready, and the keyboard on the scrubber."""
    page.open(folder / "report.html")
    page.wait(f"{DATA}.shown")
    page.value("document.querySelector('[data-part=scrubber]').focus()")
    return page


def burned(page: Page) -> int:
    """Return the number that is burned into the frame on the screen."""
    picture = np.asarray(Image.open(io.BytesIO(page.picture(".screen video"))).convert("L"))
    scale = picture.shape[1] / CLIP_PX[0]
    row, columns = int(NUMBER_PX * scale / 2), (np.arange(NUMBER_BITS) + 0.5) * NUMBER_PX * scale
    bits = picture[row, columns.astype(int)] > 128
    return int(bits @ (1 << np.arange(NUMBER_BITS)))


def check_shows(page: Page, frame: int) -> None:
    """Wait until a frame is shown: on the screen, in words, and on the scrubber."""
    page.wait(f"{DATA}.shown === '{frame}' && !document.querySelector('video').seeking")
    # A busy browser paints a frame some time after the video's "seeked" event.
    page.until(lambda: burned(page) == frame, f"frame {frame} is on the screen")
    assert page.value("document.querySelector('[data-part=frame]').textContent") == f"frame {frame}"
    assert page.value("Number(document.querySelector('[data-part=scrubber]').value)") == frame


def test_keys_step_and_jump_to_the_frame_that_is_shown(film: Page, folder: Path) -> None:
    results = read_results(folder)
    shown = film_of(results, results.need("clip"))
    closest, worst = Verdict.read(folder / "verdict.json").closest_frame, shown.worst()
    assert closest is not None
    assert worst is not None
    check_shows(film, closest)  # where it begins
    for key, shift, frame in (
        ("ArrowRight", False, closest + 1),
        ("ArrowLeft", False, closest),
        ("ArrowLeft", True, closest - 10),
        ("ArrowRight", True, closest),
        ("w", False, worst),
        ("c", False, closest),
        ("Home", False, 0),
        ("ArrowLeft", False, 0),
        ("]", False, 40),
        ("]", False, 120),
        ("]", False, 300),
        ("]", False, 300),
        ("[", False, 120),
        ("End", False, LAST),
        ("ArrowRight", False, LAST),
    ):
        film.press(key, shift)
        check_shows(film, frame)


def test_any_frame_is_found_from_any_other(film: Page) -> None:
    for frame in np.random.default_rng(4).integers(0, LAST + 1, 15).tolist():
        film.value(
            f"(s => {{ s.value = {frame}; s.dispatchEvent(new Event('input', {{bubbles: true}})); }})"
            "(document.querySelector('[data-part=scrubber]'))"
        )
        check_shows(film, frame)


def test_it_plays_at_a_twentieth_and_pauses(film: Page) -> None:
    film.press("Home")
    check_shows(film, 0)
    assert film.value("document.querySelector('video').playbackRate") == 1.0  # 500 frames/s, shown at 25
    film.press(" ")
    film.wait(f"Number({DATA}.shown) > 5")
    assert film.value("document.querySelector('[data-do=play]').getAttribute('aria-pressed')") == "true"
    film.press(" ")
    film.wait("document.querySelector('video').paused && !document.querySelector('video').seeking")
    assert film.value("document.querySelector('[data-do=play]').getAttribute('aria-pressed')") == "false"
    check_shows(film, int(film.value(f"{DATA}.shown")))


def test_what_is_drawn_belongs_to_the_frame(film: Page, folder: Path) -> None:
    results = read_results(folder)
    clip = results.need("clip")
    shown = film_of(results, clip)
    assert shown.flagged_runs() == FLAGGED
    film.press("Home")
    check_shows(film, 0)
    for frame in (40, 120):
        film.press("]")
        check_shows(film, frame)
        drawn = film.value("document.querySelector('[data-part=fitted]').getAttribute('d')")
        places = np.array([each.split(",") for each in drawn[1:].split("L")], float)
        assert (
            np.abs(places - clip_px(results.need("camera"), clip, shown.fitted_m[frame])).max()
            <= 0.5 / 16 + 1e-9
        )
        squares = film.value("document.querySelector('[data-part=flagged]').getAttribute('d')").count("M")
        rings = film.value("document.querySelector('[data-part=measured]').getAttribute('d')").count("M")
        assert (rings, squares) == ((N, 1) if frame == 40 else (7, 0))
    words = film.value("document.querySelector('[data-part=scrubber]').getAttribute('aria-valuetext')")
    assert words.startswith("frame 120, ")
    assert words.endswith("flagged: points 7, 8, 9, 10")


def test_the_lines_in_the_plots_follow_the_frame(film: Page, folder: Path) -> None:
    results = read_results(folder)
    shown = film_of(results, results.need("clip"))
    film.press("Home")
    check_shows(film, 0)
    film.press("]")
    for frame in (40, 120):
        check_shows(film, frame)
        lines = film.value(
            "Array.from(document.querySelectorAll('line.now'), l => [l.dataset, l.getAttribute('x1'), "
            "l.getAttribute('x2'), l.getAttribute('visibility')].map(v => ({...v}.clock ? {...v} : v)))"
        )
        assert [line[0]["clock"] for line in lines].count("frame") == 2
        assert len(lines) == 10
        for data, x1, x2, visibility in lines:
            now = frame if data["clock"] == "frame" else 1e3 * shown.since_start_s[frame]
            first, last, left, right = (float(data[name]) for name in ("first", "last", "left", "right"))
            share = (now - first) / (last - first)
            assert visibility == ("visible" if 0 <= share <= 1 else "hidden")
            if visibility == "visible":
                assert x1 == x2
                assert float(x1) == pytest.approx(left + share * (right - left), abs=0.02)
        assert sum(line[3] == "visible" for line in lines) >= 8
        film.press("]")


def test_a_tile_of_the_film_strip_jumps_to_its_frame(film: Page) -> None:
    film.value("document.querySelectorAll('.strip button')[3].click()")
    check_shows(film, 159)


def test_a_screen_reader_is_told_everything(film: Page) -> None:
    nodes = film.send("Accessibility.getFullAXTree")["nodes"]
    named = {
        (node["role"]["value"], node.get("name", {}).get("value", ""))
        for node in nodes
        if not node["ignored"]
    }
    assert ("slider", "frame") in named
    assert ("group", "Film") in named
    wanted = {"one frame back", "one frame on", "Closest approach", "Worst fit", "▶ Play at 1/20 speed"}
    wanted |= {"to the flagged run before", "to the next flagged run"}
    assert wanted <= {name for role, name in named if role in ("button", "ToggleButton")}
    assert {name.strip() for role, name in named if role == "checkbox"} == {"measured", "fitted"}
    unnamed = {role for role, name in named if role in ("button", "slider", "image", "img") and not name}
    assert unnamed == set()


def test_without_scripts_the_film_strip_stands_alone(page: Page, folder: Path) -> None:
    page.send("Emulation.setScriptExecutionDisabled", value=True)
    page.open(folder / "report.html")
    assert page.value("getComputedStyle(document.querySelector('.viewer')).display") == "none"
    assert page.value("document.querySelectorAll('.strip button').length") == 0
    lines = "Array.from(document.querySelectorAll('line.now'), l => getComputedStyle(l).visibility)"
    assert set(page.value(lines)) == {"hidden"}
    assert page.value("document.querySelectorAll('.strip li > svg').length") == 10
    tile = np.asarray(
        Image.open(io.BytesIO(page.picture(".strip li:nth-child(4) image"))).convert("L"), float
    )
    square = tile[: tile.shape[0] * NUMBER_PX // CLIP_PX[1], : tile.shape[1] * NUMBER_PX // CLIP_PX[0]]
    assert np.median(square) > 200  # bit 0 of frame 159


def test_nothing_moves_unasked(page: Page, folder: Path) -> None:
    page.prefer("reduced-motion", "reduce")
    page.open(folder / "report.html")
    page.wait(f"{DATA}.shown")
    assert page.value("document.querySelector('video').paused && !document.querySelector('video').autoplay")
    assert page.value("document.getAnimations().length") == 0


def test_the_page_is_never_wider_than_its_window(film: Page) -> None:
    for width in (1400, 390):
        film.resize(width)
        assert film.value("document.documentElement.scrollWidth") == width


def test_a_film_that_cannot_be_played_says_so(page: Page, folder: Path, tmp_path: Path) -> None:
    html = (folder / "report.html").read_text()
    mp4 = Clip.read(folder / "clip.json").mp4
    write_text(tmp_path / "report.html", html.replace(mp4, mp4[: len(mp4) // 8 * 4].replace("a", "b")))
    page.open(tmp_path / "report.html")
    page.wait("!document.querySelector('[data-part=unplayable]').hidden")
    assert page.value("document.querySelector('.viewer').hidden")
