"""The names of the experiments, and where they are. Modules are imported when an experiment is asked for."""

from importlib import import_module

# name -> (module of this package, title: what it is about in a line)
EXPERIMENTS = {
    "shefex-scan": ("shefex2.experiments", "SHEFEX 3.2: sequential scan against maximum search"),
    "shefex-catalogue": ("shefex2.experiments", "SHEFEX 3.3, figures 4 and 5: the star catalogue that flies"),
    "shefex-cos-error": ("shefex2.experiments", "SHEFEX figures 7 and 8: time and success against cosError"),
    "shefex-spikes": ("shefex2.experiments", "SHEFEX figure 9: wrong identifications against false stars"),
    "shefex-attitude": ("shefex2.experiments", "SHEFEX figure 10: attitude error against centroid error"),
    "shefex-end-to-end": (
        "shefex2.end_to_end",
        "SHEFEX 4 and 5: success of the whole chain on rendered frames",
    ),
    "shefex-rates": ("shefex2.rates", "SHEFEX 4: success against rate, exposure under automatic control"),
    "shefex-readings": ("shefex2.readings", "SHEFEX 4: success against rate, reading by reading"),
    "shefex-calibration": ("shefex2.experiments", "SHEFEX 4: focal length from identified frames"),
    "bright-table2": ("bright.experiments", "BRIGHT table 2: stars per magnitude"),
    "bright-brightest": ("bright.experiments", "BRIGHT 4.1, figure 3: the brightest star of a field"),
    "bright-centroids": (
        "bright.experiments",
        "BRIGHT figure 1: centre of mass against Gaussian interpolation",
    ),
    "bright-table3": ("bright.experiments", "BRIGHT table 3: three identifications in three situations"),
    "bright-table4": ("bright.experiments", "BRIGHT table 4: the same on rendered frames"),
    "impa-detection": ("impa.detection", "IMPA figure 12: faintest magnitude found against rate"),
    "impa-centroids": ("impa.centroids", "IMPA tables 3 to 5: centroid errors, both shutters"),
    "impa-pixels": ("impa.pixels", "IMPA tables 3 to 5: weights of the pixels, spot by spot"),
    "impa-joint": ("impa.experiments", "IMPA tables 6 to 13 with one joint set of assumptions"),
    "impa-attitude": ("impa.experiments", "IMPA tables 6, 7, 10, 11: attitude errors"),
    "impa-assumptions": ("impa.assumptions", "IMPA tables 8, 12: what hangs on what it does not say"),
    "impa-readings": ("impa.readings", "IMPA (32), (41), border, pole order: as printed and as read by us"),
    "impa-pitch": ("impa.pitch", "IMPA tables 7, 11: the mean of pitch, reading by reading"),
    "impa-frames": ("impa.frames", "IMPA: what the frames look like, and what is found in them"),
    "impa-images": ("impa.experiments", "IMPA tables 8, 9, 12, 13: success against the number of images"),
    "as-flown": ("flown", "The papers' systems in flight beside the default chain, in one table"),
}


def listing():
    """The experiments for people: one line each, str."""
    width = max(len(name) for name in EXPERIMENTS)
    return "\n".join(f"  {name:<{width}}  {about}" for name, (_, about) in EXPERIMENTS.items())


def load(name):
    """The experiment of a name: Experiment. KeyError if there is none."""
    module, title = EXPERIMENTS[name]
    return import_module(f"shefex_nav.papers.{module}").EXPERIMENTS[name]._replace(title=title)
