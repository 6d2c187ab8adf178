"""The job in smcx."""
