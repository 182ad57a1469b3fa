"""The papers that this project implements: their methods, their experiments, what was published.

shefex2/, bright/, impa/         one folder a paper; in each:
  methods/ is what it proposes, added to the tables of the star tracker (`plugins`)
  published is what it printed
  all else draws, measures, concludes and shows
flown                            their systems in flight beside the default chain
angles                           what the identifications of all papers share
settings, stills                 star tracker and single frames that the experiments begin with
registry -> experiment -> engine, keep    an experiment by its name; run on all cores; results kept
rows, verdict -> table, picture           published beside measured
"""
