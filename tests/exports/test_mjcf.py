"""`export mjcf`: MuJoCo reads it; it hangs at rest, swings, and follows the track like our own simulation."""

import mujoco
import numpy as np
import pytest

from strandcast.core.strings import PARAMETERS, StringBatch
from strandcast.dynamics.batch import HANGING_AT_REST, HandPath
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.simulate import simulate_batch
from strandcast.estimation.throws import PreparedThrow
from strandcast.exports.fitted_model import export_mjcf, play
from strandcast.exports.mjcf import in_mujoco


@pytest.fixture(scope="module")
def exported(project, tmp_path_factory):
    import strandcast

    out = tmp_path_factory.mktemp("mjcf") / "small.xml"
    return export_mjcf(strandcast.open(project)["small"].trials[1], out, total_kg=0.02)


def at_key(exported, name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_path(str(exported.file))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(name).id)
    mujoco.mj_forward(model, data)
    return model, data


def test_its_E_is_within_one_and_a_half_of_ours(exported) -> None:
    assert 0 < exported.E_m < 1.5 * exported.own_E_m


def test_mujoco_loads_the_arm_with_the_string_at_rest(exported, trial) -> None:
    model, data = at_key(exported, "start")
    assert model.ngeom > 2 * 10  # a bead and a rod of each link, and the arm's own
    string = [model.body(f"string_{k}").id for k in range(1, 11)]
    assert model.body_mass[string].sum() == pytest.approx(0.02, rel=1e-5)
    x, y = (
        float(v) for v in trial.estimate.simulate(trial.motion).query("point == 10").iloc[0][["x_m", "y_m"]]
    )
    tip = data.site("tip").xpos.copy()
    assert tip == pytest.approx([x, 0.0, y], abs=2e-3)
    mujoco.mj_step(model, data, 1000)
    assert np.linalg.norm(data.site("tip").xpos - tip) < 2e-3


def test_it_swings(exported) -> None:
    model, data = at_key(exported, "swing")
    tip = data.site("tip").xpos.copy()
    mujoco.mj_step(model, data, 2000)
    assert np.linalg.norm(data.site("tip").xpos - tip) > 0.1


def test_drag_that_differs_along_and_across_becomes_one_value() -> None:
    row = np.full((1, len(PARAMETERS)), 0.5)
    plain, slender = (StringBatch(row, np.ones((1, 8)), {"drag_along": np.array([x])}) for x in (0.0, 0.2))
    both = [in_mujoco(string, 0.32) for string in (plain, slender)]
    assert both[1].drag == pytest.approx(0.6 * both[0].drag)
    assert both[1].viscosity_pa_s == pytest.approx(0.6 * both[0].viscosity_pa_s)


@pytest.mark.parametrize(
    ("k_s", "tip", "step_s"),
    [(1e8, 12.0, 5e-5), (2e5, 12.0, 5e-5), (1e8, 500.0, None)],
    ids=["rigid", "stretching", "stiff springs"],  # the last diverges at steps of 0.2 ms
)
def test_mujoco_and_our_simulation_agree_where_both_have_the_physics(k_s, tip, step_s) -> None:
    """Equal bending coefficients, a smooth hand: only the integration differs."""
    given = {"k_s": k_s, "c_s": 100.0, "k_h": 2.0, "c_h": 0.05, "k_sh": 2.0, "c_sh": 0.05}
    given |= {"C_c1": 0.2, "C_c2": 0.3, "k_ph": 4.0, "c_ph": 0.02}
    masses = np.ones((1, 8))
    masses[0, -1] = tip
    row = np.array([[given[name] for name in PARAMETERS]])
    string = StringBatch(row, masses).with_values(
        rest_curl_rad_m=np.array([6.0]), clamp_offset_rad=np.array([0.3])
    )
    model = StringModel(0.32, 8, dt_s=1e-4)
    time_s = np.linspace(0.0, 0.8, 401)
    turned = 1.2 * (10 * (time_s / 0.8) ** 3 - 15 * (time_s / 0.8) ** 4 + 6 * (time_s / 0.8) ** 5)
    pose = np.stack([0.5 * np.cos(turned - 1.5), 0.5 * np.sin(turned - 1.5), turned - 1.5], axis=1)
    hand, frames = HandPath(time_s, pose), time_s[::20]
    ours = simulate_batch(model, string, hand, frames)[0][0]
    throw = PreparedThrow(
        np.arange(len(frames)), frames, ours, np.ones((len(frames), 8)), hand, HANGING_AT_REST
    )
    theirs = play(throw, ours[0], in_mujoco(string, 0.32, float(masses.sum())), step_s=step_s)
    assert np.linalg.norm(theirs - ours, axis=2).max() < 2e-3
    assert np.ptp(ours[:, -1], axis=0).max() > 0.2
