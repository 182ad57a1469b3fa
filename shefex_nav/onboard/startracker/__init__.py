"""Star tracker software: from a frame to an attitude, lost in space, ten times a second (`tracker`).

exposure                         exposure and gain of the next frame
objects                          which way a frame is searched:
  background, scan               spots above background and noise
  streaks, binned, matched, streak_*           streaks of a known rate
  clusters, compensate, multipole_chain        the chain of the Improved Multi-Poles paper
spot, shape, fit, centroid       where they are and how well; published centroids
identify/, catalogue, kvector, skygrid, tables   which star is which, with tables of the catalogue
best_attitude, attitude, likelihood              the attitude and its covariance
calibrate                        focal length, principal point and distortion from identified frames
"""
