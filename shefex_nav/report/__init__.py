"""What a log says. Works on `log.run_data.RunData`, never on the simulator.

metrics, requirements            every figure of a run; what the scenario asks of them
programme, lasting, trust        what the planned flight means for navigation
error_figures, navigation_errors   how large errors are, and whether their covariance describes them
innovations, sensor_use          of each sensor: NIS; what was used and refused
sensor_limits                    what of it IMU and receiver cannot show
air_on_board                     an air that is too far from what a filter with a barometer takes it for
instrument_sheets                instruments of the package, to choose from
table, table_rows, page          printed; one HTML page
figures/, viewer/                for paper; in rerun
export, track                    tables, ground tracks
"""
