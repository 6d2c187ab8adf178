"""Sminchisescu and Triggs (2001): superquadric bodies, their priors and their image cost."""
