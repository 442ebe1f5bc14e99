"""Output of records: the tables of the documentation, and figures."""
