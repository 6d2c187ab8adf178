"""Jobs in several libraries, each file a library's own way: a level that drifts, 28 linear dimensions, a chaotic state."""
