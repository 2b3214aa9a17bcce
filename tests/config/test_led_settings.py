"""`align.led`: where the LED is in the picture, and which stages depend on it."""

import pytest

from strandcast.config.load import load_experiment
from strandcast.errors import StrandcastErrors
from strandcast.records.folders import ExperimentFolder
from strandcast.stages.code_version import settings
from strandcast.stages.context import Context
from strandcast.stages.job import Job

HEAD = "string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\n"


@pytest.fixture
def load(tmp_path):
    def run(text):
        path = tmp_path / "experiment.yaml"
        path.write_text(HEAD + text)
        return load_experiment(path)

    return run


def test_an_led_has_a_position_or_a_box(load):
    assert load("").align.led is None
    assert load("align: {led: {place_m: [0.1, 0.2]}}").align.led.radius_m == 0.01
    assert load("align: {led: {box_px: [1, 2, 9, 8]}}").align.led.box_px == (1, 2, 9, 8)


@pytest.mark.parametrize(
    "led", ["{place_m: [0.1]}", "{}", "{place_m: [0.1, 0.2], box_px: [1, 2, 9, 8]}", "{box_px: [9, 2, 1, 8]}"]
)
def test_an_led_with_neither_or_both_is_refused(load, led):
    with pytest.raises(StrandcastErrors, match=r"align\.led"):
        load(f"align: {{led: {led}}}")


def test_a_moved_led_changes_tracking_and_another_latency_does_not(load, tmp_path):
    one, moved, later = (
        load(f"align: {{led: {{place_m: [{x}, 0.2], latency_s: {late}}}}}")
        for x, late in ((0.1, 0.0), (0.2, 0.0), (0.1, 0.001))
    )
    jobs = [
        Job(Context("led", each, tmp_path / "led.yaml", ExperimentFolder(tmp_path, "led")), 1)
        for each in (one, moved, later)
    ]
    tracking, alignment = ([settings(job, stage) for job in jobs] for stage in ("track", "align"))
    assert tracking[0] != tracking[1]
    assert tracking[0] == tracking[2]
    assert alignment[0] != alignment[2]
