"""What the methods of a turntable share: the sensor as they see it, and its attitude by the gyros.

No method itself: `turntable_kalman`, `turntable_discrete` and `turntable_trajectory` are.
"""
