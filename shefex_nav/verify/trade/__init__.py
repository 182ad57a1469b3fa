"""Many sets of instruments compared by covariance alone: `shefex-nav trade`.

The linear model is that of the bound (`verify.bound`), along one true flight and with one draw of the GPS
receiver; nothing is flown on board. `growth` keeps what the flight does to errors, `stars` says which fixes
the star tracker would give, `predict` gives the covariances of one scenario, `plan` makes the scenarios,
`judge` holds them against the requirements.
"""
