"""Run the bench host: it drives a table, reads an IMU, records both, and estimates live."""
