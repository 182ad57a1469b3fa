"""The experiments of the papers that this project implements, flown again and set beside what was published.

One module holds the experiments of one subject; each experiment is an `Experiment` (see `experiment`), found
by its name in `registry`.
"""
