"""Measurements that qualify a bench; each estimates parameters of the bench from readings.

The functions accept arrays in SI and return `MeasuredParameters`.
"""
