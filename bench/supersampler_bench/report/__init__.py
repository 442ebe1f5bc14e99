"""Output of all records: the tables of the documentation, and one HTML page with figures.

Only the quick report measures anything; each measurement has its own package.
"""
