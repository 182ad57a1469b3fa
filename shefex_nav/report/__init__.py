"""What a log says: figures for engineers, a table for people, a viewer. Works on `log.run_data.RunData`."""
