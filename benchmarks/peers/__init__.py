"""One job in several libraries: the smoothed means of a level that drifts, each file a library's own way."""
