"""SHEFEX: the SHEFEX-2 star tracker and hybrid navigation system (DLR, 2011).

published, methods/              figures as printed; pyramid and calibration
field -> stars, attitude         lists of stars: catalogue, identification, attitude error, calibration
frames -> end_to_end, rates      rendered frames: scans, the whole chain at rest and turning
figures, experiments             drawings; the table of experiments
"""
