"""The servo's table on a trial's page."""

from strandcast.records.estimate import ServoFit
from strandcast.report.panels.hand_path import servo_table

OLD = {
    "delay_s": [0.004, 0.006],
    "natural_frequency_rad_s": [60.0, 70.0],
    "damping_ratio": [0.9, 1.0],
    "gain": [1.0, 1.0],
    "residual_rad": [5e-4, 6e-4],
}


def test_numbers_stand_in_ms_and_mrad_with_their_deviations() -> None:
    servo = ServoFit(
        **OLD,
        delay_sd_s=[0.0011, 0.0012],
        time_constant_s=[0.030, 0.0286],
        time_constant_sd_s=[0.0011, 0.0012],
        lag_s=[0.034, 0.0346],
        lag_sd_s=[0.00005, 0.00006],
        fitted_gain=[0.998, 1.001],
        fitted_gain_sd=[0.0003, 0.0004],
        held_out="the newest trial",
        held_out_rad=[5.2e-4, 7.1e-4],
        held_out_hand_m=3.6e-4,
    )
    table = servo_table(servo)
    first = [str(cell).replace("\u00a0", " ") for cell in table.rows[0]]
    assert first == [
        "1",
        "34.00 ± 0.05 ms",
        "4.0 ± 1.1 ms",
        "30.0 ± 1.1 ms",
        "0.9980 ± 0.0003",
        "0.50 mrad",
        "0.52 mrad",
    ]
    assert len(table.rows) == 2
    assert "the newest trial; rms 0.36 mm at the hand" in table.caption.replace("\u00a0", " ")


def test_a_record_of_before_is_read_and_shown_with_dashes() -> None:
    table = servo_table(ServoFit.model_validate(OLD))
    assert table.rows[1][1] == table.rows[1][6] == "–"
    assert "Held out" not in table.caption
