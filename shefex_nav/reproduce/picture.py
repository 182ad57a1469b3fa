"""The figure of an experiment as a PNG file; matplotlib is imported when a figure is drawn, not before."""


def draw(experiment, outcome, path):
    """Draw an experiment into a file, over an older figure of the same name."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    FigureCanvasAgg(figure)
    experiment.draw(figure, outcome.results, outcome.rows)
    figure.savefig(path, dpi=120, metadata={"Software": None})  # no version: same figure, same bytes
