"""The experiments of the SHEFEX paper on scanning, catalogue, identification, attitude and calibration."""

from shefex_nav.papers.experiment import Experiment
from shefex_nav.papers.shefex2 import attitude, figures, frames, stars
from shefex_nav.papers.shefex2.published import SHEFEX

EXPERIMENTS = {
    "shefex-scan": Experiment(
        samples=200,
        unit="frames",
        chunk=50,
        measure=frames.measure_scan,
        conclude=frames.conclude_scan,
        draw=figures.draw_scan,
        timed=True,
    ),
    "shefex-catalogue": Experiment(
        samples=10000,
        unit="random attitudes",
        chunk=1000,
        measure=stars.measure_catalogue,
        conclude=stars.conclude_catalogue,
        draw=figures.draw_catalogue,
    ),
    "shefex-cos-error": Experiment(
        samples=SHEFEX["identification"]["random_attitudes"],
        unit="random attitudes",
        chunk=50,
        measure=stars.measure_cos_error,
        conclude=stars.conclude_cos_error,
        draw=figures.draw_cos_error,
        timed=True,
    ),
    "shefex-spikes": Experiment(
        samples=SHEFEX["identification"]["random_attitudes"],
        unit="random attitudes",
        chunk=25,
        measure=stars.measure_spikes,
        conclude=stars.conclude_spikes,
        draw=figures.draw_spikes,
    ),
    "shefex-attitude": Experiment(
        samples=SHEFEX["identification"]["random_attitudes"],
        unit="random attitudes",
        chunk=100,
        measure=attitude.measure_attitude,
        conclude=attitude.conclude_attitude,
        draw=figures.draw_attitude,
    ),
    "shefex-calibration": Experiment(
        samples=500,
        unit="frames",
        chunk=50,
        measure=attitude.measure_calibration,
        conclude=attitude.conclude_calibration,
        draw=figures.draw_calibration,
    ),
}
