"""The bench host: drives a table, reads an IMU, records both and estimates live."""
