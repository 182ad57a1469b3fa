"""The experiments of the SHEFEX paper on scanning, catalogue, identification, attitude and calibration."""

from shefex_nav.reproduce import imaging, imaging_figures, shefex_attitude, shefex_figures, shefex_stars
from shefex_nav.reproduce.experiment import Experiment
from shefex_nav.reproduce.published import SHEFEX

EXPERIMENTS = {
    "shefex-scan": Experiment(
        title="Sequential scan against maximum search (SHEFEX section 3.2)",
        samples=200,
        unit="frames",
        chunk=50,
        measure=imaging.measure_scan,
        conclude=imaging.conclude_scan,
        draw=imaging_figures.draw_scan,
        timed=True,
    ),
    "shefex-catalogue": Experiment(
        title="the star catalogue that flies (SHEFEX section 3.3, figures 4 and 5)",
        samples=10000,
        unit="random attitudes",
        chunk=1000,
        measure=shefex_stars.measure_catalogue,
        conclude=shefex_stars.conclude_catalogue,
        draw=shefex_figures.draw_catalogue,
    ),
    "shefex-cos-error": Experiment(
        title="time and success of the pyramid against cosError (SHEFEX figures 7 and 8)",
        samples=SHEFEX["identification"]["random_attitudes"],
        unit="random attitudes",
        chunk=50,
        measure=shefex_stars.measure_cos_error,
        conclude=shefex_stars.conclude_cos_error,
        draw=shefex_figures.draw_cos_error,
        timed=True,
    ),
    "shefex-spikes": Experiment(
        title="wrong identifications of the pyramid against false stars (SHEFEX figure 9)",
        samples=SHEFEX["identification"]["random_attitudes"],
        unit="random attitudes",
        chunk=25,
        measure=shefex_stars.measure_spikes,
        conclude=shefex_stars.conclude_spikes,
        draw=shefex_figures.draw_spikes,
    ),
    "shefex-attitude": Experiment(
        title="attitude error against centroid error (SHEFEX figure 10)",
        samples=SHEFEX["identification"]["random_attitudes"],
        unit="random attitudes",
        chunk=100,
        measure=shefex_attitude.measure_attitude,
        conclude=shefex_attitude.conclude_attitude,
        draw=shefex_figures.draw_attitude,
    ),
    "shefex-calibration": Experiment(
        title="focal length and principal point from identified frames (SHEFEX section 4)",
        samples=500,
        unit="frames",
        chunk=50,
        measure=shefex_attitude.measure_calibration,
        conclude=shefex_attitude.conclude_calibration,
        draw=shefex_figures.draw_calibration,
    ),
}
