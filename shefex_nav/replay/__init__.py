"""What has been recorded, again: logs of ours and data of others through the on-board navigation.

rerun                            a log of ours
schema*, load, params            how data of others are described
csv_folder, kf_gins, navego      their formats, read to a `dataset`; `matlab_child` is a process of its own
plausible, clocks                what such data are checked for
imu_axes, imu_units              likewise, of the IMU
align*, external                 the start, also of a heading that is not known
external, replayed               a run over them, from beginning to end
reference, said                  against a reference; in words
smooth, final_pass, relinear, smoother       smoothing: the filter's run, forward, backward
smoothed                         what a smoothed flight leaves
"""
