"""Write calibration certificates as PDF/A-3, with the digital certificate (DCC) attached.

`content` contains every item that ISO/IEC 17025:2017, 7.8.2 and 7.8.4 require, and both PDF and DCC
are written from this content. The register issues the number and stores the files
(`inercal.laboratory.store.certificates`).
"""
