"""Files: read with a bound on their size, written whole or not at all; and arrays kept with a record of what made them."""
