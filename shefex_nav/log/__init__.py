"""The log of a mission: one MCAP file, written from columns and records, read as arrays.

topics            which record goes where; `shefex_nav.fields`: and with which fields
steady            what a flight tells at every tick, as columns, and the order of all records
thinning          a lower rate
wire              records and columns to messages and back
drawings          Foxglove's messages of them; pose_columns, many at once
writer            the file
reader, tail      the file as arrays, and while it is written; checked, mcap_file, pixels, other_solutions
run_data          all of one run as arrays
"""
