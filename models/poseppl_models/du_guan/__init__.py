"""Du and Guan (2006): a body of 24 coordinates and its image likelihood."""
