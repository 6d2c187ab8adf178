"""A person's silhouettes in calibrated videos."""
