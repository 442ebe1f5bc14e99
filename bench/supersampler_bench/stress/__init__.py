"""Stress: methods are run for long and treated badly; what they promise is measured against a bound."""
