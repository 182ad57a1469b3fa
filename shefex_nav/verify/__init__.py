"""Verification against yardsticks from outside.

nesc, vehicles, daveml, flight, compare   NASA's check-cases
bound*, linear, field, over_bound                the Cramér-Rao bound
flown, consistency*, nees, study                 the statistics of many runs
robustness/                                      wrong data sheets and faults over a covering design
"""
