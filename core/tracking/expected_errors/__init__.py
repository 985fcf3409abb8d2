"""How far a tracked joint may be off: covariances, calibrated on key poses, and the probability that a limb is lost."""
