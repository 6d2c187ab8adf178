"""Files: read with a bound on their size, written whole or not at all."""
