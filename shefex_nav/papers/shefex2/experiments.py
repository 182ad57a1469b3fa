"""The experiments of the SHEFEX paper on scanning, catalogue, identification, attitude and calibration."""

from shefex_nav.papers.experiment import Experiment
from shefex_nav.papers.shefex2 import attitude, figures, frames, stars
from shefex_nav.papers.shefex2.published import SHEFEX

EXPERIMENTS = {
    "shefex-scan": Experiment(
        title="Sequential scan against maximum search (SHEFEX section 3.2)",
        samples=200,
        unit="frames",
        chunk=50,
        measure=frames.measure_scan,
        conclude=frames.conclude_scan,
        draw=figures.draw_scan,
        timed=True,
    ),
    "shefex-catalogue": Experiment(
        title="the star catalogue that flies (SHEFEX section 3.3, figures 4 and 5)",
        samples=10000,
        unit="random attitudes",
        chunk=1000,
        measure=stars.measure_catalogue,
        conclude=stars.conclude_catalogue,
        draw=figures.draw_catalogue,
    ),
    "shefex-cos-error": Experiment(
        title="time and success of the pyramid against cosError (SHEFEX figures 7 and 8)",
        samples=SHEFEX["identification"]["random_attitudes"],
        unit="random attitudes",
        chunk=50,
        measure=stars.measure_cos_error,
        conclude=stars.conclude_cos_error,
        draw=figures.draw_cos_error,
        timed=True,
    ),
    "shefex-spikes": Experiment(
        title="wrong identifications of the pyramid against false stars (SHEFEX figure 9)",
        samples=SHEFEX["identification"]["random_attitudes"],
        unit="random attitudes",
        chunk=25,
        measure=stars.measure_spikes,
        conclude=stars.conclude_spikes,
        draw=figures.draw_spikes,
    ),
    "shefex-attitude": Experiment(
        title="attitude error against centroid error (SHEFEX figure 10)",
        samples=SHEFEX["identification"]["random_attitudes"],
        unit="random attitudes",
        chunk=100,
        measure=attitude.measure_attitude,
        conclude=attitude.conclude_attitude,
        draw=figures.draw_attitude,
    ),
    "shefex-calibration": Experiment(
        title="focal length and principal point from identified frames (SHEFEX section 4)",
        samples=500,
        unit="frames",
        chunk=50,
        measure=attitude.measure_calibration,
        conclude=attitude.conclude_calibration,
        draw=figures.draw_calibration,
    ),
}
