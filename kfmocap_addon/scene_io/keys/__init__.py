"""Keys of the animator and of the tracker: as key poses and motion, and whose each is."""
