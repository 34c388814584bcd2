"""Calibration certificates: PDF/A-3 with the digital calibration certificate (DCC) attached.

`content` has every item of ISO/IEC 17025:2017, 7.8.2 and 7.8.4; `pdf` and `dcc` are both written
from it. The register issues the number and keeps the files
(`inercal.laboratory.store.certificates`).
"""
