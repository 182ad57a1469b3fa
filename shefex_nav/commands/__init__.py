"""The command line: one file a command, named as the command is; each parses, calls, prints.

`app.py` puts the commands together, `verify.py` those of `shefex-nav verify`. What several of them need:
`options.py` (options and how their texts are read), `output_files.py` (where results may be written),
`printing.py` (how anything is printed, and what a terminal may be given), `flights.py` (what is said of
flights). `refusal.py` words what the command line cannot take, `shell.py` what the shell gives the process.
"""
