"""The log of a mission: one MCAP file, written record by record, read as arrays."""
