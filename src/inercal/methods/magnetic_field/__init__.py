"""Estimate a magnetometer in the earth's field, after the accelerometers and gyros of one unit.

The accelerometers give the upward direction at rest, the gyros give the rotation between nodes, and
the field is the same at all nodes. Together they determine the three axes and offsets of the
magnetometer in the frame of the accelerometers, and the dip of the field. This package uses plain
arrays: see `records` for the input, `rows` for the equations, `fitting` for the result and
`disturbances` for the tests of the field.
"""
