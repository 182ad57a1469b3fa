"""Software and runs compared, seed by seed: `shefex-nav compare`.

given        what a word of the command line means: a log, a campaign, software, a scenario
flying       software and scenarios flown, a campaign in a folder for each
sides        what is compared: the runs of each side by their seeds
quantities   which figures of a run are compared, and which way is better
paired       two samples of the same seeds: difference, interval, verdict
comparison   sides -> everything that is said of them
described    whether the covariance of each describes its errors
parts        as tables;  summary  for programs;  page  one HTML page
"""
