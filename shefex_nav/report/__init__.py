"""What a log says. Works on `log.run_data.RunData`, never on the simulator.

metrics, requirements            every figure of a run; what the scenario asks of them
programme, lasting, states, trust    what the planned flight means for navigation
innovations, sensor_use          of each sensor: NIS; what was used and refused
imu_range, gps_limits            what of it IMU and receiver cannot show
air_on_board                     an air that is too far from what a filter with a barometer takes it for
instrument_sheets                instruments of the package, to choose from
table, page                      printed; one HTML page
figures/, viewer/                for paper; in rerun
export, track                    tables, ground tracks
"""
