"""Systems that track people in images, on rendered scenes whose truth is known: what such experiments have in common."""
