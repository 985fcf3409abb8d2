"""Review: how far a tracked motion is to be trusted, and where one more key pose would help most."""
