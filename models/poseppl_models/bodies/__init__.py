"""Bodies that people track: skeleton, flesh, random walk, and what is observed of them."""
