"""Star tracker software: from a frame to an attitude, lost in space, ten times a second (`tracker`,
which sets the exposure of the next frame, too).

objects                          which way a frame is searched:
  background, scan               spots above background and noise
  streaks, binned, matched, streak_*           streaks of a known rate
spot, shape, fit                 where they are and how well
identify/, catalogue, tables     which star is which, with tables of the catalogue
best_attitude, attitude, likelihood              the attitude and its covariance
methods                          steps that can be done in other ways: of the papers, of plug-ins
"""
