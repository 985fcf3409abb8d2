"""Posing by hand: the pose that meets clicked joints, and poses made of other poses."""
