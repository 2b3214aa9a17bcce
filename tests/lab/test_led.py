"""The lab's LED: it shines when the controller says, and changes nothing else."""

from pathlib import Path

import numpy as np
import pytest

from strandcast.arm.load import PlanarArm
from strandcast.config.experiment import Experiment
from strandcast.errors import StrandcastError
from strandcast.lab.driver import VIDEO, LabDriver, LabThrow
from strandcast.lab.film import film_frames, film_subject
from strandcast.lab.led import LATENCY_S, LedTimes
from strandcast.lab.scene import make_scene
from strandcast.lab.strings import PAPER_STRINGS
from strandcast.lab.swing import simulate_swing
from strandcast.records.joint_log import SYNC_HIGH
from strandcast.records.lab_truth import LAB_TRUTH
from strandcast.records.tables import read_facts
from strandcast.video.reader import open_video

from .conftest import make_experiment, swing_command
from .test_swing import QUIET

PLACE_M = (0.60, 0.76)
SMALL = {"size_px": (400, 320), "frame_rate_hz": 100.0, "exposure_s": 4e-3}


def with_led(place_m: tuple[float, float] = PLACE_M) -> Experiment:
    settings = make_experiment(camera=SMALL).model_dump()
    settings["align"]["led"] = {"place_m": place_m}
    return Experiment.model_validate(settings)


def test_the_led_lights_only_its_region_for_its_share_of_an_exposure(arm: PlanarArm) -> None:
    string = PAPER_STRINGS["paper-1"]
    actors = film_subject(simulate_swing(arm, "servoj", string, QUIET, swing_command()), string)
    scene = make_scene(with_led(), "lab-test", arm)
    assert scene.led is not None
    middles, exposure_s = np.arange(-0.03, 0.05, 0.01), 4e-3
    films = [
        [
            image.astype(float)
            for image in film_frames(scene, actors, middles, exposure_s, 0.0, np.random.default_rng(0), lamp)
        ]
        for lamp in (None, LedTimes(-0.0108, 0.0303, 5e-4))
    ]
    lit = np.array([on - off for off, on in zip(*films, strict=True)])
    part = (slice(None), scene.led.rows, scene.led.columns)
    light = lit[part].sum(axis=(1, 2))
    # On at -10.3 ms, 0.575 of the exposure about -10 ms; off at 30.8 ms, 0.7 of that about 30 ms.
    np.testing.assert_allclose(light / light[3], [0, 0, 0.575, 1, 1, 1, 0.7, 0], atol=0.01)
    lit[part] = 0.0
    assert not lit.any()


def test_the_led_changes_a_scene_at_its_place_only(arm: PlanarArm) -> None:
    plain, scene = (make_scene(each, "lab-test", arm) for each in (make_experiment(camera=SMALL), with_led()))
    assert plain.led is None
    changed = np.argwhere(scene.still != plain.still)[:, ::-1]
    middle = scene.view.pixels(np.array(PLACE_M))
    assert len(changed) > 0
    assert np.linalg.norm(changed - middle, axis=1).max() < 12.0


def test_a_throw_switches_the_led_by_the_true_clocks(arm: PlanarArm, tmp_path: Path) -> None:
    experiment, command = with_led(), swing_command()
    driver = LabDriver(LabThrow("lab-test", experiment, 1, tmp_path / "truth.parquet"), arm)
    driver.move_to_start(command.q_rad[0])
    record = driver.play(command, tmp_path)
    on, off = record.sync_events
    assert (on.kind, off.kind) == ("led_on", "led_off")
    assert on.time_s < record.motion_start_s < record.motion_end_s < off.time_s
    high = (record.log.flags & SYNC_HIGH) > 0
    np.testing.assert_array_equal(
        high, (record.log.time_s >= on.time_s - 1e-9) & (record.log.time_s < off.time_s - 1e-9)
    )
    facts = read_facts(tmp_path / "truth.parquet", LAB_TRUTH)
    scene = make_scene(experiment, "lab-test", arm)
    u, v = np.rint(scene.view.pixels(np.array(PLACE_M))).astype(int)
    with open_video(tmp_path / VIDEO) as video:
        light = np.array([image[v, u] for _, _, image in video], float)
    robot_s = np.arange(len(light)) / SMALL["frame_rate_hz"] * (1 + facts["drift"]) + facts["offset_s"]
    late_s = float(np.mean(LATENCY_S))
    half_s = 0.5 * SMALL["exposure_s"] + LATENCY_S[1]
    lit = (robot_s > on.time_s + late_s + half_s) & (robot_s < off.time_s + late_s - half_s)
    dark = (robot_s < on.time_s + late_s - half_s) | (robot_s > off.time_s + late_s + half_s)
    assert lit.sum() > 30
    assert light[lit].min() > light[dark].max() + 60


def test_the_led_must_have_a_position_inside_the_picture(arm: PlanarArm) -> None:
    with pytest.raises(StrandcastError, match="SC-T033"):
        make_scene(with_led((3.0, 0.0)), "lab-test", arm)
