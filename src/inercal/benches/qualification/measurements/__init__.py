"""Measurements that qualify a bench; each estimates parameters of the bench from readings.

They take arrays in SI and return `MeasuredParameters`.
"""
