"""Posed bodies as pictures: which part, and how far, every pixel of a view shows, and the outlines there."""
