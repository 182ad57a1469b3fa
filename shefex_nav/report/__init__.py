"""What a log says. Works on `log.run_data.RunData`, never on the simulator.

metrics, requirements            every figure of a run; what the scenario asks of them
programme, lasting, states, trust, imu_range     what the planned flight means for navigation
table, page                      printed; one HTML page
figures/, viewer/                for paper; in rerun
export, track                    tables, ground tracks
"""
