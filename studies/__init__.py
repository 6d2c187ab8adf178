"""Statistical studies behind the tables of the documentation."""
