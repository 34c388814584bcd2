"""Qualify a bench by measurements, each of which estimates some of its parameters.

The functions accept arrays in SI and return `MeasuredParameters`.
"""
