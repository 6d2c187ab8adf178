"""Bodies: what a model of one hands to the tracker, and its fit to a person."""
