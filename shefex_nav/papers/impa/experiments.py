"""IMPA section 6: success against the number of images and attitude errors, of its chain and of ours."""

from shefex_nav.papers.experiment import Experiment
from shefex_nav.papers.impa import figures, flight, tables

# what makes the results of the campaign, besides the world and the software on board
KEPT = (
    *("angles", "settings", "stills", "impa.methods"),
    *("impa.field", "impa.trackers", "impa.flight", "impa.published"),
)
SAMPLES = 26000  # as in the paper, both shutters and both cases each; and 200 at rest
CHUNK = 20
BRIEF = 20  # where the campaign is one of all experiments

_CAMPAIGN = {
    "samples": SAMPLES,
    "unit": "simulations at 1 to 5 deg/s",
    "chunk": CHUNK,
    "measure": flight.measure,
    "designed": True,
    "kept": KEPT,
    "brief": BRIEF,
}

EXPERIMENTS = {
    "impa-images": Experiment(
        conclude=tables.conclude_images,
        draw=figures.draw_images,
        **_CAMPAIGN,
    ),
    "impa-joint": Experiment(
        conclude=tables.conclude_joint,
        draw=figures.draw_joint,
        **_CAMPAIGN | {"measure": flight.measure_joint, "unit": "simulations at 1 to 5 deg/s"},
    ),
    "impa-attitude": Experiment(
        conclude=tables.conclude_attitude,
        draw=figures.draw_attitude,
        **_CAMPAIGN,
    ),
}
