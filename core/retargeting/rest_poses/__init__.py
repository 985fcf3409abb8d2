"""Rest poses of two skeletons, aligned with each other."""
