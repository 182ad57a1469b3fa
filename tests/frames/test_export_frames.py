"""`shefex-nav export --frames`: whole pictures, as they were read, with their truth."""

import csv

import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS
from exported_frames import SEED, exported
from PIL import Image
from typer.testing import CliRunner

from shefex_nav import runs
from shefex_nav.commands.app import app
from shefex_nav.environment import ephemeris, stars
from shefex_nav.frames import flown, header
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply, rotvec_between
from shefex_nav.log import pixels, reader, topics
from shefex_nav.log.topics import LogError
from shefex_nav.scenario import load
from shefex_nav.solve.camera import Camera


def command(*arguments):
    return CliRunner().invoke(app, ["export", *map(str, arguments)])


def table(folder):
    """Rows of truth.csv."""
    with (folder / "truth.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def numbers(row, name, parts):
    return np.array([float(row[name.format(part)]) for part in parts])


def directions(hip, epoch):
    """(n, 3) of stars of the catalogue on a day, without aberration."""
    known = stars.at_epoch(stars.load_catalogue(8.0), ephemeris.julian_year(epoch))
    return known.u_i[np.searchsorted(known.hip, hip)]


def test_pixels_are_those_that_were_read(still):
    rows = table(still.folder)
    assert len(rows) == len(still.shots) > 20
    for row, shot in zip(rows, still.shots, strict=True):
        with Image.open(still.folder / row["file"]) as image:
            values = np.asarray(image)
        assert values.dtype == np.uint16 and np.array_equal(values, shot.frame.image_dn)
        assert 40 < np.median(values) < 80 and values.max() <= 4095  # nothing is stretched to 16 bits


def test_eight_bits_stay_eight(tmp_path):
    found = exported(tmp_path / "frames", "night_sky", (), SEED, 1.5)
    with Image.open(found.folder / table(found.folder)[0]["file"]) as image:
        assert image.mode == "L" and np.array_equal(np.asarray(image), found.shots[0].frame.image_dn)


def test_attitude_puts_stars_of_the_catalogue_where_they_are(still):
    """q_ic, the velocity and the pixels of one row fit together: to a hundredth of a pixel."""
    hole, epoch = still.flight.world.camera.pinhole, still.flight.scenario.mission.epoch
    earth_i = ephemeris.sky_bodies(epoch).earth_v_i
    for row, shot in zip(table(still.folder)[::7], still.shots[::7], strict=True):
        seen_i = stars.aberrate(
            directions(shot.truth.hip, epoch), earth_i + numbers(row, "v_i_{}_m_s", "xyz")
        )
        u_c = seen_i @ dcm_from_quat(numbers(row, "q_ic_{}", "wxyz"))
        x = hole.cx_px + hole.focal_length_px * u_c[:, 0] / u_c[:, 2]
        y = hole.cy_px + hole.focal_length_px * u_c[:, 1] / u_c[:, 2]
        assert len(x) > 3
        np.testing.assert_allclose(np.column_stack([x, y]), shot.truth.xy_px, atol=0.01)


def test_rate_is_that_of_the_attitudes(turning):
    """Mean rate of an exposure turns the attitude from frame to frame, where it is steady."""
    shots = [shot for shot in turning.shots if np.linalg.norm(shot.omega_c) > np.radians(2.0)]
    assert len(shots) > 5
    for shot in shots:
        half = quat_from_rotvec(0.5 * shot.frame.exposure_s * shot.omega_c)
        ahead = quat_multiply(shot.truth.q_ic, half)
        trajectory = turning.flight.world.flight.trajectory
        k = int(np.argmin(np.abs(trajectory.t_s - shot.frame.t_valid_s - 0.5 * shot.frame.exposure_s)))
        true = quat_multiply(trajectory.q_ib[k], turning.flight.world.camera.q_bc)
        assert np.linalg.norm(rotvec_between(ahead, true)) < np.radians(0.02)
        assert np.linalg.norm(rotvec_between(shot.q_mean, shot.truth.q_ic)) < np.radians(0.01)


def test_mean_attitude_is_that_of_the_whole_exposure(turning):
    """Mean of the turns since the instant, at each sample of the trajectory; it differs from none of them."""
    world, differences = turning.flight.world, []
    trajectory, q_bc = world.flight.trajectory, world.camera.q_bc
    for shot in turning.shots:
        half_s, t_s = 0.5 * shot.frame.exposure_s, shot.frame.t_valid_s
        rows = np.flatnonzero(np.abs(trajectory.t_s - t_s) < half_s + 1e-9)
        if abs((trajectory.t_s[rows[-1]] - trajectory.t_s[rows[0]]) - 2.0 * half_s) > 1e-6:
            continue  # the exposure is no whole number of samples
        turns = [rotvec_between(shot.truth.q_ic, quat_multiply(trajectory.q_ib[k], q_bc)) for k in rows]
        weights = np.r_[0.5, np.ones(len(rows) - 2), 0.5]
        mean = np.average(turns, axis=0, weights=weights)
        found = rotvec_between(shot.truth.q_ic, shot.q_mean)
        assert np.linalg.norm(found - mean) < 1e-8 + 0.02 * np.linalg.norm(mean)
        differences.append(np.linalg.norm(mean))
    assert len(differences) > 20 and max(differences) > 1e-6


def test_fits_has_pixels_header_and_wcs(turning):
    hole = turning.flight.scenario.star_camera.detector
    epoch, checked = turning.flight.scenario.mission.epoch, 0
    for row, shot in zip(table(turning.folder), turning.shots, strict=True):
        with fits.open(turning.folder / row["file"]) as parts:
            head, values = parts[0].header, parts[0].data
        assert values.dtype == np.uint16 and np.array_equal(values, shot.frame.image_dn)
        assert (head["SCENARIO"], head["SEED"], head["FRAME"]) == ("high_rate", SEED, shot.frame.number)
        assert head["EXPTIME"] == shot.frame.exposure_s and head["DATE-OBS"] + "Z" == row["utc"]
        np.testing.assert_allclose([head[f"Q_{part}"] for part in "WXYZ"], shot.truth.q_ic, atol=1e-15)
        if not len(shot.truth.hip):
            continue
        u_i = directions(shot.truth.hip, epoch)
        ra, dec = np.degrees(np.arctan2(u_i[:, 1], u_i[:, 0])), np.degrees(np.arcsin(u_i[:, 2]))
        xy_px = np.column_stack(WCS(head).all_world2pix(ra, dec, 0))
        # the lens is the true one: what is left is aberration, at most 26 arcsec, 0.35 px here
        assert np.hypot(*(xy_px - shot.truth.xy_px).T).max() < 0.36
        middle = WCS(head).all_pix2world(0.5 * (hole.columns - 1), 0.5 * (hole.rows - 1), 0)
        np.testing.assert_allclose([float(v) for v in middle], [head["RA"], head["DEC"]], atol=1e-6)
        checked += 1
    assert checked > 10


def test_what_the_star_tracker_said_stands_beside(turning):
    rows = table(turning.folder)
    assert {row["answer"] for row in rows} >= {"fix"}
    for row, shot in zip(rows, turning.shots, strict=True):
        if row["answer"] == "fix":
            assert numbers(row, "fix_q_ic_{}", "wxyz").tolist() == shot.fix.q_ic.tolist()
            sigma = numbers(row, "fix_sigma_{}_rad", "xyz")
            np.testing.assert_allclose(sigma**2, np.diag(shot.fix.P_c))
        else:
            assert row["fix_q_ic_w"] == "" and row["answer"] in ("smeared", "no_match", "too_few_stars")


@pytest.fixture(scope="module")
def flown_log(tmp_path_factory):
    """Log of a few seconds under the sky with every fourth picture whole."""
    log = tmp_path_factory.mktemp("log") / "run.mcap"
    scenario = load.load("night_sky", ("log.frames.full_every=4",))
    runs.fly(scenario, SEED, until_s=3.0, log=log)
    return log


def test_log_gives_all_its_frames_whole(flown_log, tmp_path):
    done = command(flown_log, "--frames", tmp_path / "out", "--from", "1.4s", "--every", "2")
    assert done.exit_code == 0, done.output
    rows, data = table(tmp_path / "out"), reader.read(flown_log)
    assert [row["number"] for row in rows] == [str(n) for n in data.frames.number if n >= 4][::2]
    whole = {one.ns: one.image_dn for one in pixels.between(flown_log) if one.is_full}
    thresholded = {one.ns: one.image_dn for one in pixels.between(flown_log) if not one.is_full}
    assert whole and thresholded
    epoch_ns, compared = topics.epoch_ns(data.mission.epoch_utc), 0
    for row in rows:
        with Image.open(tmp_path / "out" / row["file"]) as image:
            values = np.asarray(image)
        ns = int(topics.log_time_ns(epoch_ns, np.array([float(row["t_s"])]))[0])
        if ns in whole:
            assert np.array_equal(values, whole[ns])
            compared += 1
        elif ns in thresholded:
            kept = thresholded[ns]
            assert np.array_equal(values[kept > 0], kept[kept > 0]) and (values[kept == 0] > 0).any()
    assert compared > 1


def test_frames_of_another_flight_are_refused(flown_log, monkeypatch):
    data = reader.read(flown_log)
    other = data._replace(mission=data.mission._replace(seed=SEED + 1))
    monkeypatch.setattr(flown.reader, "read", lambda path: other)
    words = r"run.mcap: frame \d+ at T\+\d.* comes out otherwise than it was flown: the log has been changed"
    with pytest.raises(LogError, match=words):
        list(flown.shots(flown.of_log(flown_log), flown_log))


def test_selection(still):
    flight = still.flight
    chosen = list(flown.shots(flight, None, 2.0, 3.0, 3))
    wanted = [shot for shot in still.shots if 2.0 <= shot.frame.t_valid_s <= 3.0][::3]
    assert [one.frame.number for one in chosen] == [one.frame.number for one in wanted]
    assert all(
        np.array_equal(a.frame.image_dn, b.frame.image_dn) for a, b in zip(chosen, wanted, strict=True)
    )


@pytest.mark.parametrize(
    "options, says",
    [
        (["night_sky", "--frames", "{out}", "--format", "jpg"], "--format: expected one of png, fits"),
        (
            ["night_sky", "--frames", "{out}", "--from", "5s", "--until", "2s"],
            "--until: 2s is before",
        ),
        (["night_sky", "--frames", "{out}", "--from", "soon"], "--from"),
        (["night_sky", "--frames", "{out}", "--csv", "{out}2"], "tables need a log"),
        (["night_sky", "--frames", "{out}", "--set", "star_tracker.enabled=false"], "star_tracker.enabled"),
        (
            ["shefex2_dispersed", "--frames", "{out}", "--set", "star_tracker.frames=statistical"],
            "statistical",
        ),
        (["a.mcap", "--frames", "{out}", "--seed", "3"], "--seed: a log has its own"),
        (["a.mcap", "--csv", "{out}", "--until", "3s"], "--until: goes with --frames"),
        (["night_sky", "--frames", "{out}/no/where"], "there is no folder"),
        (["nowhere.mcap", "--frames", "{out}"], "nowhere.mcap"),
        (["no_such_scenario", "--frames", "{out}"], "no_such_scenario"),
    ],
    ids=lambda value: str(value)[:60],
)
def test_refusals(tmp_path, options, says):
    done = command(*(text.format(out=tmp_path / "out") for text in options))
    assert done.exit_code == 2, done.output
    words = " ".join(done.stderr.replace("│", " ").split())
    assert says in words and "Traceback" not in words
    assert not (tmp_path / "out").exists()


def test_a_folder_with_something_in_it_is_not_written_to(tmp_path):
    (tmp_path / "truth.csv").write_text("mine")
    done = command("night_sky", "--frames", tmp_path)
    assert done.exit_code == 2 and "is not empty" in " ".join(done.stderr.split())
    assert (tmp_path / "truth.csv").read_text() == "mine"


def test_times_without_a_frame(tmp_path):
    done = command("night_sky", "--frames", tmp_path / "out", "--until", "0.5s")
    assert done.exit_code == 2 and "there is no frame between these times" in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_written_again_has_no_frames_of_another_flight(tmp_path):
    folder = tmp_path / "frames"
    for until_s, name in ((1.6, "png"), (1.3, "fits")):
        done = command("night_sky", "--frames", folder, "--until", f"{until_s}s", "--format", name, "--force")
        assert done.exit_code == 0
        with (folder / "truth.csv").open(encoding="utf-8") as file:
            rows = [row["file"] for row in csv.DictReader(file)]
        assert sorted(rows) == sorted(path.name for path in folder.glob("frame_*"))
        assert {row.rpartition(".")[2] for row in rows} == {name}
    none = command("night_sky", "--frames", folder, "--until", "0.5s", "--force")
    assert none.exit_code == 2 and sorted(rows) == sorted(path.name for path in folder.glob("frame_*"))


def test_wcs_has_the_distortion_in_its_polynomials():
    """Stars by the written formula, and by the header that an astronomer's program reads."""
    k1, p1 = -0.7, 1.5e-3
    camera = Camera(659, 493, 2520.2, (333.1, 240.7), (k1, 0.0, p1, 0.0, 0.0))
    q_ic = quat_from_rotvec(np.array([0.4, -1.1, 0.3]))
    head = fits.Header()
    for key, value in header.wcs(q_ic, camera).items():
        head[key] = value
    xy = np.random.default_rng(1).uniform([-0.125, -0.09], [0.125, 0.095], (200, 2))
    r2 = (xy**2).sum(axis=1)
    x = xy[:, 0] * (1 + k1 * r2) + 2 * p1 * xy[:, 0] * xy[:, 1]
    y = xy[:, 1] * (1 + k1 * r2) + p1 * (r2 + 2 * xy[:, 1] ** 2)
    u_i = np.column_stack([xy, np.ones(200)]) @ dcm_from_quat(q_ic).T
    ra, dec = (
        np.degrees(np.arctan2(u_i[:, 1], u_i[:, 0])),
        np.degrees(np.arctan2(u_i[:, 2], np.hypot(*u_i[:, :2].T))),
    )
    at = np.column_stack([333.1 + 2520.2 * x, 240.7 + 2520.2 * y])
    on = ((at > -0.5) & (at < [658.5, 492.5])).all(axis=1)
    found = np.column_stack(WCS(head).all_world2pix(ra[on], dec[on], 0))
    np.testing.assert_allclose(found, at[on], atol=0.01)
    plain = np.column_stack([333.1 + 2520.2 * xy[:, 0], 240.7 + 2520.2 * xy[:, 1]])
    assert np.abs(plain - at)[on].max() > 3.0


COMPUTER = """
from shefex_nav.records import CameraCommand, Frame
from shefex_nav.software import Estimate, Solved


class Half:
    def start(self, alignment, mission):
        self.known, self.is_on = Estimate(alignment.r_i, alignment.v_i, alignment.q_ib), False

    def step(self, imu, arrived):
        given, self.is_on = [] if self.is_on else [CameraCommand(imu.t_valid_s, 0.05, 24.0)], True
        frames = [one for one in arrived if isinstance(one, Frame)]
        return [*given, self.known, *(Solved(number=one.number) for one in frames if one.number != 3)]
"""


def test_frames_that_a_computer_has_not_answered_are_named(tmp_path):
    (tmp_path / "half.py").write_text(COMPUTER)
    own = f"computer.software={tmp_path / 'half.py'}:Half"
    done = command("night_sky", "--frames", tmp_path / "out", "--until", "1.6s", "--trust", "--set", own)
    words = " ".join(done.stderr.replace("│", " ").split())
    assert done.exit_code == 2 and "gave no Solved of frame 3, not written" in words
