"""External data through the filter: ideal sensors of a turntable at many rates, gaps, poor receivers."""

import numpy as np
import pytest
import replay_files
import turntable
from turntable import Turntable

from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.replay import external, load
from shefex_nav.report import local_level

LENGTH_S = 12.0


def replayed(path, overrides=()):
    """RunData of a replay."""
    scenario, files = load.load(path, overrides)
    ready = external.prepare(scenario, files)
    kept = RunDataBuilder(external.mission(ready))
    for record in external.run(ready, external.Clock()):
        kept.add(record)
    return kept.build()


@pytest.mark.parametrize(
    ("rate_hz", "in_tick"), [(100.0, 4), (125.0, 4), (200.0, 4), (500.0, 4), (200.0, 1), (200.0, 40)]
)
def test_ideal_sensors_at_any_rate_leave_no_error(rate_hz, in_tick, tmp_path):
    """A fast turntable on a slow Earth: what is left is the curvature within a sample.

    Integrated without GNSS, so that nothing corrects a wrong increment, time or axis.
    """
    path = replay_files.turntable_folder(tmp_path, Turntable(), turntable.increments, rate_hz, LENGTH_S)
    data = replayed(path, ["gnss.first=1000 s", f"navigation.samples_per_tick={in_tick}"])
    t_s, error, _, _ = local_level.errors(data)
    assert len(t_s) == int(LENGTH_S * rate_hz) // in_tick
    assert t_s[-1] == pytest.approx(LENGTH_S, abs=in_tick / rate_hz)
    # an error of the gravity or of a sign makes metres; a sample too early or too late 1e-3 rad
    assert np.abs(error[:, :3]).max() < 1e-3
    assert np.abs(error[:, 3:6]).max() < 3e-4
    assert np.abs(error[:, 6:]).max() < 2e-6


def test_fixes_of_the_true_place_leave_it_there(tmp_path):
    """With GNSS: every fix is used, and its innovation is nothing but rounding and integration."""
    path = replay_files.turntable_folder(tmp_path, Turntable(), turntable.increments, 100.0, LENGTH_S)
    data = replayed(path)
    gates = [gate for gate in data.gates if gate.dof]
    assert len(gates) == 2 * 12 and all(gate.accepted for gate in gates)
    assert max(np.abs(gate.innovation).max() for gate in gates) < 1e-3


def test_a_receiver_without_velocity(tmp_path):
    """Only positions are measurements then; none is made up."""
    path = replay_files.turntable_folder(tmp_path, Turntable(), turntable.increments, 100.0, LENGTH_S)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(", velocity: [vn, ve, vd]}", "}"), encoding="utf-8")
    gates = replayed(path).gates
    assert {gate.sensor for gate in gates} == {"gps_position"}
    assert all(gate.accepted for gate in gates)


@pytest.mark.parametrize(("missing", "blocks"), [(1, 1), (5, 2)])
def test_missing_samples_are_bridged_and_not_trusted(tmp_path, missing, blocks):
    """Of 1200 samples one or five are left out. The turntable turns evenly, so that nothing is lost.

    Sigma grows by what an angular acceleration of 0.5 rad/s^2 makes of one or two blocks of 40 ms, for which
    a mean is held that is 0.1 s old, and no further when samples come again.
    """
    path = replay_files.turntable_folder(tmp_path, Turntable(), turntable.increments, 100.0, LENGTH_S)
    whole = replayed(path, ["gnss.first=1000 s"])
    lines = (tmp_path / "imu.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "imu.csv").write_text(
        "\n".join(lines[:400] + lines[400 + missing :]) + "\n", encoding="utf-8"
    )
    data = replayed(path, ["gnss.first=1000 s"])
    _, error, _, _ = local_level.errors(data)
    assert np.abs(error[:, 6:]).max() < 1e-4
    assert (~data.imu.valid).sum() == blocks
    sigma_deg = np.degrees([np.linalg.norm(run.nav.sigma_theta_b[-1]) for run in (whole, data)]) / np.sqrt(
        3.0
    )
    gap_s = 0.04 * blocks
    expected_deg = np.degrees(0.5 * (0.1 + 0.5 * gap_s) * gap_s)
    assert np.sqrt(sigma_deg[1] ** 2 - sigma_deg[0] ** 2) == pytest.approx(expected_deg, rel=0.35)
    assert [record.healthy for record in data.health] == [False, True]


def test_latency_changes_when_not_what(tmp_path):
    """The same fixes 0.3 s later: the same solution once the last of them is in."""
    path = replay_files.turntable_folder(tmp_path, Turntable(), turntable.increments, 100.0, LENGTH_S)
    soon, late = replayed(path), replayed(path, ["gnss.latency=0.3 s"])
    np.testing.assert_allclose(soon.nav.r_i[-1], late.nav.r_i[-1], atol=1e-6)
    np.testing.assert_allclose(soon.covariance.P[-1], late.covariance.P[-1], rtol=1e-6, atol=1e-18)
    arrived = {gate.t_valid_s: gate.t_s for gate in late.gates}
    assert all(t_s - t_valid_s >= 0.3 - 1e-9 for t_valid_s, t_s in arrived.items())
