"""Published experiments, made again and put to the test."""
