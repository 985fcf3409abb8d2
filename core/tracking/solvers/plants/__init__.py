"""Plants: points of the soles that stand, found and brought to rest."""
