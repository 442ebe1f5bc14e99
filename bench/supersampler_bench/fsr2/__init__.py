"""`fsr2-like`: the published formulas and constants of AMD's FSR 2.2.

Source: the documentation and shaders of FidelityFX Super Resolution 2.2 (AMD, 2022-2023, MIT). Formulas and
constants are theirs, the code is ours, and it was never compared with their library. docs/quality.md says
what is left out.
"""
