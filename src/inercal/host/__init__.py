"""The bench host: it drives a table, reads an IMU, keeps what came, and finds the result live."""
