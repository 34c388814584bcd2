"""Measurements that qualify a bench: each an estimator from readings to parameters of the bench.

They take arrays in SI and return `MeasuredParameters`.
"""
