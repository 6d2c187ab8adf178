"""The site: a tree of sources assembled from the repository, built by Sphinx and checked; ``python docs/website``."""
