"""The bodytrack benchmark (Deutscher and Reid 2005): body, likelihood and files."""
